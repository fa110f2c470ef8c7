"""Semi-global matching, of time surfaces and of an ordinary stereo camera's frames.

Of time surfaces it is the baseline of the published comparisons (Zhou, Gallego, Shen, *Event-based
Stereo Visual Odometry*, TRO 2021, section VI): the rectified time surfaces of both cameras are
matched like images, and only pixels that fired lately report the depth that they are given.

Frames are what the events are measured against: the same optics, motion and light, but an exposure
and a converter of 8 bits, so that motion blurs and lamps saturate (`frames` of the simulator).
Every pixel that passes the matcher's checks reports depth, also where no edge moved.

H. Hirschmüller, *Stereo Processing by Semiglobal Matching and Mutual Information*, TPAMI 2008, in
the block-wise form of OpenCV's StereoSGBM. Block, penalties and uniqueness are those with which the
authors of ESVO (TRO 2021) ran it on time surfaces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.pixels_kernels import NEVER_US
from eventsweep.emvs.baselines.rectification import Rectified, Seen, depth_map, see_disparities
from eventsweep.emvs.baselines.time_surface import SurfacePair
from eventsweep.emvs.config import MapperConfig, SemiGlobal, SgmParameters
from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_at
from eventsweep.emvs.windows import Window

Image = NDArray[np.float32]
_GAMMA = 2.2  # cameras deliver pictures that are encoded so
_SUBPIXELS = 16  # StereoSGBM gives sixteenths of a pixel
_MULTIPLE = 16  # and searches a multiple of so many disparities
_WORTH_MATCHING_PX = 1.0


def estimate_time_surfaces(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Depth from the time surfaces at the reference time (`SGM/ts`).

    Confidence is the time surface's value, 0..1.

    Raises:
        InputError: a rig or depth range that cannot be matched, or a camera without events before
            the reference time.
    """
    seen = next(_Matcher(recording, window, view, config.sgm).at([window.t_ref_us]))
    return depth_map("SGM/ts", seen.depth_m, seen.value, view, config)


def estimate_window(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Inverse depth averaged over the window at a fixed rate (`SGM/window`).

    Every estimate is carried into the reference view by the poses; a pixel takes the mean of the
    inverse depths that reach it. Confidence is the sum of their time surfaces' values.

    Raises:
        InputError: as `estimate_time_surfaces`, or a window shorter than the interval between
            estimates.
    """
    matched = _Matcher(recording, window, view, config.sgm)
    shape = view.camera.height_px, view.camera.width_px
    inverse, count, value = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for seen in matched.at(instants_us(window, config.sgm.rate_hz)):
        inverse[seen.mask] += 1 / seen.depth_m[seen.mask].astype(np.float64)
        count += seen.mask
        value += seen.value
    mean_m = np.divide(count, inverse, out=np.zeros(shape), where=count > 0)
    mean = mean_m.astype(np.float32)
    return depth_map("SGM/window", mean, value.astype(np.float32), view, config)


class _Matcher:
    """Keeps both cameras' time surfaces and matches them at growing times."""

    def __init__(
        self, recording: Recording, window: Window, view: ReferenceView, parameters: SgmParameters
    ) -> None:
        self._recording, self._view, self._parameters = recording, view, parameters
        self._stereo = Rectified.of(recording.rig)
        self._range_px = disparity_range_px(self._stereo, view)
        self._surfaces = SurfacePair(recording, self._stereo, window.t0_us, parameters)

    def at(self, times_us: Sequence[int]) -> Iterator[Seen]:
        """What the reference view sees of each time's estimate."""
        for t_us in times_us:
            self._feed(t_us)
            disparity_px, recent = self._matched(t_us)
            yield see_disparities(
                disparity_px, recent, self._stereo, t_us, self._recording, self._view
            )

    def _feed(self, t_us: int) -> None:
        since_us = self._surfaces.fed_us
        self._surfaces.feed(t_us)
        for camera, surface in zip(self._stereo.cameras, self._surfaces.both, strict=True):
            if surface.newest_us == NEVER_US:
                raise InputError(
                    f"camera {self._recording.rig.camera_names[camera]} has no events from "
                    f"{since_us} to {t_us} µs: a time surface needs at least one event before "
                    "the reference time; choose another window"
                )

    def _matched(self, t_us: int) -> tuple[Image, Image]:
        """Disparities at pixels that fired lately, and how lately: the time surface's value."""
        left, right = (
            np.rint(image * 255).astype(np.uint8) for image in self._surfaces.images(t_us)
        )
        disparity_px = match(left, right, self._range_px, self._parameters.matcher)
        surface = self._surfaces.both[0]
        fired = self._stereo.image(0, surface.active(t_us, self._parameters.active_s)) >= 0.5
        recent = self._stereo.image(0, surface.at(t_us, smooth=False))
        return np.where(fired, disparity_px, np.float32(np.nan)), recent


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


def estimate_frames(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Depth from the two pictures nearest to the reference time (`Frames/sgm`).

    The pictures are brought to one gain and encoded by a gamma of 2.2. Confidence is the contrast
    of the matched block: the standard deviation of its pixel values, 0..255.

    Raises:
        InputError: no pictures in the window, cameras that take them at different times, or a rig
            or depth range that cannot be matched.
    """
    stereo, matcher = Rectified.of(recording.rig), config.frames.matcher
    range_px = disparity_range_px(stereo, view)
    photos = photos_at(recording, window, stereo.cameras)
    gain = min(photo.gain for photo in photos)
    lights = (
        np.clip(stereo.image(k, photo.image) / 255 * (gain / photo.gain), 0, 1)
        for k, photo in enumerate(photos)
    )
    left, right = (np.rint(light ** (1 / _GAMMA) * 255).astype(np.uint8) for light in lights)
    disparity_px = match(left, right, range_px, matcher)
    contrast = _contrast(left, matcher.block_px)
    seen = see_disparities(disparity_px, contrast, stereo, photos[0].t_us, recording, view)
    return depth_map("Frames/sgm", seen.depth_m, seen.value, view, config)


@runtime_checkable
class HasPhotos(Protocol):
    """A recording with an ordinary camera in the place of each event camera."""

    def photo_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) middles of the exposures, µs."""

    def photo(self, camera: int, t_us: int) -> Photo:
        """The picture whose exposure's middle is nearest to a time."""


def photos_at(recording: Recording, window: Window, cameras: tuple[int, int]) -> list[Photo]:
    """The pictures of two cameras nearest to the reference time of a window.

    Raises:
        InputError: no pictures, none in the window, or cameras that take them at different times.
    """
    name = recording.name
    # A filter of events holds what it filters, pictures included.
    while not isinstance(recording, HasPhotos) and hasattr(recording, "recording"):
        recording = recording.recording
    if not isinstance(recording, HasPhotos) or not len(recording.photo_times_us(cameras[0])):
        raise InputError(
            f"{name}: has no frames, which Frames/sgm needs: simulate with frames.rate_hz above "
            "0, or leave this method out"
        )
    photos = [recording.photo(camera, window.t_ref_us) for camera in cameras]
    if photos[0][:2] != photos[1][:2]:
        raise InputError(
            f"{name}: frames at {photos[0].t_us} and {photos[1].t_us} µs are not a stereo pair: "
            "Frames/sgm needs cameras that expose together"
        )
    if not window.t0_us <= photos[0].t_us <= window.t1_us:
        raise InputError(
            f"{name}: nearest frame at {photos[0].t_us} µs lies outside the window "
            f"{window.t0_us}..{window.t1_us} µs: choose a longer window or a higher frame rate"
        )
    return photos


def _contrast(image: NDArray[np.uint8], block_px: int) -> NDArray[np.float32]:
    """(H, W) float32 standard deviation in the block around each pixel."""
    values, size = image.astype(np.float32), (block_px, block_px)
    mean, square = cv2.blur(values, size), cv2.blur(values**2, size)
    variance = np.asarray(square, np.float32) - np.asarray(mean, np.float32) ** 2
    deviation: NDArray[np.float32] = np.sqrt(np.maximum(variance, np.float32(0)))
    return deviation


def match(
    left: NDArray[np.uint8], right: NDArray[np.uint8], range_px: tuple[int, int],
    settings: SemiGlobal,
) -> Image:  # fmt: skip
    """Matches row-aligned (H, W) images: float32 disparities of the left one, px; NaN for none."""
    low, high = range_px
    count = -(-(high - low + 1) // _MULTIPLE) * _MULTIPLE
    area = settings.block_px**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=low,
        numDisparities=count,
        blockSize=settings.block_px,
        P1=settings.p1_per_px * area,
        P2=settings.p2_per_px * area,
        disp12MaxDiff=settings.left_right_px,
        uniquenessRatio=settings.uniqueness_percent,
    )
    # Without a rim it would report nothing in the first low + count columns.
    rim = low + count
    wide = (cv2.copyMakeBorder(i, 0, 0, rim, 0, cv2.BORDER_REPLICATE) for i in (left, right))
    sixteenths = np.asarray(matcher.compute(*wide))[:, rim:]
    disparity_px = sixteenths.astype(np.float32) / _SUBPIXELS
    matched = (sixteenths >= low * _SUBPIXELS) & (disparity_px <= high) & (disparity_px > 0)
    # The rim holds no light: what has its partner there has none.
    partner_px = np.arange(left.shape[1]) - disparity_px
    matched &= partner_px >= settings.block_px // 2
    return np.where(matched, disparity_px, np.float32(np.nan))


def disparity_range_px(stereo: Rectified, view: ReferenceView) -> tuple[int, int]:
    """Smallest and largest disparity of the view's planes, whole px.

    Raises:
        InputError: a range that a pixel of disparity cannot resolve.
    """
    scale = stereo.camera.fx_px * stereo.baseline_m
    ends = np.array([0, len(view.rho) - 1], np.float32)
    far, near = np.sort(scale * inverse_depth_at(view.rho, ends).astype(np.float64))
    if near - far < _WORTH_MATCHING_PX:
        raise InputError(
            f"depths {scale / near:.3g}..{scale / far:.3g} m span {near - far:.2f} px of "
            f"disparity on a baseline of {stereo.baseline_m:g} m: stereo matching needs at least "
            f"{_WORTH_MATCHING_PX:g} px; choose a smaller min_depth_m or a method that fuses "
            "volumes"
        )
    return int(np.floor(far)), int(np.ceil(near))
