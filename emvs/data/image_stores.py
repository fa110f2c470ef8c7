"""Images of one camera on disk: ground truth at chosen times, and an ordinary camera's frames.

An ordinary camera beside the event cameras has size, lens, place and exposure of its own; one in an
event camera's place, as in a DAVIS, shares its pixels.

Depth and intensity are always there; what else there is, `OPTIONAL` names. Each image is a
compressed chunk of its own, so reading one reads nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.hdf5 import (
    COMPRESSION,
    ClosingWriter,
    Hdf5Writer,
    check_dataset,
    known_names,
    open_hdf5,
    read_whole,
)
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera

Image = NDArray[Any]
_ALWAYS: dict[str, np.dtype[Any]] = {
    "depth_m": np.dtype(np.float32),
    "intensity": np.dtype(np.uint8),
}
OPTIONAL: dict[str, np.dtype[Any]] = {
    "flow_px": np.dtype(np.float32),
    "segmentation": np.dtype(np.int32),
    "boundary": np.dtype(np.uint8),
    "twist": np.dtype(np.float64),
    "view_depth_m": np.dtype(np.float32),
}
"""Optional data sets and their types; the page `simulator` says what they mean."""
_SHUFFLED = hdf5plugin.Blosc(cname="lz4", clevel=5, shuffle=hdf5plugin.Blosc.SHUFFLE)
FRAMES_FILE = "frames.h5"


class TruthWriter(ClosingWriter):
    """Appends ground truth to a file, one time after the other."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._optional: tuple[str, ...] | None = None
        self._hdf5 = Hdf5Writer(path)
        self._hdf5.grow("t_us", np.int64, 1024)
        for name in _ALWAYS:
            self._create(name, (height_px, width_px))

    def append(
        self,
        t_us: int,
        depth_m: NDArray[np.float32],
        intensity: NDArray[np.uint8],
        optional: Mapping[str, Image] | None = None,
    ) -> None:
        """Adds one time.

        Args:
            t_us: after the time before, µs.
            depth_m: (H, W) z-depth, m.
            intensity: (H, W) linear intensity, 0..255.
            optional: data sets named in `OPTIONAL`, the same ones at every time.
        """
        more = self._checked(optional or {})
        values: dict[str, Any] = {"t_us": t_us, "depth_m": depth_m, "intensity": intensity, **more}
        for name, value in values.items():
            self._hdf5.extend(name, [value])

    def _create(self, name: str, shape: tuple[int, ...]) -> None:
        kind = {**_ALWAYS, **OPTIONAL}[name]
        self._hdf5.grow(name, kind, 1, shape, **COMPRESSION.get(kind, _SHUFFLED))

    def _checked(self, optional: Mapping[str, Image]) -> dict[str, Image]:
        names = known_names("ground truth", optional, OPTIONAL, self._optional)
        if self._optional is None:
            self._optional = names
            for name in names:
                self._create(name, optional[name].shape)
        return {name: optional[name] for name in names}


class TruthReader:
    """Reads single ground-truth images."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with open_hdf5(self.path) as file:
            self.optional = tuple(name for name in OPTIONAL if name in file)
            for name in (*_ALWAYS, *self.optional):
                check_dataset(self.path, file[name])
            self.t_us: NDArray[np.int64] = read_whole(self.path, file["t_us"])

    def depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in metres at a stored time; not finite where nothing is seen."""
        return self._read("depth_m", t_us).astype(np.float32, copy=False)

    def intensity(self, t_us: int) -> NDArray[np.uint8]:
        """(H, W) linear intensity, 0..255, at a stored time."""
        return self._read("intensity", t_us).astype(np.uint8, copy=False)

    def read(self, name: str, t_us: int) -> Image:
        """An optional data set at a stored time, see `OPTIONAL`."""
        if name not in self.optional:
            stored = ", ".join(self.optional) or "none of the optional ones"
            raise InputError(
                f"{self.path}: has no {name} (it has: {stored}); simulate with it in `truth`"
            )
        return self._read(name, t_us)

    def times(self) -> Iterator[tuple[int, dict[str, Image]]]:
        """Every stored time with all of its data, in order."""
        for t_us in self.t_us.tolist():
            yield t_us, {name: self._read(name, t_us) for name in (*_ALWAYS, *self.optional)}

    def _read(self, name: str, t_us: int) -> Image:
        rows = np.flatnonzero(self.t_us == t_us)
        if not rows.size:
            nearest = self.t_us[np.argmin(np.abs(self.t_us - t_us))] if len(self.t_us) else "none"
            raise InputError(
                f"{self.path}: no ground truth at {t_us} µs (nearest: {nearest}); move the "
                "reference view to a stored time; where you simulate, another truth interval helps"
            )
        with open_hdf5(self.path) as file:
            image: Image = file[name][int(rows[0])]
        return image


class Photo(NamedTuple):
    """One picture of an ordinary camera in the event camera's place.

    `gain` is the pixel value (full scale 1) per mean linear light, `image` (H, W) uint8, linear,
    255 at saturation; the shutter opened at `start_us` and closed at `end_us`.
    """

    start_us: int
    end_us: int
    gain: float
    image: NDArray[np.uint8]

    @property
    def t_us(self) -> int:
        """The middle of the exposure, µs."""
        return (self.start_us + self.end_us) // 2

    @property
    def white(self) -> float:
        """Share of the pixels at the upper end: too bright to tell apart."""
        return float((self.image == 255).mean())

    @property
    def black(self) -> float:
        """Share of the pixels at 0: too dark to tell apart."""
        return float((self.image == 0).mean())


class FrameWriter(ClosingWriter):
    """Appends pictures to a file, in order of time."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._shape, self._last_us = (height_px, width_px), -(2**62)
        self._hdf5 = Hdf5Writer(path)
        for name, kind in (("start_us", np.int64), ("end_us", np.int64), ("gain", np.float64)):
            self._hdf5.grow(name, kind, 1024)
        self._hdf5.grow("image", np.uint8, 1, self._shape, **COMPRESSION[np.dtype(np.uint8)])

    def append(self, photo: Photo) -> None:
        """Adds a picture."""
        if photo.image.shape != self._shape:
            raise InputError(f"frame of shape {photo.image.shape}: this file needs {self._shape}")
        if not self._last_us <= photo.start_us <= photo.end_us or photo.end_us == self._last_us:
            raise InputError(
                f"frame from {photo.start_us} to {photo.end_us} µs, but the previous one ends at "
                f"{self._last_us} µs: append frames in time order, without overlap"
            )
        self._last_us = photo.end_us
        for name, value in photo._asdict().items():
            self._hdf5.extend(name, [value])


class FrameReader:
    """Reads single pictures."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with open_hdf5(self.path) as file:
            self._start_us: NDArray[np.int64] = read_whole(self.path, file["start_us"])
            self._end_us: NDArray[np.int64] = read_whole(self.path, file["end_us"])
            self._gain: NDArray[np.float64] = read_whole(self.path, file["gain"])
            count = check_dataset(self.path, file["image"])
        if not len(self._start_us) == len(self._end_us) == len(self._gain) == count:
            raise InputError(
                f"{self.path}: times, gains and frames differ in number; create the sequence again"
            )

    def __len__(self) -> int:
        return len(self._gain)

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) middle of every exposure, µs."""
        middle_us: NDArray[np.int64] = (self._start_us + self._end_us) // 2
        return middle_us

    def photo(self, index: int) -> Photo:
        """The picture at an index."""
        with open_hdf5(self.path) as file:
            image: NDArray[np.uint8] = file["image"][index].astype(np.uint8, copy=False)
        span_us = int(self._start_us[index]), int(self._end_us[index])
        return Photo(*span_us, float(self._gain[index]), image)

    def photos(self) -> Iterator[Photo]:
        """All pictures in order."""
        return (self.photo(index) for index in range(len(self)))


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
