"""Ordinary cameras of a recording: lens, place and pictures, in pixels of their own or shared ones.

A camera beside the event cameras has size, lens, place and exposure of its own. One in an event
camera's place, as in a DAVIS, shares its pixels; `shares` says with which.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera


class Pictures(Protocol):
    """Pictures of one camera in order of time, read one at a time."""

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) middles of the exposures, µs."""

    def photo(self, index: int) -> Photo:
        """The picture at an index; where nobody knows the exposure, it has no length."""


@dataclass(frozen=True, eq=False)
class FrameCamera:
    """One ordinary camera of a recording.

    Attributes:
        name: unlike that of every other camera; an event camera's own where it shares its pixels.
        camera: size and lens of the pictures.
        T_body_cam: (4, 4) where it sits on the body.
        pictures: what it took.
        shares: the event camera whose pixels these are, if any.
    """

    name: str
    camera: Camera
    T_body_cam: NDArray[np.float64]
    pictures: Pictures
    shares: int | None = None

    def photo(self, index: int) -> Photo:
        """The picture at an index, of the camera's size.

        Raises:
            InputError: another size, or a damaged file.
        """
        photo = self.pictures.photo(index)
        needed = self.camera.height_px, self.camera.width_px
        if photo.image.shape != needed:
            raise InputError(
                f"frame {index} of {self.name} has shape {photo.image.shape}, its calibration "
                f"{needed}: give the calibration of these frames"
            )
        return photo


@dataclass(frozen=True)
class ImageFiles:
    """Pictures that are a file each, with their times and exposures.

    Attributes:
        paths: image files in order of time.
        start_us: (T,) when each shutter opened, µs.
        end_us: (T,) when it closed; the same where nobody knows.
        read: gives the (H, W) grey levels of a file, uint8.
    """

    paths: Sequence[Path]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    read: Callable[[Path], NDArray[np.uint8]]

    def __post_init__(self) -> None:
        where = self.paths[0].parent if self.paths else "no image"
        if not len(self.paths) == len(self.start_us) == len(self.end_us):
            raise InputError(
                f"{where}: {len(self.paths)} images for {len(self.start_us)} times: download both "
                "again"
            )
        if (self.end_us < self.start_us).any() or (np.diff(self.t_us) <= 0).any():
            raise InputError(f"{where}: times of images do not rise: sort them")

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) middles of the exposures, µs."""
        middle_us: NDArray[np.int64] = self.start_us + (self.end_us - self.start_us) // 2
        return middle_us

    def photo(self, index: int) -> Photo:
        """The picture at an index."""
        span_us = int(self.start_us[index]), int(self.end_us[index])
        return Photo(*span_us, 1.0, self.read(self.paths[index]))


@dataclass(frozen=True)
class _Nearest:
    """Frames that a recording gives by the nearest time."""

    t_us: NDArray[np.int64]
    recording: Any
    camera: int
    exposed: bool

    def photo(self, index: int) -> Photo:
        t_us = int(self.t_us[index])
        if self.exposed:
            photo: Photo = self.recording.photo(self.camera, t_us)
            return photo
        return Photo(t_us, t_us, 1.0, self.recording.frame(self.camera, t_us))


def frame_cameras(recording: Any) -> tuple[FrameCamera, ...]:
    """All cameras of a recording that have frames: those beside the event cameras first."""
    rig, shared = recording.rig, []
    exposed = hasattr(recording, "photo_times_us")
    for k, name in enumerate(rig.camera_names):
        ask = "photo_times_us" if exposed else "frame_times_us"
        t_us = getattr(recording, ask)(k) if hasattr(recording, ask) else np.empty(0, np.int64)
        if len(t_us):
            pictures = _Nearest(t_us, recording, k, exposed)
            shared.append(FrameCamera(name, rig.cameras[k], rig.T_body_cam[k], pictures, k))
    return (*getattr(recording, "frame_cameras", ()), *shared)
