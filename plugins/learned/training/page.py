"""The page of a training: how errors fell, and what the expected errors are worth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from eventsweep.emvs.depth.precision import Precision
from eventsweep.emvs.utils.files import write_text
from eventsweep.eval.figures.colormaps import INK, line_style
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, svg
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Block,
    Columns,
    Grid,
    Head,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    grid,
    page_text,
    provenance,
)
from eventsweep.plugins.learned.training.config import History
from eventsweep.plugins.learned.training.train import Trained

_SIZE_INCHES = (5.2, 2.8)


def write_training_page(folder: Path, trained: Trained) -> Path:
    """Writes `report.html` beside the weights, and returns its path."""
    path = folder / REPORT_NAME
    write_text(path, page_text(training_page(folder, trained)))
    return path


def training_page(folder: Path, trained: Trained) -> Page:
    """What the page shows."""
    errors: tuple[tuple[Block, ...], ...] = (
        (Plot(svg(_errors, trained), "errors over epochs"),),
        (Plot(svg(_loss, trained.history), "training loss over epochs"),),
    )
    about = (
        "On the calibration sequences, which nothing is trained on: the share of pixels that are "
        "more than a pixel of disparity off."
    )
    if trained.task.methods:
        about += " The dashed lines are of the third that seems most reliable."
    weights = trained.weights.name, trained.weights.with_suffix(".json").name
    return Page(
        title=f"Training of {trained.task.title}",
        subtitle="",
        blocks=(Sentences(tuple(_sentences(trained))),),
        sections=(
            Section("errors", "Errors over epochs", (Text(about), Columns(errors))),
            *_precision(trained),
            Section("sequences", "Sequences", (_sequences(trained.manifest),)),
            provenance(_facts(trained.manifest)),
        ),
        files=files_in(folder, weights),
    )


def _precision(trained: Trained) -> Iterator[Section]:
    """What stated errors are worth; nothing of a network that states none."""
    if trained.task.methods:
        text = Text(
            "Each point of a curve is a threshold: pixels with at most this stated error, and how "
            "many of them are within a pixel."
        )
        drawn = svg(_worth, trained.manifest["precision"])
        plot = Plot(drawn, "points within a pixel over the stated error")
        yield Section("precision", "What the stated error is worth", (text, plot))


def _sentences(trained: Trained) -> list[str]:
    manifest = trained.manifest
    counts = manifest["samples"]
    of_all, of_third = _shares(trained, "all"), _shares(trained, "reliable")
    third = f"; of the third that seems most reliable {of_third}" if of_third else ""
    return [
        f"Trained on {counts['training']} pixels of {len(manifest['sequences']['training'])} "
        f"sequences, judged on {counts['calibration']} of "
        f"{len(manifest['sequences']['calibration'])} others.",
        f"Of all judged pixels {of_all}{third} are more than a pixel of disparity off.",
    ]


def _shares(trained: Trained, of: str) -> str:
    """How many of some pixels are off, and how many by what the network is compared with."""
    last, compared = trained.history[-1], trained.task.compared
    own, other = last.get(f"{of}_beyond_1px"), last.get(f"{compared}_{of}_beyond_1px")
    if own is None or other is None:
        return ""
    return f"{100 * own:.1f} % (by {compared} {100 * other:.1f} %)"


def _panel(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = LaidOutFigure(figsize=_SIZE_INCHES)
    axes = figure.add_subplot(xlabel=x_label, ylabel=y_label)
    if x_label == "epoch":
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure, axes


def _loss(history: History) -> Figure:
    figure, axes = _panel("epoch", "training loss")
    epochs = range(1, len(history) + 1)
    axes.plot(epochs, [epoch["loss"] for epoch in history], color=ESTIMATE_COLOUR, marker="o")
    return figure


def _errors(trained: Trained) -> Figure:
    history, compared = trained.history, trained.task.compared
    figure, axes = _panel("epoch", "beyond 1 px of disparity [%]")
    epochs = range(1, len(history) + 1)
    for of, dash in (("all", "solid"), ("reliable", (0, (3, 2)))):
        for prefix, colour in (("", ESTIMATE_COLOUR), (f"{compared}_", INK)):
            key = f"{prefix}{of}_beyond_1px"
            if key not in history[0]:
                continue
            share = [100 * epoch[key] for epoch in history]
            label = f"{f'by {compared}' if prefix else 'network'}, {of}"
            axes.plot(epochs, share, color=colour, linestyle=dash, label=label)
    axes.set_ylim(0)
    axes.legend()
    return figure


def _worth(tables: Mapping[str, Any]) -> Figure:
    figure, axes = _panel(
        "stated error of the least reliable point [px of disparity, or × scatter]",
        "points within 1 px [%]",
    )
    for name, table in tables.items():
        known, style = Precision.from_json(table), line_style(name)
        axes.plot(
            known.error_px, 100 * known.precision, color=style.colour, linestyle=style.dash,
            label=name,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.legend()
    return figure


def _sequences(manifest: Mapping[str, Any]) -> Grid:
    return grid(("scene", Head("sequences", direction="higher")), manifest["scenes"].items())


def _facts(manifest: Mapping[str, Any]) -> Grid:
    facts = {
        "licence": manifest["licence"],
        "code of the samples": manifest["code"],
        **{name: str(value) for name, value in manifest["training"].items()},
        **manifest["versions"],
    }
    return grid(("setting", "value"), [(name, str(value)) for name, value in facts.items()])
