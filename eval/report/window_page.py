"""A window on a page: what the cameras saw, and every method's depth, confidence and errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.dsi.method import OWN_UNIT, VOTES
from eventsweep.emvs.methods import named
from eventsweep.eval.figures.colormaps import (
    Scale,
    confidence_scale,
    depth_scale,
    error_scale,
    events_scale,
)
from eventsweep.eval.figures.images import (
    IndexedImage,
    behind_image,
    categories_image,
    confidence_image,
    enlargement,
    error_cap_cm,
    error_of,
    expected_error_image,
    photo_image,
)
from eventsweep.eval.figures.plots import CAUSE_COLOURS, SliceFigures, svg
from eventsweep.eval.numbers import displayed
from eventsweep.eval.report.html import (
    Block,
    Head,
    Layer,
    Of,
    Picture,
    Pictures,
    Plot,
    Text,
    Viewer,
    grid,
)
from eventsweep.eval.report.ranking import column, with_unit
from eventsweep.eval.report.run_data import MethodData, WindowData
from eventsweep.eval.report.viewer import window_json
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import Truth

_CAPTION = ("points", "completeness", "mean_error", "median_error", "bad_published")
_BUSY_PERCENT = 99.7
"""Of the pixels this share lies within a scale of confidence."""
COLUMNS = 3
"""Of pictures of a window."""


def window_blocks(
    window: WindowData, methods: Sequence[str], rows: pd.DataFrame
) -> tuple[Block, ...]:
    """What a page shows of one window, as options of a choice between the methods.

    Args:
        window: what is shown.
        methods: the options.
        rows: the scores of this window.
    """
    depth = depth_scale(window.shown_range_m)
    error = error_scale(_error_cap_cm(window))
    options = {method.name: methods.index(method.name) for method in window.methods}
    data = window_json(window, methods, error, depth)
    pictures = Pictures(tuple(_pictures(window, options, depth, error)), COLUMNS)
    has_truth = window.truth is not None
    return (
        *(Of(options[method.name], (_caption(method, rows),)) for method in window.methods),
        Viewer(pictures, data, window.camera is not None, has_truth),
        *_slices(window, options),
        *_counts(window),
    )


def _caption(method: MethodData, rows: pd.DataFrame) -> Text:
    own = {row.metric: row for row in each(rows[rows["method"] == method.name])}
    numbers = [f"{column(name).title} {with_unit(own[name])}" for name in _CAPTION if name in own]
    numbers = numbers or [f"points {displayed(float(method.mask.sum()), 'px')} px"]
    return Text(" · ".join(["", *numbers]), "caption", method.name)


def _pictures(
    window: WindowData, options: dict[str, int], depth: Scale, error: Scale
) -> Iterator[Picture]:
    """Those of the cameras, and of every method; what is not known is left out."""

    def layers(draw: Callable[[MethodData], Layer]) -> tuple[Layer, ...]:
        return tuple(replace(draw(m), of=options[m.name]) for m in window.methods)

    truth, events = window.truth, events_scale(events_cap(window))
    seen = {name: image_uri(image) for name, image in window.images(depth, events).items()}
    if "Frame" in seen:
        yield Picture("Frame", (Layer(seen["Frame"], "camera 0"),))
    if window.photo is not None:
        yield Picture("Ordinary camera", (_photo(window.photo, window.t_us),))
    if "Events" in seen:
        yield Picture("Events", (Layer(seen["Events"], window.events_caption),), events)
    units = {confidence_unit(method.name) for method in window.methods if method.is_sure}
    shared = f" [{units.pop()}]" if len(units) == 1 else ""
    sure = _confidence_scales(window)
    confidences = layers(lambda m: _confidence(m, sure[m.name], has_unit=bool(shared)))
    yield Picture(f"Confidence{shared}", confidences)
    behind = behind_uri(window) or seen.get("True depth", "")
    if truth is not None:
        yield Picture("Ground truth", (Layer(seen["True depth"], "depth [m]"),), depth)
    depths = layers(lambda m: Layer(image_uri(m.depth_image(depth)), m.name))
    yield Picture("Depth [m]", depths, depth)
    if truth is not None:
        errors = layers(lambda m: Layer(image_uri(m.error_image(truth, error)), m.name))
        yield Picture("Error |e − g| [cm]", errors, error, behind)
    if any(method.causes is not None for method in window.methods):
        yield Picture("Cause of the error", layers(_causes), behind=behind)
    if any(method.error_m is not None for method in window.methods):
        yield Picture("Expected error [cm]", layers(lambda m: _expected(m, truth, error)))


def _photo(photo: Photo, t_us: int) -> Layer:
    """An ordinary camera's picture as its display shows it, and what of it says nothing."""
    exposure = f"{(photo.end_us - photo.start_us) / 1000:g} ms exposure"
    off_us = photo.t_us - t_us
    about = exposure + (f", {off_us / 1000:+.0f} ms" if off_us else "")
    note = f"{_share(photo.white)} of the pixels white, {_share(photo.black)} black"
    return Layer(image_uri(photo_image(photo.image)), about, note=note)


def _share(value: float) -> str:
    return "none" if value == 0 else f"{100 * value:.1f} %" if value >= 5e-4 else "< 0.1 %"


def _confidence(method: MethodData, scale: Scale, *, has_unit: bool) -> Layer:
    """With its unit where the heading has none."""
    if not method.is_sure:
        return Layer("", method.name, note=f"{method.name} does not say how sure it is.")
    about = method.name if has_unit else f"{method.name} [{confidence_unit(method.name)}]"
    return Layer(image_uri(confidence_image(method.confidence, scale)), about, scale=scale)


def confidence_unit(method: str) -> str:
    """What a method says that its confidence is, or `own unit`."""
    known = named(method)
    return known.confidence if known is not None else OWN_UNIT


def _confidence_scales(window: WindowData) -> dict[str, Scale]:
    """Scale of confidence by method: one for all that count votes, one each for the others."""
    finite = {m.name: m.confidence[np.isfinite(m.confidence)] for m in window.methods}
    by_votes = [name for name in finite if confidence_unit(name) == VOTES]
    shared = max((_busy(finite[name]) for name in by_votes), default=1.0)
    # Others report few pixels; all the rest of their picture is 0.
    tops = {n: shared if n in by_votes else _busy(v[v > 0]) for n, v in finite.items()}
    return {name: confidence_scale(float(f"{top:.2g}")) for name, top in tops.items()}


def _busy(values: NDArray[np.floating]) -> float:
    return float(np.percentile(values, _BUSY_PERCENT)) if values.size else 0.0


def _causes(method: MethodData) -> Layer:
    """Bad pixels by cause; the shares of the causes that occur are the legend."""
    if method.causes is None:
        return Layer("", method.name)
    counts = np.bincount(method.causes.ravel(), minlength=1 + len(CAUSES))[1:].tolist()
    total = max(1, sum(counts))
    legend = tuple(
        (colour, f"{cause.replace('_', ' ')} {100 * count / total:.0f} %")
        for (cause, colour), count in zip(CAUSE_COLOURS.items(), counts, strict=True)
        if count
    )
    image = categories_image(method.causes, list(CAUSE_COLOURS.values()), method.point_px)
    note = "" if legend else "no point is off by more than a tenth"
    return Layer(image_uri(image), method.name, legend=legend, note=note)


def _expected(method: MethodData, truth: Truth | None, scale: Scale) -> Layer:
    """The stated error, and how many errors lie within the stated band, where truth can tell."""
    if method.error_m is None:
        return Layer("", method.name, note=f"{method.name} is not calibrated.")
    note = "Half-width of the band that should hold 68 % of the errors."
    if truth is not None:
        error_cm, both = error_of(method.depth_m, method.mask, truth.depth_m, truth.scored)
        if both.any():
            inside = np.mean(error_cm[both] <= 100 * method.error_m[both])
            note += f" {100 * inside:.0f} % of the errors lie within."
    image = expected_error_image(method.error_m, method.mask, scale, method.point_px)
    return Layer(image_uri(image), method.name, scale=scale, note=note)


def _slices(window: WindowData, options: dict[str, int]) -> Iterator[Block]:
    """A row of each method's DSI; nothing where none was kept."""
    if all(method.dsi_slice is None for method in window.methods):
        return
    yield Text("A slice of the DSI", "heading")
    yield Text(
        "Ray density along one image row, seen from above with the camera below: where rays meet, "
        "the map finds its depth.",
        "note",
    )
    draw = SliceFigures()
    for method in window.methods:
        shown: Block = Text("This method has none.", "note")
        if method.dsi_slice is not None:
            shown = Plot(svg(draw, method.dsi_slice), f"slice of the DSI of {method.name}")
        yield Of(options[method.name], (shown,))


def _counts(window: WindowData) -> Iterator[Block]:
    """Events of each camera by outcome; nothing where they were not counted."""
    if not window.counts:
        return
    names = dict.fromkeys(name for counts in window.counts.values() for name in counts)
    lines = (
        (camera, *(of.get(name, "–") for name in names)) for camera, of in window.counts.items()
    )
    yield Text("Event statistics", "heading")
    yield grid(("camera", *(Head(name, direction="none") for name in names)), lines)


def seconds(t_us: int) -> str:
    """A time since the recording's begin, as a page shows it."""
    return f"{t_us / 1e6:.3f} s"


def image_uri(image: IndexedImage) -> str:
    """An address that holds a picture, so large that a browser shows pixels as even squares."""
    return image.enlarged(enlargement(image.index.shape[1])).data_uri()


def behind_uri(window: WindowData) -> str:
    """The frame to look at faintly through errors; empty where there is none."""
    return "" if window.frame is None else image_uri(behind_image(window.frame))


def events_cap(window: WindowData) -> int:
    """Events per pixel at which colours end."""
    if window.brighter is None or window.darker is None:
        return 1
    either = np.maximum(window.brighter, window.darker)
    return max(1, round(float(np.percentile(either[either > 0], 90)))) if either.any() else 1


def _error_cap_cm(window: WindowData) -> float:
    if window.truth is not None:
        return middle_cap_cm(method.errors_cm(window.truth) for method in window.methods)
    expected = ((method.error_m, method.mask) for method in window.methods)
    return middle_cap_cm(100 * error_m[mask] for error_m, mask in expected if error_m is not None)


def middle_cap_cm(errors: Iterable[NDArray[np.floating]]) -> float:
    """Where colours of errors end: one bad map must not flatten the colours of all others."""
    caps = [error_cap_cm(of_map) for of_map in errors]
    return float(np.median(caps)) if caps else 1.0
