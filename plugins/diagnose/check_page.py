"""The page of a check: every finding with its verdict, its evidence, and its cure."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.errors import significant
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.figures.images import data_uri
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, svg
from eventsweep.eval.numbers import shown_zero_us
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Block,
    Columns,
    Details,
    Facts,
    Layer,
    Page,
    Picture,
    Pictures,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    page_text,
    plural,
    provenance,
    versions_grid,
)
from eventsweep.plugins.diagnose.check.findings import TIME, VERDICTS, Finding, Report, Series

JSON_NAME = "check.json"
FILES = (REPORT_NAME, JSON_NAME)
_SIZE_INCHES = (5.2, 2.3)
_LARGEST_PX = 640


def write_check_page(folder: Path, report: Report) -> Path:
    """Writes `check.json` and `report.html` into a folder, and returns the page's path."""
    text = json.dumps(report.to_json(), indent=2, ensure_ascii=False)
    (folder / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    (folder / REPORT_NAME).write_text(check_page_text(report, folder), encoding="utf-8")
    return folder / REPORT_NAME


def check_page_text(report: Report, folder: Path | None = None) -> str:
    """The page as HTML: what is wrong first; it links to files of the folder."""
    ordered = sorted(report.findings, key=lambda f: -VERDICTS.index(f.verdict))
    odd = [finding for finding in ordered if finding.verdict != "good"]
    good = [finding for finding in ordered if finding.verdict == "good"]
    unchecked = (f"not checked: {name}, because {why}" for name, why in report.unchecked)
    page = Page(
        title=f"Check of {report.name}",
        subtitle="Faults come first: the cure, where mapping has shown the cause, what the fault "
        "means for a map, and the evidence.",
        blocks=(Text(_plain(summary(report)), "lead"), Sentences(tuple(unchecked))),
        sections=(
            *(_section(finding, k) for k, finding in enumerate(odd)),
            *_good(good, len(odd)),
            provenance(versions_grid([report.name], [versions()])),
        ),
        files=files_in(folder, (JSON_NAME,)) if folder else (),
        verdict=report.verdict,
    )
    return page_text(page)


def _good(findings: Sequence[Finding], position: int) -> Iterator[Section]:
    """What is as it should be, in one box that opens."""
    if findings:
        blocks: list[Block] = []
        for k, finding in enumerate(findings):
            blocks += [Text(f"{finding.name}: {finding.evidence}"), *_figure(finding, position + k)]
        title = f"{plural(len(findings), 'check')} found nothing wrong"
        yield Section("good", title, (Details("Evidence", tuple(blocks)),), "good")


def _section(finding: Finding, position: int) -> Section:
    """What is wrong and its cure, then what it means and how that was seen."""
    cure = [Text(_plain(finding.cure), head="Cure: ")] if finding.cure else []
    pairs = {"Means": finding.meaning, "Evidence": finding.evidence, "Check": finding.name}
    known = tuple((name, text) for name, text in pairs.items() if text)
    said: tuple[Block, ...] = *cure, Facts(known)
    shown = tuple(_figure(finding, position))
    blocks = (Columns((said, shown)),) if shown else said
    return Section(finding.name, finding.suspect or finding.name, blocks, finding.verdict)


def summary(report: Report) -> str:
    """What is wrong, and how to cure the first cause, in a sentence or two."""
    wrong, doubtful = report.of("wrong"), report.of("doubtful")
    if not wrong and not doubtful:
        where = " in what was checked" if report.unchecked else ""
        return f"Nothing is wrong{where}: {plural(len(report.findings), 'check')}."
    parts = [f"Wrong: {', '.join(report.suspects)}."] if wrong else []
    parts += [f"Cure: {one.cure.rstrip('.')}." for one in wrong if one.cure][:1]
    named = ", ".join(dict.fromkeys(one.suspect or one.name for one in doubtful))
    parts += [f"Doubtful: {named}."] if doubtful else []
    return " ".join(parts)


def _plain(text: str) -> str:
    """A terminal's text as a page shows it: names of commands need no marks."""
    return text.replace("`", "")


def _figure(finding: Finding, position: int) -> Iterator[Block]:
    series = finding.series
    # A curve of a single point shows nothing that the evidence does not say.
    if series is None or np.isfinite(series.y).sum() < (1 if series.names else 2):
        return
    if series.y.ndim == 2:
        yield Pictures((_image(series),), columns=1)
    else:
        drawn = svg(_bars if series.names else _curve, series, finding, position)
        yield Plot(drawn, f"{finding.name}: {series.y_label or series.x_label}")


def _bars(series: Series, finding: Finding, position: int) -> Figure:
    width, height = _SIZE_INCHES
    figure = LaidOutFigure(figsize=(width, max(height, 0.24 * len(series.y) + 0.6)))
    axes = figure.subplots()
    bars = axes.barh(series.names, series.y, color=ESTIMATE_COLOUR, height=0.6)
    for k, bar in enumerate(bars):
        bar.set_gid(f"check-{position}-{finding.name}-{k}")
    axes.invert_yaxis()
    axes.axvline(0, linewidth=0.8, color="#777777")
    axes.set_xlabel(series.x_label)
    axes.grid(axis="x", linewidth=0.4, alpha=0.35)
    axes.set_axisbelow(True)
    return figure


def _curve(series: Series, finding: Finding, position: int) -> Figure:
    figure = LaidOutFigure(figsize=_SIZE_INCHES)
    axes = figure.subplots()
    x, x_label = _since_zero(series)
    (line,) = axes.plot(x, series.y, color=ESTIMATE_COLOUR, linewidth=1.2, marker=".",
                        markersize=3 if len(series.y) < 100 else 0)  # fmt: skip
    line.set_gid(f"check-{position}-{finding.name}")
    top = float(np.nanmax(np.abs(series.y), initial=0.0))
    for limit in series.limits:
        # A limit far beyond all values would press them into a line.
        if abs(limit) <= 3 * top:
            axes.axhline(limit, linewidth=0.8, linestyle=(0, (4, 2)), color="#777777")
    axes.set(xlabel=x_label, ylabel=series.y_label)
    axes.yaxis.set_major_formatter(lambda value, _: significant(value).replace("-", "−"))
    axes.grid(linewidth=0.4, alpha=0.35)
    return figure


def _since_zero(series: Series) -> tuple[NDArray[np.float64], str]:
    """Times and their label; those of a clock as seconds since the first."""
    zero_us = 0
    if series.x_label == TIME and len(series.x):
        zero_us = shown_zero_us(int(1e6 * series.x[0]))
    label = f"time since {zero_us / 1e6:.3f} s, s" if zero_us else series.x_label
    return series.x - zero_us / 1e6, label


def _image(series: Series) -> Picture:
    known = np.isfinite(series.y)
    values = np.where(known, series.y, 0.0)
    high = max(float(np.percentile(values, 99.5)), 1e-12)
    colours = mpl.colormaps["viridis"](np.clip(values / high, 0, 1))[..., :3]
    colours[~known] = (0.85, 0.2, 0.15)
    picture = Image.fromarray(np.rint(255 * colours).astype(np.uint8))
    picture.thumbnail((_LARGEST_PX, _LARGEST_PX), Image.Resampling.NEAREST)
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", optimize=True)
    layer = Layer(data_uri("image/png", buffer.getvalue()), f"0 (dark) to {high:.3g}")
    return Picture(series.y_label, (layer,))
