"""What `fit` and `realism` write: files for programs, and the page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, significant
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, TRUTH_COLOUR, plain_ticks, svg
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Grid,
    GridCell,
    Head,
    Layer,
    Page,
    Picture,
    Pictures,
    Section,
    Sentences,
    grid,
    made_here,
    page_text,
    tables,
)
from eventsweep.plugins.diagnose.sensing.estimates import Estimate
from eventsweep.plugins.diagnose.sensing.fit import SensorFit
from eventsweep.plugins.diagnose.sensing.realism import Portrait, Realism
from eventsweep.sim.sensor.sensor import Sensor


def fit_page(fit: SensorFit, name: str, command: str, files: tuple[str, ...]) -> str:
    """The page of a fitted sensor, as HTML."""
    known = [each for each in fit.estimates if not (each.refused or each.bounds)]
    findings = [
        f"{len(known)} of {len(fit.estimates)} parameters determined; the others are refused, or "
        "have an upper bound only, for which sensor.toml holds 0.",
        f"{len(fit.pixels):,} events in {fit.pixels.seconds:.2f} s; {fit.on_share:.1%} of them "
        "brighten.",
    ]
    if fit.effective:
        findings.append(
            f"The thresholds in sensor.toml, {fit.effective[0]:.3g} and {fit.effective[1]:.3g}, "
            "are not measured: with them the frames make as many events of each polarity."
        )
    pictures = [
        _drawn("Intervals", "time between two events of a pixel", _intervals, fit),
        _drawn("Events per pixel", "circles: hot pixels", _map, fit),
    ]
    if fit.pairs is not None and len(fit.pairs.sample):
        about = "change of log light between events near frames, against events"
        pictures.append(_drawn("Light and events", about, _changes, fit))
    blocks = (estimates_grid(fit.estimates), Pictures(tuple(pictures)))
    section = Section("fit", "Parameters", blocks)
    return _page(f"Sensor fitted to {name}", findings, section, command, files)


def realism_page(realism: Realism, command: str, files: tuple[str, ...]) -> str:
    """The page of two recordings side by side, as HTML."""
    real, simulated = realism.real, realism.simulated
    findings = [
        f"A classifier on event statistics tells them apart with an AUC of {realism.auc:.3f} "
        "(0.5: never, as good as real; 1: always)."
    ]
    lines = (
        (name, *(GridCell(significant(v), v) for v in (value, simulated.statistics[name])))
        for name, value in real.statistics.items()
    )
    single = ((name, GridCell(f"{value:.3f}", value)) for name, value in realism.single.items())
    grids = (
        grid(("statistic", Head(real.name, "real"), Head(simulated.name, "simulated")), lines),
        grid(("statistic of a window", Head("AUC of it alone")), single),
    )
    pictures = tuple(
        _drawn(title, label, _distribution, real, simulated, field, label, counted)
        for title, field, label, counted in (
            ("Intervals", "gap_us", "time between two events of a pixel [µs]", False),
            ("Bursts", "burst", "events per burst", True),
            ("Edges", "edge_hz", "rate of events at edges [1/s]", False),
            ("Rates", "per_pixel", "events per second of a pixel", True),
        )
    )
    names = "whole recordings", "what gives it away"
    blocks = (*tables("realism", names, grids, "Show"), Pictures(pictures))
    section = Section("realism", "Side by side", blocks)
    return _page(f"{simulated.name} compared with {real.name}", findings, section, command, files)


def _drawn(title: str, about: str, draw: Callable[..., Figure], *content: Any) -> Picture:
    return Picture(title, (Layer(svg(draw, *content), about),))


def estimates_grid(estimates: tuple[Estimate, ...]) -> Grid:
    """A line per parameter: value, uncertainty, or why it is refused."""
    known_first = sorted(estimates, key=lambda estimate: bool(estimate.refused))
    heads = ("parameter", Head("value"), Head("±", "95 %"), "unit", "result")
    return grid(heads, map(_line, known_first))


def _line(estimate: Estimate) -> tuple[object, ...]:
    refused = estimate.refused
    return (
        estimate.name,
        *(GridCell(word or "–", value) for word, value in zip(
            estimate.words, (estimate.value, estimate.uncertainty), strict=True)),
        estimate.unit,
        GridCell(f"refused: {refused}" if refused
                 else "upper bound" if estimate.bounds else "determined",
                 kind="worse" if refused or estimate.bounds else "better"),
    )  # fmt: skip


def _page(
    title: str, findings: list[str], section: Section, command: str, files: tuple[str, ...]
) -> str:
    blocks = (Sentences(tuple(findings)),)
    return page_text(Page(title, "", (section, made_here(command)), blocks, files=files))


def _intervals(fit: SensorFit) -> Figure:
    figure = LaidOutFigure(figsize=(5, 3))
    axes = figure.subplots()
    bins = np.geomspace(10, 1e6, 80).tolist()
    for gaps, colour, label in (
        (fit.pixels.gaps[0], TRUTH_COLOUR, "recorded"),
        (_modelled_gaps(fit), ESTIMATE_COLOUR, "fitted sensor on the frames"),
    ):
        if len(gaps):
            axes.hist(gaps, bins, weights=_percent(gaps), histtype="step", color=colour,
                      label=label)  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="interval [µs]", ylabel="share of intervals [%]")
    plain_ticks(axes.xaxis, axes.yaxis)
    axes.legend(frameon=False)
    return figure


def _percent(values: NDArray[np.generic]) -> NDArray[np.float64]:
    """Weights under which the bars of a histogram add up to 100."""
    return np.full(len(values), 100 / len(values))


def _modelled_gaps(fit: SensorFit) -> Any:
    """Intervals of the fitted sensor that watches the recording's frames; none without."""
    from eventsweep.emvs.data.events import Events
    from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents

    frames = fit.frames
    if frames is None:
        return np.empty(0)
    height, width = fit.pixels.shape
    sensor = Sensor(0, width, height, fit.config(), 0)
    sensor.start(frames.light[0], int(frames.t_us[0]))
    parts = [
        sensor.step(light, t_us).events
        for light, t_us in zip(frames.light[1:], frames.t_us[1:].tolist(), strict=True)
    ]
    span_us = int(frames.t_us[0]), int(frames.t_us[-1])
    return PixelEvents.of(Events.concat(parts), (height, width), span_us).gaps[0]


def _map(fit: SensorFit) -> Figure:
    figure = LaidOutFigure(figsize=(5, 3.6))
    axes = figure.subplots()
    rates_hz = fit.pixels.counts / fit.pixels.seconds
    # A pixel without events has no place on a logarithmic scale: the least rate stands for 0.
    least_hz = 1 / fit.pixels.seconds
    shown = axes.imshow(np.maximum(rates_hz, least_hz), norm="log", cmap="cividis")
    y, x = np.nonzero(fit.pixels.hot)
    axes.plot(x, y, "o", mfc="none", color=ESTIMATE_COLOUR, ms=6)
    axes.set(xticks=[], yticks=[])
    bar = figure.colorbar(shown, ax=axes, shrink=0.8, label="events per second")
    plain_ticks(bar.ax.yaxis)
    return figure


def _changes(fit: SensorFit) -> Figure:
    assert fit.pairs is not None
    change, plus, minus = fit.pairs.sample[:: max(1, len(fit.pairs.sample) // 4000)].T
    figure = LaidOutFigure(figsize=(5, 3.6))
    axes = figure.subplots()
    jitter = np.random.default_rng(0).uniform(-0.3, 0.3, len(change))
    axes.plot(plus - minus + jitter, change, ".", ms=2, color=TRUTH_COLOUR, alpha=0.4,
              rasterized=True)  # fmt: skip
    values = fit.values()
    net = np.array([(plus - minus).min(), 0, (plus - minus).max()])
    slopes = (
        values.get("contrast_threshold_neg", math.nan),
        values.get("contrast_threshold_pos", math.nan),
    )
    axes.plot(net, [net[0] * slopes[0], 0, net[2] * slopes[1]], color=ESTIMATE_COLOUR)
    axes.set(xlabel="brighter minus darker events", ylabel="change of ln(light)")
    return figure


def _distribution(
    real: Portrait, simulated: Portrait, field: str, label: str, counted: bool
) -> Figure:
    """Histograms of both; of counts no bin lies between two of them, where none can be."""
    figure = LaidOutFigure(figsize=(5, 3))
    axes = figure.subplots()
    both = [np.asarray(getattr(each, field), float) for each in (real, simulated)]
    positive = np.concatenate(both)
    positive = positive[positive > 0]
    least, most = positive.min(), positive.max()
    bins = np.geomspace(least, most * 1.01, 60)
    if counted:
        bins = (np.unique(np.geomspace(1, most / least + 1, 60).round()) - 0.5) * least
    for values, each, colour in zip(
        both, (real, simulated), (TRUTH_COLOUR, ESTIMATE_COLOUR), strict=True
    ):
        axes.hist(values, bins.tolist(), weights=_percent(values), histtype="step",
                  color=colour, label=each.name)  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel=label, ylabel="share [%]")
    plain_ticks(axes.xaxis, axes.yaxis)
    axes.legend(frameon=False)
    return figure


SENSOR_NAME, FIT_NAME, REALISM_NAME = "sensor.toml", "fit.json", "realism.json"


def write_fit(folder: Path, fit: SensorFit, name: str, command: str = "") -> None:
    """Writes sensor.toml, fit.json and report.html."""
    lines = [
        f"# The sensor of {name!r}, fitted by eventsweep; --sim.sensor.preset takes this file."
    ]
    lines += [f"# {e.name}: refused, {e.refused}" for e in fit.estimates if e.refused]
    bounds = [e for e in fit.estimates if e.bounds]
    lines += [f"# {e.name}: {e.words[0]} {e.unit}, an upper bound: 0 stands here" for e in bounds]
    if fit.effective:
        lines.append("# The thresholds make as many events as recorded when the frames drive the")
        lines.append("# simulator; they are not measured.")
    text = "\n".join(line.replace("\r", " ") for line in lines)
    (folder / SENSOR_NAME).write_text(f"{text}\n{tomli_w.dumps(fit.values())}", encoding="utf-8")
    facts = {
        "estimates": [estimate.facts() for estimate in fit.estimates],
        "effective_thresholds": list(fit.effective), "on_share": fit.on_share,
        "noise_light": fit.noise_light if fit.frames is not None else None,
        "events": len(fit.pixels), "seconds": fit.pixels.seconds,
    }  # fmt: skip
    (folder / FIT_NAME).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    page = fit_page(fit, name, command, (SENSOR_NAME, FIT_NAME))
    (folder / REPORT_NAME).write_text(page, encoding="utf-8")


def write_realism(folder: Path, realism: Realism, command: str = "") -> None:
    """Writes realism.json and report.html."""
    text = json.dumps(realism.facts(), indent=1) + "\n"
    (folder / REALISM_NAME).write_text(text, encoding="utf-8")
    page = realism_page(realism, command, (REALISM_NAME,))
    (folder / REPORT_NAME).write_text(page, encoding="utf-8")


def part_of_span(
    name: str, span_us: tuple[int, int], start_s: float | None, duration_s: float | None
) -> tuple[int, int]:
    """First and last instant of a part of a recording that has a name and a span, µs.

    Raises:
        InputError: a part outside of the recording.
    """
    first_us, last_us = span_us
    begin_us = first_us + round((start_s or 0.0) * 1e6)
    end_us = last_us if duration_s is None else min(last_us, begin_us + round(duration_s * 1e6))
    if not first_us <= begin_us < end_us:
        length = "" if duration_s is None else f" for {duration_s:g} s"
        raise InputError(
            f"{name}: from {start_s or 0:g} s{length} of a recording of "
            f"{(last_us - first_us) * 1e-6:g} s: choose a part within it"
        )
    return begin_us, end_us
