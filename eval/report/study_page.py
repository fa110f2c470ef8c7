"""The page of a folder of studies: each figure, its numbers, and where each method breaks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import TABLE_BYTES, inside, parse_json, read_text
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
from eventsweep.eval.scoring.results import Value, read_json
from eventsweep.eval.studies.curves import BREAKS_AT, METRICS

# A page's style does not reach into an image; the first patch is the ground of a study's figure.
_STYLE = (
    "<style>#patch_1 path { fill: none !important } svg { color: #1d2328 } "
    "@media (prefers-color-scheme: dark) { svg { color: #e4e7e9 } }</style>"
)


class StudyCurve(BaseModel):
    """One metric of one method over the amounts, as `eventsweep study` wrote it."""

    model_config = ConfigDict(frozen=True)

    method: str
    metric: str
    unit: str
    mean: tuple[Value, ...]
    low: tuple[Value, ...]
    high: tuple[Value, ...]


class StoredStudy(BaseModel):
    """A study's JSON file; what the page does not show is not looked at."""

    model_config = ConfigDict(frozen=True)

    study: str
    axis: str
    unit: str
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    amounts: tuple[float, ...]
    breaks_at: dict[str, float | None]
    curves: tuple[StudyCurve, ...]
    failures: dict[str, str]
    versions: dict[str, str]


def find_studies(folder: Path) -> list[Path]:
    """The studies' JSON files in a folder."""
    return [path for path in sorted(folder.glob("*.json")) if _is_study(path)]


def _is_study(path: Path) -> bool:
    try:
        content = parse_json(read_text(path, TABLE_BYTES))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and {"study", "breaks_at"} <= content.keys()


def read_study(path: Path) -> StoredStudy:
    """Reads a study's JSON file."""
    study = read_json(path, StoredStudy.model_validate, (), "run the study again")
    wrong = next((c for c in study.curves if len(c.mean) != len(study.amounts)), None)
    if wrong is not None:
        raise InputError(
            f"{path}: {wrong.method} {wrong.metric} has {len(wrong.mean)} values for "
            f"{len(study.amounts)} amounts; run the study again"
        )
    return study


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


def study_page(studies: list[StoredStudy], figures: list[str], files: tuple[str, ...]) -> Page:
    """What the page shows."""
    names = [study.study for study in studies]
    versions = versions_grid(names, [study.versions for study in studies])
    return Page(
        title=names[0] if len(names) == 1 else f"{len(names)} studies",
        subtitle="One property is perturbed by growing amounts: how each method's error grows.",
        blocks=(Sentences(tuple(_findings(studies))), _overview(studies)),
        sections=(*map(_section, studies, figures, range(len(studies))), provenance(versions)),
        version=studies[0].versions.get("eventsweep", ""),
        files=files,
    )


def _findings(studies: list[StoredStudy]) -> Iterator[str]:
    """Per study, who has the smallest error without and with the largest perturbation."""
    for study in studies:
        curves = {c.method: c.mean for c in study.curves if c.metric == METRICS[0]}
        ends = [_smallest({name: mean[k] for name, mean in curves.items()}) for k in (0, -1)]
        if not all(ends):
            continue
        least, most = (
            f"{amount:g} {study.unit}" for amount in (study.amounts[0], study.amounts[-1])
        )
        who = (
            f"{ends[0]} at {least} and at {most}"
            if ends[0] == ends[1]
            else (f"{ends[0]} at {least}, {ends[1]} at {most}")
        )
        yield f"{study.study}: smallest mean error: {who}."


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


def _overview(studies: list[StoredStudy]) -> Grid:
    methods = list(dict.fromkeys(method for study in studies for method in study.breaks_at))
    lines = ((s.study, s.unit, *(_breaking(s, method) for method in methods)) for s in studies)
    about = (
        "Where each method breaks: the amount, in the unit of its row, at which its mean error "
        f"reaches {BREAKS_AT:g} times the unperturbed one. “never” means not within the amounts "
        "tried."
    )
    return grid(map(Head, ("study", "unit", *methods)), lines, about)


def _breaking(study: StoredStudy, method: str) -> GridCell:
    if method not in study.breaks_at:
        return GridCell("–")
    amount = study.breaks_at[method]
    return GridCell("never", kind="other") if amount is None else GridCell(f"{amount:.3g}", amount)


def _section(study: StoredStudy, figure: str, position: int) -> Section:
    metrics = list(dict.fromkeys(curve.metric for curve in study.curves))
    about = (
        f"{study.axis[:1].upper()}{study.axis[1:]}, in {study.unit}. Means over "
        f"{', '.join(study.cases)} and {plural(len(study.seeds), 'seed')}; ± is half of the 95 % "
        "band, which needs several seeds."
    )
    failures = tuple(f"{job}: {why}" for job, why in study.failures.items())
    blocks: list[Block] = [Text(about), Sentences(failures, "failures")]
    if figure:
        blocks.append(Plot(figure, f"{study.study}: curves per method"))
    name, titles = f"study{position}", [column(metric).title for metric in metrics]
    grids = tables(name, titles, [_grid(study, metric) for metric in metrics])
    return Section(name, study.study, (*blocks, *grids))


def _grid(study: StoredStudy, metric: str) -> Grid:
    measured = column(metric)
    heads = (Head("method"), *(measured.head(f"{a:g} {study.unit}") for a in study.amounts))
    lines = (_line(curve) for curve in study.curves if curve.metric == metric)
    return grid(heads, lines, f"{definition(metric)} One column per amount.")


def _line(curve: StudyCurve) -> tuple[GridCell, ...]:
    cells = [named_cell(curve.method)]
    for mean, low, high in zip(curve.mean, curve.low, curve.high, strict=True):
        half = (high - low) / 2
        band = "" if math.isnan(mean + half) else f" ± {displayed(half, curve.unit)}"
        cells.append(GridCell(displayed(mean, curve.unit) + band, mean))
    return tuple(cells)
