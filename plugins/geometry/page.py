"""The page of scored geometries: numbers side by side, and where each is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from collections.abc import Sequence as Several
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry import se3
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import svg
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.html import (
    Grid,
    GridCell,
    Head,
    Page,
    Plot,
    Section,
    Sentences,
    Text,
    grid,
    made_here,
)
from eventsweep.eval.report.ranking import column, named_cell, value_cell
from eventsweep.eval.results.direction import best
from eventsweep.eval.results.results import Results
from eventsweep.eval.scoring.method_scores import Score, full_name
from eventsweep.eval.scoring.metrics import GEOMETRY_METRICS, SURFACES
from eventsweep.plugins.geometry.readers import Geometry
from eventsweep.plugins.geometry.score import GeometryScore, classes
from eventsweep.plugins.geometry.surfels import Surfels

Floats = NDArray[np.float64]
OVERVIEW = (
    "accuracy", "accuracy_median", "completion", "completion_median", "chamfer",
    "surface_precision_2cm", "surface_recall_2cm", "surface_f1_2cm", "surface_f1_5cm",
)  # fmt: skip
_OF_CLASSES = (
    "accuracy", "completion", "surface_precision_5cm", "surface_recall_5cm", "surface_f1_5cm",
)  # fmt: skip
_WORST_M = 0.10  # what has the last colour
_BINS = 160  # of a map's longer side
_BEHIND = 0.03  # of the depth: what lies farther is hidden by what the camera saw

SHOWN = (
    "accuracy", "completion", "surface_precision_5cm", "surface_recall_5cm", "surface_f1_5cm",
)  # fmt: skip
OF_CLASSES = ("accuracy", "surface_precision_5cm", "surface_recall_5cm", "surface_f1_5cm")
_ARROWS = {"lower": "↓", "higher": "↑", "none": ""}
Lines = list[list[str]]


@dataclass(frozen=True, eq=False)
class ScoredGeometry:
    """A geometry, its distances from the truth, and its scores by metric."""

    geometry: Geometry
    found: GeometryScore
    scores: Mapping[str, Score]


@dataclass(frozen=True, eq=False)
class WrittenGeometries:
    """Scores of geometries of one case, and how they came about."""

    case: str
    results: Results
    scored: tuple[ScoredGeometry, ...]
    how: str

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the numbers must know."""
        return tuple(
            f"{one.geometry.name}: {note}" for one in self.scored for note in one.found.notes
        )

    def tables(self) -> Iterator[tuple[str, list[str], Lines]]:
        """Title, headings and lines: of all surfaces, then by class."""
        heads = [_heading(name) for name in SHOWN]
        lines = [[one.geometry.name, *_cells(one, SHOWN, "all")] for one in self.scored]
        yield f"{self.case}, all surfaces", ["geometry", *heads], lines
        for one in self.scored:
            heads = [_heading(name) for name in OF_CLASSES]
            lines = [[name, *_cells(one, OF_CLASSES, name)] for name in SURFACES]
            yield f"{one.geometry.name}, by class of surface", ["surfaces", *heads], lines


def geometry_page(
    written: WrittenGeometries, sequence: Sequence, truth: Surfels, command: str,
    files: tuple[str, ...],
) -> Page:  # fmt: skip
    """What the page shows."""
    sections = [_pictures(k, one, sequence, truth) for k, one in enumerate(written.scored)]
    return Page(
        title=f"Geometry of {written.case}",
        subtitle=written.how,
        blocks=(
            *(Text(_lead(one), "lead") for one in written.scored),
            Sentences(written.notes, "note"),
            _overview(written),
        ),
        sections=(
            *sections,
            *(_by_class(k, one, truth) for k, one in enumerate(written.scored)),
            Section("metrics", "All metrics", (_metrics(written),)),
            made_here(command),
        ),
        files=files,
    )


def _lead(one: ScoredGeometry) -> str:
    """How far it is from the truth, how far the truth from it, and how much of both is near."""
    said = (
        f"{column(name).title} {displayed(one.scores[name].value, one.scores[name].unit)} "
        f"{column(name).unit}"
        for name in ("accuracy", "completion", "surface_f1_5cm")
    )
    return f"{one.geometry.name}: {', '.join(said)}."


def _overview(written: WrittenGeometries) -> Grid:
    heads = [column(name) for name in OVERVIEW]
    lines = (
        (named_cell(one.geometry.name), *(_cell(written, one, name) for name in OVERVIEW))
        for one in written.scored
    )
    return grid((Head("geometry"), *(head.head() for head in heads)), lines)


def _metrics(written: WrittenGeometries) -> Grid:
    heads = [column(name) for name in GEOMETRY_METRICS]
    lines = (
        (head.title, head.unit, *(_cell(written, one, head.name) for one in written.scored),
         head.formula)
        for head in heads
    )  # fmt: skip
    about = (
        "a is the distance of a point of the geometry from the nearest true surface, c that of a "
        "true point from the nearest point of the geometry."
    )
    names = (Head(one.geometry.name) for one in written.scored)
    return grid(("metric", "unit", *names, "what it is"), lines, about)


def _cell(written: WrittenGeometries, one: ScoredGeometry, name: str) -> GridCell:
    rows = [each.scores[name] for each in written.scored]
    top = best((row.value for row in rows), rows[0].direction) if len(rows) > 1 else math.nan
    return value_cell(one.scores[name].value, one.scores[name].unit, top)


def _by_class(k: int, one: ScoredGeometry, truth: Surfels) -> Section:
    heads = [column(name).head() for name in _OF_CLASSES]
    counts = {name: int(chosen.sum()) for name, chosen in classes(truth).items()}
    lines = (
        (name, counts[name], *(_of_class(one, metric, name) for metric in _OF_CLASSES), about)
        for name, about in SURFACES.items()
    )
    table = grid(("surfaces", "true points", *heads, "what they are"), lines)
    return Section(f"classes-{k}", f"{one.geometry.name} by class of surface", (table,))


def _of_class(one: ScoredGeometry, metric: str, name: str) -> GridCell:
    score = one.scores[full_name(metric, name)]
    return value_cell(score.value, score.unit, math.nan)


def _pictures(k: int, one: ScoredGeometry, sequence: Sequence, truth: Surfels) -> Section:
    maps = (
        ("Where it is wrong", one.found.points, one.found.to_truth_m,
         "Mean distance of its points from the nearest true surface."),
        ("Where it is incomplete", truth.points_world, one.found.to_points_m,
         "Mean distance of true points from its nearest point."),
    )  # fmt: skip
    about = (
        "Seen from above, from the side, and by camera 0 in the middle of the sequence. Colours "
        "are distances from 0 (blue) to 10 cm and more (dark red); the world's axes are in metres."
    )
    drawings = (
        (Text(f"{title}. {text}", head=""), Plot(svg(_maps, points, away, sequence), title))
        for title, points, away, text in maps
    )
    blocks = (block for pair in drawings for block in pair)
    return Section(f"maps-{k}", f"{one.geometry.name}: where it is wrong", (Text(about), *blocks))


def _maps(points: Floats, away_m: Floats, sequence: Sequence) -> Figure:
    """Three views of points, coloured by distance."""
    figure = LaidOutFigure(figsize=(11, 3.6))
    above, side, camera = figure.subplots(1, 3)
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    for axes, (h, v), title in ((above, (0, 1), "from above"), (side, (0, 2), "from the side")):
        bounds = (*_padded(low[h], high[h]), *_padded(low[v], high[v]))
        image = _mean_image(points[:, h], points[:, v], away_m, bounds)
        _show(axes, image[::-1], bounds, title)
        axes.set_xlabel(f"{'xyz'[h]}, m")
        axes.set_ylabel(f"{'xyz'[v]}, m")
    uv_px, seen, size = _seen(points, sequence)
    bounds = (-0.5, size[0] - 0.5, -0.5, size[1] - 0.5)
    image = _mean_image(uv_px[:, 0], uv_px[:, 1], away_m[seen], bounds)
    shown = _show(camera, image[::-1], bounds, "from camera 0")
    camera.invert_yaxis()
    camera.set_xlabel("column, px")
    camera.set_ylabel("row, px")
    figure.colorbar(shown, ax=[above, side, camera], label="distance, cm", extend="max")
    return figure


def _padded(low: float, high: float) -> tuple[float, float]:
    pad = max(0.02 * (high - low), 0.01)
    return float(low - pad), float(high + pad)


def _show(
    axes: Axes, image: Floats, bounds: tuple[float, float, float, float], title: str
) -> AxesImage:
    axes.set_title(title)
    return axes.imshow(
        100 * image, extent=bounds, vmin=0, vmax=100 * _WORST_M, cmap="turbo",
        interpolation="nearest", aspect="equal",
    )  # fmt: skip


def _mean_image(
    x: Floats, y: Floats, away_m: Floats, bounds: tuple[float, float, float, float]
) -> Floats:
    """(rows, columns) mean distances, m, rows along y; NaN where there is no point."""
    x0, x1, y0, y1 = bounds
    step = max(x1 - x0, y1 - y0) / _BINS
    columns, rows = (max(1, math.ceil((b - a) / step - 1e-9)) for a, b in ((x0, x1), (y0, y1)))
    column, row = (
        np.floor((at - low) / (high - low) * count)
        for at, low, high, count in ((x, x0, x1, columns), (y, y0, y1, rows))
    )
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    place = (row[inside] * columns + column[inside]).astype(np.int64)
    total = np.bincount(place, np.minimum(away_m[inside], _WORST_M), rows * columns)
    count = np.bincount(place, minlength=rows * columns)
    with np.errstate(invalid="ignore"):
        return (total / np.where(count, count, np.nan)).reshape(rows, columns)


def _seen(points: Floats, sequence: Sequence) -> tuple[Floats, NDArray[np.int64], tuple[int, int]]:
    """Where camera 0 sees points in the middle of the sequence, which ones, and its size, px."""
    times_us = sequence.truth_times_us(0)
    t_us, camera = int(times_us[len(times_us) // 2]), sequence.rig.cameras[0]
    T_world_cam = sequence.trajectory.at([t_us])[0] @ sequence.rig.T_body_cam[0]
    depth_m = sequence.truth_depth_m(0, t_us)
    points_cam = se3.transform(se3.inverse(T_world_cam), points)
    uv_px = camera.project(points_cam)
    with np.errstate(invalid="ignore"):
        place = np.rint(uv_px)
        inside = (place >= 0).all(axis=1)
        inside &= (place < (camera.width_px, camera.height_px)).all(axis=1)
    chosen = np.flatnonzero(inside)
    column, row = place[chosen].astype(np.int64).T
    open_to = points_cam[chosen, 2] < (1 + _BEHIND) * depth_m[row, column]
    return uv_px[chosen[open_to]], chosen[open_to], (camera.width_px, camera.height_px)


def _heading(name: str) -> str:
    head = column(name)
    return f">{head.title.removeprefix('surface ')} {_ARROWS[head.direction]}\n{head.unit}"


def _cells(one: ScoredGeometry, names: Several[str], region: str) -> list[str]:
    found = [one.scores[full_name(name, region)] for name in names]
    return [displayed(score.value, score.unit) for score in found]
