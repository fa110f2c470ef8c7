"""The page of a folder of studies: each figure, its numbers, and where each method breaks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import TABLE_BYTES, inside, read_text
from eventsweep.emvs.utils.outputs import check_files
from eventsweep.eval.figures.colormaps import INK
from eventsweep.eval.figures.images import data_uri
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Block,
    Grid,
    GridCell,
    Head,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    files_in,
    grid,
    page_text,
    plural,
    provenance,
    tables,
    versions_grid,
    write_page,
)
from eventsweep.eval.report.ranking import column, definition, named_cell
from eventsweep.eval.studies.curves import BREAKS_AT, METRICS, RobustnessCurve
from eventsweep.eval.studies.run import StudyResult, values
from eventsweep.eval.studies.stored import find_studies, read_study

# A page's style does not reach into an image; the first patch is the ground of a study's figure.
_STYLE = (
    "<style>#patch_1 path { fill: none !important } svg { color: #1d2328 } "
    "@media (prefers-color-scheme: dark) { svg { color: #e4e7e9 } }</style>"
)


def write_study_report(folder: Path) -> Path:
    """Writes `report.html` for all studies of a folder and returns its path."""
    paths = find_studies(folder)
    if not paths:
        raise InputError(
            f"{folder}: not a study; `eventsweep study NAME --out {folder}` writes one"
        )
    check_files(folder, (REPORT_NAME,), force=True)
    studies = [read_study(path) for path in paths]
    figures = [_figure(path.with_suffix(".svg")) for path in paths]
    names = [f"{path.stem}{end}" for path in paths for end in (".json", ".csv", ".svg")]
    files = files_in(folder, names)
    page = page_text(study_page(studies, figures, files))
    return write_page(folder, page)


def study_page(studies: list[StudyResult], figures: list[str], files: tuple[str, ...]) -> Page:
    """What the page shows."""
    names = [study.about.name for study in studies]
    versions = versions_grid(names, [study.results.versions for study in studies])
    return Page(
        title=names[0] if len(names) == 1 else f"{len(names)} studies",
        subtitle="One property is perturbed by growing amounts: how each method's error grows.",
        blocks=(
            *(Text(_lead(study), "lead") for study in studies if study.breaking()),
            Sentences(tuple(_findings(studies))),
            _overview(studies),
        ),
        sections=(*map(_section, studies, figures, range(len(studies))), provenance(versions)),
        version=studies[0].results.versions.get("eventsweep", ""),
        files=files,
    )


def _lead(study: StudyResult) -> str:
    """At which amounts the methods break, the first to break first."""
    about, breaking = study.about, study.breaking()
    known = {name: amount for name, amount in breaking.items() if amount is not None}
    falls = about.amounts[-1] < about.amounts[0]
    parts = [
        f"at {known[name]:.3g} {about.unit} ({name})"
        for name in sorted(known, key=known.__getitem__, reverse=falls)
    ]
    if never := [name for name in breaking if name not in known]:
        parts.append(f"at no amount tried ({', '.join(never)})")
    grown = f"reaches {BREAKS_AT:g} times the unperturbed one"
    return f"{about.name}: the mean error {grown} {', '.join(parts)}."


def _findings(studies: list[StudyResult]) -> Iterator[str]:
    """Per study, who has the smallest error without and with the largest perturbation."""
    for study in studies:
        curves = {c.method: c.mean for c in study.curves if c.metric == METRICS[0]}
        ends = [_smallest({name: mean[k] for name, mean in curves.items()}) for k in (0, -1)]
        if not all(ends):
            continue
        least, most = (
            f"{amount:g} {study.about.unit}"
            for amount in (study.about.amounts[0], study.about.amounts[-1])
        )
        who = (
            f"{ends[0]} at {least} and at {most}"
            if ends[0] == ends[1]
            else (f"{ends[0]} at {least}, {ends[1]} at {most}")
        )
        yield f"{study.about.name}: smallest mean error: {who}."


def _smallest(values: dict[str, float]) -> str:
    known = {name: value for name, value in values.items() if math.isfinite(value)}
    return min(known, key=known.__getitem__) if known else ""


def _figure(path: Path) -> str:
    """The figure as an image, in which no script can run; empty where there is none."""
    if not path.is_file():
        return ""
    drawing = as_page(read_text(inside(path.parent, path.name), TABLE_BYTES))
    return data_uri("image/svg+xml", drawing.encode())


def as_page(drawing: str) -> str:
    """A study's SVG on the ground and in the ink of a page, light or dark as the reader has it.

    An older one, whose ink cannot be told from its other colours, stays as it is.
    """
    if INK not in drawing:
        return drawing
    head, tag, rest = drawing.partition("<svg")
    opening, rest = rest.split(">", 1)
    return f"{head}{tag}{opening}>{_STYLE}{rest.replace(INK, 'currentColor')}"


def _overview(studies: list[StudyResult]) -> Grid:
    methods = list(dict.fromkeys(method for study in studies for method in study.breaking()))
    lines = (
        (s.about.name, s.about.unit, *(_breaking(s, method) for method in methods)) for s in studies
    )
    about = (
        "Where each method breaks: the amount, in the unit of its row, at which its mean error "
        f"reaches {BREAKS_AT:g} times the unperturbed one. “never” means not within the amounts "
        "tried."
    )
    return grid(map(Head, ("study", "unit", *methods)), lines, about)


def _breaking(study: StudyResult, method: str) -> GridCell:
    if method not in study.breaking():
        return GridCell("–")
    amount = study.breaking()[method]
    return GridCell("never", kind="other") if amount is None else GridCell(f"{amount:.3g}", amount)


def _section(study: StudyResult, figure: str, position: int) -> Section:
    metrics = list(dict.fromkeys(curve.metric for curve in study.curves))
    axis, seeds = study.about.axis, plural(len(study.results.seeds), "seed")
    first = f"{study.about.amounts[0]:g} {study.about.unit}"
    about = (
        f"{axis[:1].upper()}{axis[1:]}, in {study.about.unit}. Lines: means over "
        f"{', '.join(study.about.cases)} and {seeds}. Bands, and ± in the tables: the 95 % "
        f"interval of the change from {first}, paired by case and seed; it needs several seeds, "
        f"and a band as wide as its panel is not drawn. Where it leaves out the value at {first}, "
        "the change is significant. A cross: the method breaks, its mean error is "
        f"{BREAKS_AT:g} times the first."
    )
    failures = tuple(f"{job}: {why}" for job, why in study.failures.items())
    blocks: list[Block] = [Text(about), Sentences(failures, "failures")]
    if figure:
        blocks.append(Plot(figure, f"{study.about.name}: curves per method"))
    name, titles = f"study{position}", [column(metric).title for metric in metrics]
    shown = [_grid(study, metric) for metric in metrics]
    if (growth := _growth(study)) is not None:
        titles.append("growth of the mean error")
        shown.append(growth)
    grids = tables(name, titles, shown)
    return Section(name, study.about.name, (*blocks, *grids))


def _grid(study: StudyResult, metric: str) -> Grid:
    measured = column(metric)
    heads = (
        Head("method"),
        *(measured.head(f"{a:g} {study.about.unit}") for a in study.about.amounts),
    )
    lines = (_line(curve) for curve in study.curves if curve.metric == metric)
    return grid(heads, lines, f"{definition(metric)} One column per amount.")


def _growth(study: StudyResult) -> Grid | None:
    """The mean error over the unperturbed one, sample by sample: medians and ranges.

    None where no sample has both.
    """
    rows = values(study.results)
    rows = rows[rows["metric"] == METRICS[0]]
    if rows.empty:
        return None
    keys = ["method", "case", "seed"]
    wide = rows.pivot_table(index=keys, columns="amount", values="value", aggfunc="first")
    amounts = [amount for amount in study.about.amounts if amount in wide]
    if study.about.amounts[0] not in amounts:
        return None
    ratios = wide[amounts].div(wide[study.about.amounts[0]], axis=0).groupby(level="method")
    parts = [part.to_dict("index") for part in (ratios.median(), ratios.min(), ratios.max())]
    methods = dict.fromkeys(curve.method for curve in study.curves)
    lines = (
        (named_cell(name), *(_ratio(*(float(part[name][a]) for part in parts)) for a in amounts))
        for name in methods
        if name in parts[0]
    )
    heads = (Head("method"), *(Head(f"{a:g} {study.about.unit}", "×") for a in amounts))
    about = (
        "Each case and seed over its own unperturbed mean error: the median, and in brackets the "
        "smallest and the largest."
    )
    return grid(heads, lines, about)


def _ratio(middle: float, low: float, high: float) -> GridCell:
    if math.isnan(middle):
        return GridCell("–")
    return GridCell(f"{middle:.2f} ({low:.2f}–{high:.2f})", middle)


def _line(curve: RobustnessCurve) -> tuple[GridCell, ...]:
    cells = [named_cell(curve.method)]
    for mean, low, high in zip(curve.mean, curve.low, curve.high, strict=True):
        half = (high - low) / 2
        band = "" if math.isnan(mean + half) else f" ± {displayed(half, curve.unit)}"
        cells.append(GridCell(displayed(mean, curve.unit) + band, mean))
    return tuple(cells)
