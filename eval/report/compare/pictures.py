"""Pictures of several results side by side: what the cameras saw, and every method's maps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from eventsweep.emvs.errors import InputError
from eventsweep.eval.figures.colormaps import Scale, depth_scale, error_scale, events_scale
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.compare.results import ComparedResult, Number
from eventsweep.eval.report.html import (
    Block,
    Choice,
    Details,
    Layer,
    Of,
    Picture,
    Pictures,
    Section,
    Text,
)
from eventsweep.eval.report.ranking import column
from eventsweep.eval.report.run_data import (
    CaseData,
    MethodData,
    RunData,
    WindowData,
    best_first,
    load_run,
)
from eventsweep.eval.report.window_page import (
    behind_uri,
    image_uri,
    middle_cap_cm,
    seconds,
)
from eventsweep.eval.results.table import POOLED

_CAPTION = "mean_error"
_MOST_COLUMNS = 3
_SCALES = "Pictures of one kind have one scale of colours, so that equal colours are equal numbers."


@dataclass(frozen=True, slots=True)
class _View:
    """One result's window, and the numbers beside it."""

    result: ComparedResult
    case: CaseData
    window: WindowData

    def method(self, name: str) -> MethodData:
        return next(method for method in self.window.methods if method.name == name)

    def mean_error(self, method: str) -> str:
        """Its mean error in this window, behind a dot; empty where it was not scored."""
        values = self.result.first(self.case.name).values.get(Number(method, _CAPTION), {})
        value = values.get(self.window.name)
        head = column(_CAPTION)
        return "" if value is None else f" · {head.title} {displayed(value, 'm')} {head.unit}"


def picture_sections(
    results: Sequence[ComparedResult], names: Iterable[str]
) -> tuple[list[Section], list[str]]:
    """Draws all cases of which two results or more have maps; returns also why some are missing."""
    runs: dict[str, RunData] = {}
    missing = []
    for result in results:
        try:
            if result.is_suite:
                raise InputError("a suite keeps numbers, no depth maps")
            runs[result.name] = load_run(result.folder)
        except InputError as error:
            missing.append(f"No pictures of {result.name}: {error}.")
    with_maps = [result for result in results if result.name in runs]
    sections: list[Section] = []
    for case in names:
        name = f"pictures{len(sections)}"
        if (choice := _choice(f"{name}-method", case, with_maps, runs)) is not None:
            blocks = Text(_SCALES, "note"), choice
            sections.append(Section(name, f"Pictures of {case}", blocks))
    return sections, missing


def _choice(
    name: str, case: str, results: Sequence[ComparedResult], runs: Mapping[str, RunData]
) -> Choice | None:
    """Windows of a case, and a choice between the methods that all of its results have."""
    shown = [(r, data) for r in results for data in runs[r.name].cases if data.name == case]
    if len(shown) < 2:
        return None
    groups = _together(shown)
    names = [[method.name for method in view.window.methods] for view in groups[0]]
    shared = [method for method in names[0] if all(method in others for others in names[1:])]
    if not shared:
        return None
    first = runs[shown[0][0].name]
    methods = best_first(first.rows_of(case, POOLED), first.ranking_metric, shared)
    windows = (_window(group, methods, is_open=k == 0) for k, group in enumerate(groups))
    return Choice(name, "Method", tuple(methods), tuple(windows))


def _together(shown: Sequence[tuple[ComparedResult, CaseData]]) -> list[list[_View]]:
    """Windows of one name and time; where there are none, the first ones."""
    groups = []
    for window in shown[0][1].windows:
        group = [
            _View(result, data, other)
            for result, data in shown
            for other in data.windows
            if (other.name, other.t_us) == (window.name, window.t_us)
        ]
        if len(group) == len(shown):
            groups.append(group)
    return groups or [[_View(result, data, data.windows[0]) for result, data in shown]]


def _window(views: Sequence[_View], methods: Sequence[str], *, is_open: bool) -> Details:
    ranges = [view.window.depth_range_m for view in views]
    depth = depth_scale((min(near for near, _ in ranges), max(far for _, far in ranges)))
    times = dict.fromkeys(seconds(view.window.t_us - view.case.clock_us) for view in views)
    title = f"Window {views[0].window.name}, reference view at {' and '.join(times)}"
    error = error_scale(middle_cap_cm(
        view.method(name).errors_cm(view.window.truth)
        for view in views
        if view.window.truth is not None
        for name in methods
    ))  # fmt: skip
    maps = (Of(k, tuple(_maps(views, name, depth, error))) for k, name in enumerate(methods))
    return Details(title, (*_seen(views, depth), *maps), is_open)


def _seen(views: Sequence[_View], depth: Scale) -> Iterator[Block]:
    """Frame, events and truth: what is the same for all results once and first."""
    events = events_scale(1)
    scales: dict[str, Scale | None] = {"Frame": None, "Events": events, "True depth": depth}
    seen = [(view.result.name, view.window.images(depth, events)) for view in views]
    same, rows = [], []
    for kind, scale in scales.items():
        known = [(name, image_uri(images[kind])) for name, images in seen if kind in images]
        title = kind if kind != "True depth" else "True depth [m]"
        if len(known) == len(views) and len({uri for _, uri in known}) == 1:
            same.append(Picture("all results", (Layer(known[0][1], title),), scale))
        elif known:
            rows.append(_row(Picture(name, (Layer(uri, title),), scale) for name, uri in known))
    yield from (Pictures(tuple(same), _MOST_COLUMNS), *rows)


def _maps(views: Sequence[_View], name: str, depth: Scale, error: Scale) -> Iterator[Block]:
    """A method's depth and its errors, each of all results."""
    depths, errors = [], []
    for view in views:
        method, result = view.method(name), view.result.name
        points = f"{displayed(float(method.mask.sum()), 'px')} px"
        about = f"Depth [m] of {name} · {points}"
        depths.append(Picture(result, (Layer(image_uri(method.depth_image(depth)), about),), depth))
        if (truth := view.window.truth) is not None:
            about = f"Error |e − g| [cm] of {name}{view.mean_error(name)}"
            layer = Layer(image_uri(method.error_image(truth, error)), about)
            errors.append(Picture(result, (layer,), error, behind_uri(view.window)))
    yield _row(depths)
    yield _row(errors)


def _row(pictures: Iterable[Picture]) -> Pictures:
    row = tuple(pictures)
    return Pictures(row, min(len(row), _MOST_COLUMNS))
