"""Frames with times: of a folder of images, or of a video file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.stamps import STAMP_FILES, Stamps, read_stamps
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats.depth import check_pixels, quiet_opencv
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.emvs.utils.processes import bounded
from eventsweep.plugins.video.images import READERS, Image, read_image
from eventsweep.sim.config import VideoConfig

IMAGE_FOLDERS = ("imgs", "images")
"""Where images lie beside the file of their times, in the layouts of vid2e and others."""
# FFmpeg tells of damage on the error stream by itself. Only its first use in a process heeds this.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
# What the first frames of a video may take: memory, more for a larger file, and computing.
_BEGIN_BYTES, _BEGIN_RATIO, _BEGIN_S = 448 << 20, 256, 20
_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
# FFmpeg would read what a playlist names, and wait half a minute for one of HLS to grow.
_PLAYLIST = re.compile(rb"(\xef\xbb\xbf)?\s*(#EXTM3U|ffconcat)", re.IGNORECASE)
# A stream without container, for which FFmpeg makes up 25 Hz: JPEG after JPEG, or MPEG's start
# codes of anything but a program stream's pack.
_BARE = re.compile(rb"\xff\xd8\xff|\0{2,3}\x01(?!\xba|ftyp)")


class Frame(NamedTuple):
    """One frame: when it was taken, its values, not yet light, and what errors call it."""

    t_us: int
    image: Image
    name: str


class Frames(Protocol):
    """Frames in order of time, read one after the other."""

    @property
    def path(self) -> Path:
        """Where they come from."""

    @property
    def time_base(self) -> str:
        """What their times are taken from, in words."""

    @property
    def share(self) -> float:
        """How much of them was read, 0 to 1, for a bar that moves."""

    def __iter__(self) -> Iterator[Frame]:
        """Reads them."""

    def notes(self) -> list[str]:
        """What was left out, or seems wrong, a line each; complete when all were read."""


def open_frames(path: Path, video: VideoConfig) -> Frames:
    """Opens a folder of images with their times, or a video file; decodes nothing yet.

    Raises:
        InputError: nothing there, no images or times, a file of times that does not fit the images,
            or settings that say nothing of such a source.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; needs images or a video")
    if path.is_dir():
        return _folder(path, video)
    if path.suffix.lower() in READERS:
        raise InputError(f"{path}: is a single image; events need several, give their folder")
    if video.stamps is not None or video.unit is not None:
        raise InputError(f"{path}: stamps and unit are for images; for a video set rate_hz")
    return VideoFile(path, video)


def checked(frames: Iterable[Frame], where: Path) -> Iterator[Frame]:
    """The frames, as long as their times rise and all have the size and kind of the first.

    Raises:
        InputError: names the first that does not fit; or fewer than two came.
    """
    before: Frame | None = None
    number = 0
    for frame in frames:
        if before is not None:
            _check_follows(before, frame, where)
        before, number = frame, number + 1
        yield frame
    if number < 2:
        raise InputError(f"{where}: {number or 'no'} frame{'s' * (not number)}; events need two")


def _check_follows(before: Frame, frame: Frame, where: Path) -> None:
    if frame.t_us <= before.t_us:
        raise InputError(
            f"{where}: {frame.name} is at {frame.t_us} µs and {before.name} at {before.t_us} µs: "
            "times must increase by at least 1 µs; sort them, or set rate_hz"
        )
    seen, now = before.image, frame.image
    if (seen.shape, seen.dtype) != (now.shape, now.dtype):
        raise InputError(
            f"{where}: {frame.name} is {_kind(now)} and {before.name} {_kind(seen)}: all frames "
            "need one size and kind"
        )


def _kind(image: Image) -> str:
    colour = "colour" if image.ndim == 3 else "grey"
    return f"{image.shape[1]}x{image.shape[0]} {colour} {image.dtype}"


@dataclass
class ImageFolder:
    """Images in order of time, their times, µs, and what these are taken from."""

    path: Path
    files: tuple[Path, ...]
    t_us: tuple[int, ...]
    time_base: str
    _notes: list[str] = field(default_factory=list)
    _read: int = 0

    @property
    def share(self) -> float:
        """How much of them was read, 0 to 1."""
        return self._read / len(self.files)

    def __iter__(self) -> Iterator[Frame]:
        """Reads one image after the other."""
        for file, t_us in zip(self.files, self.t_us, strict=True):
            self._read += 1
            yield Frame(t_us, read_image(file), file.name)

    def notes(self) -> list[str]:
        """Files that were left out."""
        return self._notes


def _folder(path: Path, video: VideoConfig) -> ImageFolder:
    if video.slow_motion != 1:
        raise InputError(
            f"{path}: slow_motion is for video files; images have times of their own, or set "
            "rate_hz"
        )
    listed = video.stamps or next(
        (path / name for name in STAMP_FILES if (path / name).exists()), None
    )
    images, others = _listing(path)
    if video.rate_hz is not None:
        _check_one_kind(path, images)
        t_us = tuple(round(k * 1e6 / video.rate_hz) for k in range(len(images)))
        folder = ImageFolder(path, tuple(images), t_us, f"{video.rate_hz:g} Hz as stated")
        folder._notes += _missing_numbers(path, images)
    elif listed is None:
        raise InputError(
            f"{path}: no times; add timestamps.txt with a line `t` or `t name` for each image "
            f"(or {', '.join(STAMP_FILES[1:])}), or set rate_hz"
        )
    else:
        folder = _by_stamps(path, images, listed, read_stamps(listed, video.unit))
    if others:
        folder._notes.append(f"{path}: no images, left out: {quoted(*others)}")
    return folder


def _listing(path: Path) -> tuple[list[Path], list[str]]:
    """The images by name, numbers counted as such, and what else lies beside them."""
    beside = _files(path)
    images = [file for file in beside if file.suffix.lower() in READERS]
    below = [path / name for name in IMAGE_FOLDERS if (path / name).is_dir()]
    if not images and below:
        images = [file for file in _files(below[0]) if file.suffix.lower() in READERS]
    known = {*STAMP_FILES, *(image.name for image in images)}
    return images, sorted(file.name for file in beside if file.name not in known)


def _files(folder: Path) -> list[Path]:
    files = (file for file in folder.iterdir() if file.name[0] != "." and not file.is_dir())
    return sorted(files, key=_by_number)


def _by_number(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorts `9.png` before `10.png`, and what has no numbers by its letters."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name


def _missing_numbers(path: Path, images: list[Path]) -> list[str]:
    """Says where the names of images at a stated rate jump: a missing one moves all after it."""
    digits = ["".join(filter(str.isdecimal, image.stem)) for image in images]
    if not all(digits):
        return []
    steps = np.diff([int(digit) for digit in digits])
    usual = int(steps.min())
    if usual < 1 or not (jumps := np.flatnonzero(steps > usual)).size:
        return []
    lacking = int((steps // usual - 1).sum())
    return [
        f"{path}: {lacking} numbers of images are missing, the first after {images[jumps[0]].name}"
        ": times are counted without them; give the times of all images if frames were lost"
    ]


def _by_stamps(path: Path, images: list[Path], listed: Path, stamps: Stamps) -> ImageFolder:
    base = f"{listed.name} in {stamps.unit}"
    if not stamps.names:
        _check_one_kind(path, images)
        if len(images) != len(stamps.t_us):
            raise InputError(
                f"{listed}: {len(stamps.t_us)} times for {len(images)} images in {path}; needs one "
                "for each image, or lines `t name`"
            )
        return ImageFolder(path, tuple(images), stamps.t_us, base)
    files = tuple(_named(listed, name) for name in stamps.names)
    _check_several(path, len(files))
    left_out = len({*images} - {*files})
    notes = [f"{path}: {left_out} images left out, which {listed.name} does not name"] * (
        left_out > 0
    )
    return ImageFolder(path, files, stamps.t_us, base, notes)


def _named(listed: Path, name: str) -> Path:
    """The image that a line names, in the folder of the list or in the usual one below it."""
    places = [listed.parent, *(listed.parent / folder for folder in IMAGE_FOLDERS)]
    inside = name.isprintable() and not name.startswith("/") and ".." not in Path(name).parts
    if inside and Path(name).suffix.lower() in READERS:
        for place in places:
            if os.path.isfile(place / name):  # noqa: PTH113 - bears a name that is too long
                return place / name
    kinds = ", ".join(READERS)
    raise InputError(f"{listed}: {quoted(name)} is not an image in this folder; needs {kinds}")


def _check_one_kind(path: Path, images: list[Path]) -> None:
    """Refuses images whose order their names do not say."""
    kinds = sorted({image.suffix.lower() for image in images})
    if len(kinds) > 1:
        raise InputError(
            f"{path}: images of several kinds, {', '.join(kinds)}: keep one, or name the images in "
            "images.txt, lines `t name`"
        )
    _check_several(path, len(images))


def _check_several(path: Path, number: int) -> None:
    if number < 2:
        kinds = ", ".join(READERS)
        raise InputError(f"{path}: {number} images; events need two or more, of {kinds}")


class VideoFile:
    """What OpenCV's FFmpeg decodes of a video file: 8 bits per channel, one frame at a time.

    Raises:
        InputError: no video, or a codec that is not there.
    """

    def __init__(self, path: Path, video: VideoConfig) -> None:
        check_file(path)
        if _starts(path, _PLAYLIST):
            raise InputError(f"{path}: is a playlist, not a video: give one of its videos")
        if video.rate_hz is None and _starts(path, _BARE):
            raise InputError(f"{path}: no time base in its video stream; set rate_hz")
        self.path, self._video = path, video
        self._try_out()
        capture = self._opened()
        self._declared = int(max(0, capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        capture.release()
        slowed = f", {video.slow_motion:g} times slower than life" * (video.slow_motion != 1)
        stated = f"{video.rate_hz:g} Hz as stated" if video.rate_hz else ""
        self.time_base = (stated or f"the file's own, {rate_hz:g} Hz on average") + slowed
        self._read = 0

    @property
    def share(self) -> float:
        """How much of it was read, 0 to 1; 0 where the file does not say its length."""
        return min(1.0, self._read / self._declared) if self._declared else 0.0

    def __iter__(self) -> Iterator[Frame]:
        """Decodes one frame after the other.

        Raises:
            InputError: not even the first frame can be decoded, or its time is not known.
        """
        capture = self._opened()
        try:
            for k, (image, t_ms) in enumerate(_decoded(capture)):
                self._read += 1
                playing_us = k * 1e6 / self._video.rate_hz if self._video.rate_hz else t_ms * 1e3
                if not np.isfinite(playing_us):
                    raise InputError(f"{self.path}: frame {k} has no time; set rate_hz")
                yield Frame(round(playing_us / self._video.slow_motion), image, f"frame {k}")
        finally:
            capture.release()
        if not self._read:
            raise InputError(f"{self.path}: no frame can be decoded; {_CURE}")

    def notes(self) -> list[str]:
        """Frames that the file declares, but that did not come."""
        lost = self._declared - self._read
        if not self._read or lost <= 0:
            return []
        return [
            f"{self.path}: {self._read} of {self._declared} declared frames could be read; its "
            "end may be missing"
        ]

    def _try_out(self) -> None:
        """Refuses what takes too much memory to begin: FFmpeg decodes before it tells sizes."""

        def begin() -> None:
            capture = self._opened(threads=1)  # what it takes depends on no number of cores
            all(capture.read()[0] for _ in range(2))

        size = self.path.stat().st_size
        room = _BEGIN_BYTES + _BEGIN_RATIO * size
        bounded(str(self.path), begin, memory_bytes=room, cpu_s=_BEGIN_S)

    def _opened(self, threads: int = 0) -> cv2.VideoCapture:
        """The file, read by so many threads; 0: as FFmpeg likes."""
        with quiet_opencv(), _local_files_only():
            asks = [cv2.CAP_PROP_N_THREADS, threads] if threads else []
            capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG, asks)
        if not capture.isOpened():
            raise InputError(f"{self.path}: cannot be opened as a video; {_CURE}")
        sides = (capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        check_pixels(self.path, *map(int, sides))
        return capture


_CURE = (
    "it is damaged, or OpenCV has no codec for it: convert it, ffmpeg -i IN -c:v ffv1 OUT.mkv, or "
    "into a folder of images"
)


@contextmanager
def _local_files_only() -> Iterator[None]:
    """Keeps FFmpeg from other hosts that a playlist may name; it reads the environment."""
    before = os.environ.get(_OPTIONS)
    os.environ[_OPTIONS] = "protocol_whitelist;file"
    try:
        yield
    finally:
        os.environ.pop(_OPTIONS)
        os.environ.update({} if before is None else {_OPTIONS: before})


def _starts(path: Path, pattern: re.Pattern[bytes]) -> bool:
    with path.open("rb") as file:
        return pattern.match(file.read(64)) is not None


def _decoded(capture: cv2.VideoCapture) -> Iterator[tuple[NDArray[np.uint8], float]]:
    """Red, green, blue and the time stamp in ms of every frame."""
    while True:
        came, image = capture.read()
        if not came:
            return
        yield np.asarray(image, np.uint8)[..., ::-1], capture.get(cv2.CAP_PROP_POS_MSEC)
