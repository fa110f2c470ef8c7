"""The frame baseline: semi-global matching of an ordinary stereo camera's pictures.

What the events are measured against: the same optics, motion and light, but an exposure and a
converter of 8 bits, so that motion blurs and lamps saturate (`frames` of the simulator). Every
pixel that passes the matcher's checks reports depth, also where no edge moved.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.image_stores import Photo
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap
from emvs.errors import InputError
from emvs.rivals.parameters import FrameParameters
from emvs.rivals.rectify import Rectified
from emvs.rivals.semi_global import disparity_range_px, match
from emvs.rivals.to_view import depth_map, see_disparities
from emvs.view import ReferenceView
from emvs.window import Window

_GAMMA = 2.2  # cameras deliver pictures that are encoded so


@runtime_checkable
class HasPhotos(Protocol):
    """A recording with an ordinary camera in the place of each event camera."""

    def photo_times_us(self, camera: int) -> NDArray[np.int64]:
        """(T,) middles of the exposures, µs."""

    def photo(self, camera: int, t_us: int) -> Photo:
        """The picture whose exposure's middle is nearest to a time."""


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: FrameParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Depth from the two pictures nearest to the reference time (`Frames/sgm`).

    The pictures are brought to one gain and encoded by a gamma of 2.2. Confidence is the contrast
    of the matched block: the standard deviation of its pixel values, 0..255.

    Raises:
        InputError: no pictures in the window, cameras that take them at different times, or a rig
            or depth range that cannot be matched.
    """
    parameters = parameters or config.frames
    stereo = Rectified.of(recording.rig)
    range_px = disparity_range_px(stereo, view)
    photos = photos_at(recording, window, stereo.cameras)
    gain = min(photo.gain for photo in photos)
    left, right = (_encoded(stereo.image(k, photo.image), photo.gain, gain)
                   for k, photo in enumerate(photos))  # fmt: skip
    seen = see_disparities(
        match(left, right, range_px, parameters.matcher),
        _contrast(left, parameters.matcher.block_px),
        stereo, photos[0].t_us, recording, view,
    )  # fmt: skip
    return depth_map("Frames/sgm", seen.depth_m, seen.value, view, config)


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
            f"{name}: has no frames of an ordinary camera, Frames/sgm needs them: "
            "simulate with frames.rate_hz above 0, or leave this method out"
        )
    photos = [recording.photo(camera, window.t_ref_us) for camera in cameras]
    if photos[0][:2] != photos[1][:2]:
        raise InputError(
            f"{name}: frames at {photos[0].t_us} and {photos[1].t_us} µs are no stereo "
            "pair: Frames/sgm needs cameras that expose at the same time"
        )
    if not window.t0_us <= photos[0].t_us <= window.t1_us:
        raise InputError(
            f"{name}: nearest frame at {photos[0].t_us} µs lies outside the window "
            f"{window.t0_us}..{window.t1_us} µs: choose a longer window or a higher frame rate"
        )
    return photos


def _encoded(image: NDArray[np.float32], own_gain: float, gain: float) -> NDArray[np.uint8]:
    light = np.clip(image / 255 * (gain / own_gain), 0, 1)
    return np.rint(light ** (1 / _GAMMA) * 255).astype(np.uint8)


def _contrast(image: NDArray[np.uint8], block_px: int) -> NDArray[np.float32]:
    """(H, W) float32 standard deviation in the block around each pixel."""
    values, size = image.astype(np.float32), (block_px, block_px)
    mean, square = cv2.blur(values, size), cv2.blur(values**2, size)
    variance = np.asarray(square, np.float32) - np.asarray(mean, np.float32) ** 2
    deviation: NDArray[np.float32] = np.sqrt(np.maximum(variance, np.float32(0)))
    return deviation
