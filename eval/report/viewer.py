"""What the script of a run's page reads: a window's maps as JSON, for its cursor and its clouds."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from eventsweep.eval.figures.colormaps import Scale
from eventsweep.eval.report.run_data import MethodData, WindowData
from eventsweep.eval.scoring.outlier_causes import CAUSES

MOST_POINTS = 30_000
"""Points of one cloud that the page draws; more are thinned out evenly."""
_LARGEST_HALF = 65_504.0


def window_json(window: WindowData, methods: Sequence[str], error: Scale, depth: Scale) -> Markup:
    """A window as JSON for the page's script; numbers, base64 and fixed texts: nothing to escape.

    Depth in m, confidence in the method's own unit (left out where it has none), each at the pixels
    of the method's mask in reading order; true depth in m, 0 where it is unknown; intrinsics in px;
    colours of errors in cm; 1 + position of a bad pixel's cause. Methods stand in the order of the
    case's buttons.
    """
    height_px, width_px = window.methods[0].depth_m.shape
    camera = window.camera
    data: dict[str, Any] = {
        "w": width_px,
        "h": height_px,
        "range_m": window.shown_range_m,
        "most": MOST_POINTS,
        "cap_cm": error.high,
        "depth_colours": depth.css_colours(64),
        "error_colours": error.css_colours(64),
        "methods": [_method(method, methods.index(method.name)) for method in window.methods],
    }
    if any(method.causes is not None for method in window.methods):
        data["causes"] = [[cause.replace("_", " "), why] for cause, why in CAUSES.items()]
    if camera is not None:
        data["camera"] = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
    if window.frame is not None and window.frame.shape == (height_px, width_px):
        data["frame"] = packed(window.frame)
    if window.truth is not None:
        known = np.where(window.truth.scored, window.truth.depth_m, 0.0)
        data["truth"] = packed(half(known))
    return Markup(json.dumps(data, separators=(",", ":")))


def _method(method: MethodData, position: int) -> dict[str, Any]:
    found = {
        "position": position,
        "mask": packed(np.packbits(method.mask.ravel(), bitorder="little")),
        "depth": packed(half(method.depth_m[method.mask])),
    }
    if method.is_sure:
        found["votes"] = packed(half(np.nan_to_num(method.confidence[method.mask])))
    if method.causes is not None:
        found["causes"] = packed(method.causes[method.mask])
    return found


def packed(values: NDArray[np.generic]) -> str:
    """The bytes of an array, compressed, as text that is safe in a page."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode("ascii")


def half(values: NDArray[np.floating]) -> NDArray[np.float16]:
    """Half precision, little-endian: 0.05 % of the value, finer than any error that is shown."""
    return np.asarray(np.clip(values, -_LARGEST_HALF, _LARGEST_HALF), "<f2")
