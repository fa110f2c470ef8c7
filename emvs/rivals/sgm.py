"""Semi-global matching of time surfaces: an image matcher on event data.

The rival of the published comparisons (Zhou, Gallego, Shen, *Event-based Stereo Visual Odometry*,
TRO 2021, section VI): the rectified time surfaces of both cameras are matched like images, and only
pixels that fired lately report the depth that they are given.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap
from emvs.errors import InputError
from emvs.rivals.parameters import SgmParameters
from emvs.rivals.rectify import Rectified
from emvs.rivals.semi_global import disparity_range_px, match
from emvs.rivals.time_surface import TimeSurface
from emvs.rivals.time_surface_kernels import NEVER_US
from emvs.rivals.to_view import Seen, depth_map, see_disparities
from emvs.view import ReferenceView
from emvs.window import Window

Image = NDArray[np.float32]


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: SgmParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Depth from the time surfaces at the reference time (`SGM/ts`).

    Confidence is the time surface's value, 0..1.

    Raises:
        InputError: a rig or depth range that cannot be matched, or a camera without events before
            the reference time.
    """
    parameters = parameters or config.sgm
    matched = _Matcher(recording, window, view, parameters)
    seen = next(matched.at([window.t_ref_us]))
    return depth_map("SGM/ts", seen.depth_m, seen.value, view, config)


def estimate_window(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: SgmParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Inverse depth averaged over the window at a fixed rate (`SGM/window`).

    Every estimate is carried into the reference view by the poses; a pixel takes the mean of the
    inverse depths that reach it. Confidence is the sum of their time surfaces' values.

    Raises:
        InputError: as `estimate`, or a window shorter than the interval between estimates.
    """
    parameters = parameters or config.sgm
    matched = _Matcher(recording, window, view, parameters)
    shape = view.camera.height_px, view.camera.width_px
    inverse, count, value = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for seen in matched.at(instants_us(window, parameters.rate_hz)):
        inverse[seen.mask] += 1 / seen.depth_m[seen.mask].astype(np.float64)
        count += seen.mask
        value += seen.value
    mean_m = np.divide(count, inverse, out=np.zeros(shape), where=count > 0)
    mean = mean_m.astype(np.float32)
    return depth_map("SGM/window", mean, value.astype(np.float32), view, config)


def instants_us(window: Window, rate_hz: float) -> list[int]:
    """Times at which a method that works at a rate looks at a window: after each interval, µs.

    Raises:
        InputError: a window that is shorter than one interval.
    """
    step_us = 1e6 / rate_hz
    count = int((window.t1_us - window.t0_us) / step_us)
    if count < 1:
        raise InputError(
            f"window of {(window.t1_us - window.t0_us) / 1e6:.6f} s: a method at {rate_hz:g} Hz "
            f"needs at least {step_us / 1e6:g} s; choose a longer duration_s"
        )
    # The window's end is excluded: no pose need reach it.
    last_us = window.t1_us - 1
    return [min(window.t0_us + round(k * step_us), last_us) for k in range(1, count + 1)]


class _Matcher:
    """Keeps both cameras' time surfaces and matches them at growing times."""

    def __init__(
        self, recording: Recording, window: Window, view: ReferenceView, parameters: SgmParameters
    ) -> None:
        self._recording, self._view, self._parameters = recording, view, parameters
        self._stereo = Rectified.of(recording.rig)
        self._range_px = disparity_range_px(self._stereo, view)
        self._fed_us = window.t0_us
        self._surfaces = [
            TimeSurface(
                recording.rig.cameras[k].width_px, recording.rig.cameras[k].height_px,
                parameters.decay_s, median_px=parameters.median_px,
            )
            for k in self._stereo.cameras
        ]  # fmt: skip

    def at(self, times_us: Sequence[int]) -> Iterator[Seen]:
        """What the reference view sees of each time's estimate."""
        for t_us in times_us:
            self._feed(t_us)
            disparity_px, recent = self._matched(t_us)
            yield see_disparities(
                disparity_px, recent, self._stereo, t_us, self._recording, self._view
            )

    def _feed(self, t_us: int) -> None:
        for camera, surface in zip(self._stereo.cameras, self._surfaces, strict=True):
            surface.update(self._recording.events(camera, self._fed_us, t_us))
            if surface.newest_us == NEVER_US:
                raise InputError(
                    f"camera {self._recording.rig.camera_names[camera]} has no events from "
                    f"{self._fed_us} to {t_us} µs: a time surface needs at least 1 before the "
                    "reference time; choose another window"
                )
        self._fed_us = t_us

    def _matched(self, t_us: int) -> tuple[Image, Image]:
        """Disparities at pixels that fired lately, and how lately: the time surface's value."""
        left, right = (
            self._stereo.image(side, surface.at(t_us))
            for side, surface in enumerate(self._surfaces)
        )
        disparity_px = match(_bytes(left), _bytes(right), self._range_px, self._parameters.matcher)
        active = self._surfaces[0].active(t_us, self._parameters.active_s)
        fired = self._stereo.image(0, active) >= 0.5
        recent = self._stereo.image(0, self._surfaces[0].at(t_us, smooth=False))
        return np.where(fired, disparity_px, np.float32(np.nan)), recent


def _bytes(surface: Image) -> NDArray[np.uint8]:
    return np.rint(surface * 255).astype(np.uint8)
