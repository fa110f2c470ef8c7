"""The pictures of an ordinary camera on disk: exposure, gain and image of one camera, in HDF5."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emvs.data.hdf5 import COMPRESSION, Hdf5Writer, open_hdf5
from emvs.errors import InputError

FILE_NAME = "frames.h5"


class Photo(NamedTuple):
    """One picture of an ordinary camera in the event camera's place.

    Attributes:
        start_us: when the shutter opened, µs.
        end_us: when it closed, µs.
        gain: pixel value (full scale 1) per mean linear light.
        image: (H, W) uint8, linear, 255 at saturation.
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


class FrameWriter:
    """Appends pictures to a file, in order of time."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._shape, self._last_us = (height_px, width_px), -(2**62)
        self._hdf5 = Hdf5Writer(path)
        file = self._hdf5.file
        for name in ("start_us", "end_us"):
            file.create_dataset(name, (0,), np.int64, maxshape=(None,), chunks=(1024,))
        file.create_dataset("gain", (0,), np.float64, maxshape=(None,), chunks=(1024,))
        shape, uint8 = self._shape, np.dtype(np.uint8)
        file.create_dataset(
            "image", (0, *shape), uint8, maxshape=(None, *shape), chunks=(1, *shape),
            **COMPRESSION[uint8],
        )  # fmt: skip

    def append(self, photo: Photo) -> None:
        """Adds a picture.

        Raises:
            InputError: of another size, or not after the picture before.
        """
        if photo.image.shape != self._shape:
            raise InputError(f"picture of shape {photo.image.shape}: this file needs {self._shape}")
        if not self._last_us <= photo.start_us < photo.end_us:
            raise InputError(
                f"picture from {photo.start_us} to {photo.end_us} µs, and one before until "
                f"{self._last_us} µs: pictures come one after the other"
            )
        self._last_us = photo.end_us
        file = self._hdf5.file
        index = file["gain"].shape[0]
        for name, value in photo._asdict().items():
            file[name].resize(index + 1, axis=0)
            file[name][index] = value
        self._hdf5.check()

    def close(self) -> None:
        """Closes the file."""
        self._hdf5.close()

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class FrameReader:
    """Reads single pictures.

    Raises:
        InputError: a missing or truncated file, or one of another layout.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with open_hdf5(self.path) as file:
            self._start_us: NDArray[np.int64] = file["start_us"][:]
            self._end_us: NDArray[np.int64] = file["end_us"][:]
            self._gain: NDArray[np.float64] = file["gain"][:]
            count = file["image"].shape[0]
        if not len(self._start_us) == len(self._end_us) == len(self._gain) == count:
            raise InputError(f"{self.path}: times, gains and pictures differ in number")

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
