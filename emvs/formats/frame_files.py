"""Pictures of a camera as image files, and the text files with their times."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.errors import InputError, refused
from eventsweep.emvs.formats.depth import check_pixels, read_grey
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, read_text

_LARGEST_US = 1 << 62


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


def read_times_us(path: Path, columns: int, unit: str = "us") -> NDArray[np.int64]:
    """(T, columns) µs of a file with one line per image; `#` begins a comment.

    Its numbers are whole µs, or those of another unit, `s`.
    """
    faults = OSError, ValueError, ArithmeticError
    needed = "whole µs" if unit == "us" else f"times in {unit}"
    cure = f"; needs {columns} {needed} in each line"
    with refused(f"{path}: cannot be read as times", *faults, cure=cure):
        lines = read_text(path, TABLE_BYTES, "ascii").splitlines()
        rows = [line.replace(",", " ").split() for line in lines if line.strip()]
        read = int if unit == "us" else _of_seconds
        values = [[read(word) for word in row[:columns]] for row in rows if row[0][0] != "#"]
        table = np.array(values, np.int64).reshape(len(values), columns)
        if (table < 0).any() or (table > _LARGEST_US).any():
            raise ValueError("a time below 0 or beyond 2^62")
    return table


def _of_seconds(word: str) -> int:
    """A time in µs, exact however large it is."""
    t_us = Decimal(word) * 10**6
    if not abs(t_us) <= _LARGEST_US:
        raise ValueError(f"{word[:40]} s is beyond 2^62 µs")
    return round(t_us)


def image_files(
    images: Path, pattern: str, start_us: NDArray[np.int64], end_us: NDArray[np.int64]
) -> ImageFiles:
    """The images of a folder, in order of their names, opened and closed at times (T,), µs."""
    read = read_grey if pattern == "*.png" else read_jpeg
    return ImageFiles(tuple(sorted(images.glob(pattern))), start_us, end_us, read)


def read_jpeg(path: Path) -> NDArray[np.uint8]:
    """Reads a JPEG as (H, W) grey levels.

    Raises:
        InputError: an unreadable or damaged file, or more than 2^26 pixels.
    """
    from PIL import Image

    # Pillow ends in many kinds of exception on damaged files
    with refused(f"{path}: not a complete JPEG", Exception, cure="; download it again"):
        check_file(path, TABLE_BYTES)
        with Image.open(io.BytesIO(path.read_bytes()), formats=("JPEG",)) as image:
            check_pixels(path, *image.size)
            return np.asarray(image.convert("L"))
