"""What settings leave to the recording: the depth range, and how many planes cover it.

Where nobody says how far things are, a coarse pass looks: a few events in a small view, between
depths that are multiples of the distance that disparities refer to, so that no unit of length is
assumed; then again, nearer to what was found. Depths come from focus, whose reliability tells true
maxima from those of chance; the plain maximum of votes has too many of these on planes so wide
apart.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import DEFAULT_DEPTH_RANGE_M, PLANES, FocusParameters, MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import occupied_spans, spread
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.depth.focus import parallax_baseline_m
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, with_volume
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.windows import Window, choose_window

MOST_PLANES = 400
"""The cap where neighbouring planes are to lie a pixel of disparity apart."""
_EVENTS, _SLICES, _SLICE_US = 100_000, 16, 250_000  # of each camera and window that is looked at
_COLUMNS = 240
# The first look: from half the baseline to a tenth of a pixel of disparity. The second one begins
# somewhat nearer than its nearest points, and trusts fewer.
_NEAREST_BASELINES, _FARTHEST_PX, _CLOSER = 0.5, 0.1, 0.7
_PLANES = 300, 100  # of each look
_RELIABILITY = {1: 0.1, 2: 0.03}  # by cameras: two confirm each other
_FEWEST, _ENDS = 20, (0.01, 0.99)  # points, and which quantiles of their depths count
_MARGIN = 0.75, 1.5
_SHORT_WAY = 0.3  # of the longest: one camera that hardly moves sees depths of chance
# Parts of a window, and the longest: on a long way no depth is in focus on planes so wide apart.
_PARTS, _LONGEST_US = (1, 4, 16, 64, 256), 5_000_000
_WINDOW_US = 200_000  # of windows by count
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Settled:
    """Settings with what they left open.

    Attributes:
        config: the depth range and the number of planes are set, unless the recording says them.
        found: what was chosen, for people; empty where nothing was.
    """

    config: MapperConfig
    found: str = ""


def settled(
    recording: Recording, config: MapperConfig, doubt: Callable[[str], None] = _log.warning
) -> Settled:
    """Sets what the configuration and the recording leave open; the same again changes nothing.

    `doubt` takes a line where no depth can be seen, and the range is a guess.

    Raises:
        InputError: a window that events or poses do not cover, or an impossible depth range.
    """
    stretch = choose_window(recording, config)
    given, words = (config.min_depth_m, config.max_depth_m), []
    if recording.depth_range_m is None and None in given:
        seen_m = coarse_range_m(recording, config, stretch)
        near_m, far_m = (
            known or ends
            for known, ends in zip(given, seen_m or DEFAULT_DEPTH_RANGE_M, strict=True)
        )
        config = config.model_copy(update={"min_depth_m": near_m, "max_depth_m": far_m})
        words = [f"depth {near_m:g} to {far_m:g} m, from a coarse pass"] if seen_m else []
        if seen_m is None:
            doubt(
                f"depth {near_m:g} to {far_m:g} m is a guess: a coarse pass saw no depth to trust "
                "(few events, little parallax, or poses that do not fit); set min_depth_m and "
                "set max_depth_m"
            )
    if config.planes is None:
        config = config.model_copy(update={"planes": planes_for(recording, config, stretch)})
        words += [f"{config.planes} planes"] if words or config.planes != PLANES else []
    cure = "; for others set min_depth_m and set max_depth_m" if len(words) > 1 else ""
    return Settled(config, ", ".join(words) + cure)


def planes_for(recording: Recording, config: MapperConfig, stretch: Window) -> int:
    """How many planes: the paper's 100, or as many as lie a pixel of disparity apart, up to 400.

    Disparity is that between two cameras, or along the way of one that is alone.
    """
    methods = methods_by_name(config.methods, len(recording.rig), mcemvs=config.is_mcemvs)
    fixed = any(method.extraction.planes for method in with_volume(methods))
    if fixed or config.is_mcemvs or config.spacing != "inverse":
        return PLANES
    near_m, far_m = depth_range_m(recording, config)
    focal_px = config.view_focal_px or recording.rig.cameras[0].fx_px
    windows = _windows(recording, stretch, *_extent(config, stretch))
    baseline_m = max((baseline_m for _, baseline_m in windows), default=0.0)
    wanted = math.ceil(focal_px * baseline_m * (1 / near_m - 1 / far_m)) + 1
    return min(max(PLANES, wanted), MOST_PLANES)


def coarse_range_m(
    recording: Recording, config: MapperConfig, stretch: Window
) -> tuple[float, float] | None:
    """Nearest and farthest depth of what a coarse pass sees, m, with a margin; None if nothing.

    It looks at the one window that is asked for, or at the first, middle and last of sliding ones,
    and where it sees nothing there, at ever shorter parts.
    """
    length_us, count = _extent(config, stretch)
    for parts in _PARTS:
        if length_us // parts > _LONGEST_US:
            continue
        windows = _windows(recording, stretch, length_us // parts, count if parts == 1 else 3)
        ends_m: list[NDArray[np.float64]] = []
        for window in windows:
            ends_m += _ends_m(recording, config, *window)
        if ends_m:
            near_m, far_m = np.min(ends_m, axis=0)[0], np.max(ends_m, axis=0)[1]
            return _rounded(_MARGIN[0] * near_m), _rounded(_MARGIN[1] * far_m)
    return None


def _extent(config: MapperConfig, stretch: Window) -> tuple[int, int]:
    """Length, µs, and number of the windows that are looked at."""
    whole_us = stretch.t1_us - stretch.t0_us
    if not config.slides:
        return whole_us, 1
    asked_us = _WINDOW_US if config.window_s is None else round(1e6 * config.window_s)
    return min(asked_us, whole_us), 3


def _rounded(depth_m: float) -> float:
    return float(f"{depth_m:.3g}")


def _windows(
    recording: Recording, stretch: Window, length_us: int, count: int
) -> list[tuple[Window, float]]:
    """Windows, and what disparities in them refer to, m; none where that is short or 0."""
    spans = occupied_spans(recording, stretch.t0_us, stretch.t1_us)
    found = []
    for t0_us in np.unique(spread(spans, length_us, count)).tolist() if spans else ():
        window = Window(t0_us, t0_us + length_us, t0_us + length_us // 2, stretch.left_out)
        with suppress(InputError):
            found.append((window, parallax_baseline_m(recording, window)))
    longest_m = max((baseline_m for _, baseline_m in found), default=0.0)
    return [each for each in found if each[1] >= _SHORT_WAY * longest_m]


def _ends_m(
    recording: Recording, config: MapperConfig, window: Window, baseline_m: float
) -> Sequence[NDArray[np.float64]]:
    """(2,) near and far quantile of the depths in a window; none where too few can be trusted."""
    ends_m = np.zeros(2)
    try:
        seen = _Sample(recording, window)
        far_m = recording.rig.cameras[0].fx_px * baseline_m / _FARTHEST_PX
        nearest_m = near_m = _NEAREST_BASELINES * baseline_m
        for planes in _PLANES:
            coarse = _coarse(seen, config.threads, planes, near_m, far_m)
            (found,) = map_window(seen, coarse, window=window).depth_maps.values()
            if found.points < _FEWEST:
                return ()
            ends_m = np.quantile(found.depth_m[found.mask].astype(np.float64), _ENDS)
            near_m = max(near_m, _CLOSER * ends_m[0])
    except InputError:  # the mapping itself will report what is wrong with this window
        return ()
    return (ends_m,) if near_m > nearest_m else ()


def _coarse(
    seen: Recording, threads: int, planes: int, near_m: float, far_m: float
) -> MapperConfig:
    camera = seen.rig.cameras[0]
    scale = min(1.0, _COLUMNS / camera.width_px)
    return MapperConfig(
        methods=("Focus/H" if len(seen.rig) > 1 else "Focus/cam0",),
        planes=planes, min_depth_m=near_m, max_depth_m=far_m, threads=threads,
        focus=FocusParameters(reliability=_RELIABILITY[min(len(seen.rig), 2)]),
        view_width_px=round(scale * camera.width_px),
        view_height_px=round(scale * camera.height_px),
        view_focal_px=scale * camera.fx_px,
    )  # fmt: skip


class _Sample(DerivedRecording):
    """A window with few of its events, in memory: from several short slices where it is long."""

    def __init__(self, recording: Recording, window: Window) -> None:
        super().__init__(recording)
        length_us = -(-(window.t1_us - window.t0_us) // _SLICES)
        begins_us = window.t0_us + length_us * np.arange(_SLICES)
        kept_us = min(length_us, _SLICE_US)
        self._streams = [
            Events.concat([
                recording.events(k, t_us, min(t_us + kept_us, window.t1_us))
                .thinned(_EVENTS // _SLICES)
                for t_us in begins_us.tolist()
            ])
            for k in range(len(recording.rig))
        ]  # fmt: skip

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """The kept events of a camera with `t0_us <= t < t1_us`."""
        return self._streams[camera].between(t0_us, t1_us)
