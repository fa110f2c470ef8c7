"""Pictures of several results side by side: what the cameras saw, and every method's maps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from eventsweep.emvs.errors import InputError
from eventsweep.eval.figures.colormaps import Scale, depth_scale, error_scale, events_scale
from eventsweep.eval.figures.images import depth_image, point_size_px
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.compare.results import ComparedResult, Number
from eventsweep.eval.report.ranking import column
from eventsweep.eval.report.run_data import CaseData, MethodData, RunData, WindowData, load_run
from eventsweep.eval.report.run_page import (
    behind_uri,
    chosen_method,
    error_uri,
    errors_cm,
    events_uri,
    frame_uri,
    image_uri,
    middle_cap_cm,
    seconds,
    truth_uri,
)
from eventsweep.eval.results.table import POOLED

ALL = "all results"
_CAPTION = "mean_error"


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture: whose it is, what it says in numbers, and what shows faintly through it."""

    name: str
    note: str
    uri: str
    behind: str = ""


@dataclass(frozen=True, slots=True)
class PictureRow:
    """Pictures of one kind, all on one scale of colours."""

    title: str
    pictures: tuple[Picture, ...]
    scale: Scale | None = None

    @property
    def same(self) -> bool:
        """Whether one picture stands for all results."""
        return len(self.pictures) == 1 and self.pictures[0].name == ALL


@dataclass(frozen=True, slots=True)
class ComparedWindow:
    """One window: what is the same for all methods, and rows per method."""

    title: str
    seen: tuple[PictureRow, ...]
    methods: tuple[tuple[PictureRow, ...], ...]


@dataclass(frozen=True, slots=True)
class ComparedPictures:
    """All pictures of a case."""

    case: str
    methods: tuple[str, ...]
    chosen: int
    windows: tuple[ComparedWindow, ...]


@dataclass(frozen=True, slots=True)
class _View:
    """One result's window, and the numbers beside it."""

    result: ComparedResult
    case: str
    window: WindowData
    clock_us: int

    def method(self, name: str) -> MethodData:
        return next(method for method in self.window.methods if method.name == name)


def pictures_of(
    results: Sequence[ComparedResult], names: Iterable[str]
) -> tuple[tuple[ComparedPictures, ...], tuple[str, ...]]:
    """Draws all cases of which two results or more have maps; returns also why some are missing."""
    runs, missing = {}, []
    for result in results:
        try:
            runs[result.name] = _load(result)
        except InputError as error:
            missing.append(f"No pictures of {result.name}: {error}.")
    with_maps = [result for result in results if result.name in runs]
    drawn = (_case(case, with_maps, runs) for case in names) if len(with_maps) > 1 else ()
    return tuple(one for one in drawn if one is not None), tuple(missing)


def _load(result: ComparedResult) -> RunData:
    if result.is_suite:
        raise InputError("a suite keeps numbers, no depth maps")
    return load_run(result.folder)


def _case(
    case: str, results: Sequence[ComparedResult], runs: Mapping[str, RunData]
) -> ComparedPictures | None:
    found = [
        (result, one) for result in results for one in runs[result.name].cases if one.name == case
    ]
    if len(found) < 2:
        return None
    groups = _together(case, found)
    methods = _shared_methods(view for group in groups for view in group)
    if not methods:
        return None
    first = runs[results[0].name]
    chosen = chosen_method(first.rows_of(case, POOLED), first.ranking_metric, methods)
    drawn = tuple(_window(group, methods) for group in groups)
    return ComparedPictures(case, methods, chosen, drawn)


def _together(case: str, found: Sequence[tuple[ComparedResult, CaseData]]) -> list[list[_View]]:
    """Windows of one name and time; where there are none, the first ones."""
    first = found[0][1].windows
    groups = []
    for window in first:
        group = [
            _View(result, case, one, data.clock_us)
            for result, data in found
            for one in data.windows
            if (one.name, one.t_us) == (window.name, window.t_us)
        ]
        if len(group) == len(found):
            groups.append(group)
    return groups or [[_View(result, case, d.windows[0], d.clock_us) for result, d in found]]


def _shared_methods(views: Iterable[_View]) -> tuple[str, ...]:
    first, *others = ([method.name for method in view.window.methods] for view in views)
    return tuple(name for name in first if all(name in other for other in others))


def _window(views: Sequence[_View], methods: Sequence[str]) -> ComparedWindow:
    ranges = [view.window.depth_range_m for view in views]
    depth = depth_scale((min(near for near, _ in ranges), max(far for _, far in ranges)))
    error = error_scale(_error_cap(views, methods))
    times = dict.fromkeys(seconds(view.window.t_us - view.clock_us) for view in views)
    return ComparedWindow(
        f"Window {views[0].window.name}, reference view at {' and '.join(times)}",
        tuple(_seen(views, depth)),
        tuple(tuple(_of_method(views, name, depth, error)) for name in methods),
    )


def _error_cap(views: Sequence[_View], methods: Sequence[str]) -> float:
    return middle_cap_cm(
        errors_cm(view.method(name), view.window.truth)
        for view in views
        if view.window.truth is not None
        for name in methods
    )


def _seen(views: Sequence[_View], depth: Scale) -> Iterable[PictureRow]:
    """Frame, events and truth, each once where all results have the same."""
    scale = events_scale(1)
    draw: dict[str, tuple[Callable[[WindowData], str | None], Scale | None]] = {
        "Frame": (frame_uri, None),
        "Events": (partial(events_uri, scale=scale), scale),
        "True depth [m]": (partial(truth_uri, scale=depth), depth),
    }
    for title, (uri_of, of_scale) in draw.items():
        uris = ((view.result.name, uri_of(view.window)) for view in views)
        pictures = [Picture(name, "", uri) for name, uri in uris if uri is not None]
        if len(pictures) == len(views) and len({picture.uri for picture in pictures}) == 1:
            pictures = [Picture(ALL, "", pictures[0].uri)]
        if pictures:
            yield PictureRow(title, tuple(pictures), of_scale)


def _of_method(
    views: Sequence[_View], name: str, depth: Scale, error: Scale
) -> Iterable[PictureRow]:
    depths, errors = [], []
    for view in views:
        method, of = view.method(name), view.result.name
        points = f"{displayed(float(method.mask.sum()), 'px')} px"
        point_px = point_size_px(method.depth_m.shape[1])
        image = depth_image(method.depth_m, method.mask, depth, point_px)
        depths.append(Picture(of, points, image_uri(image)))
        if (uri := error_uri(method, view.window.truth, error)) is not None:
            behind = behind_uri(view.window) or ""
            errors.append(Picture(of, _number(view, name), uri, behind))
    yield PictureRow(f"Depth [m] of {name}", tuple(depths), depth)
    if errors:
        yield PictureRow(f"Error |e − g| [cm] of {name}", tuple(errors), error)


def _number(view: _View, method: str) -> str:
    values = view.result.first(view.case).values.get(Number(method, _CAPTION), {})
    value = values.get(view.window.name)
    if value is None:
        return ""
    head = column(_CAPTION)
    return f"{head.title} {displayed(value, 'm')} {head.unit}"
