"""A video in front of a sensor: its frames as light, frames in between, the events of both.

Frames in between are made by functions of other packages: interpolators such as FILM or RIFE.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import entry_points
from itertools import chain
from typing import Any, TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, heed_interrupt, said, shown
from eventsweep.emvs.utils.plugins import FUNCTION, named
from eventsweep.plugins.video.doubts import Doubts
from eventsweep.plugins.video.frames import Frame, Frames, checked
from eventsweep.plugins.video.images import Image
from eventsweep.sim.config import Encoding, PixelConfig, VideoConfig
from eventsweep.sim.sensor.labels import LabelledEvents
from eventsweep.sim.sensor.sensor import Sensor

Item = TypeVar("Item")
GROUP = "eventsweep.upsamplers"
Upsampler = Callable[[Image, Image, int, int], Iterable[tuple[int, Image]]]
"""Takes two frames, as they are in the files, and their times in µs; gives times between these, in
order, and the frames then, of the same shape and type."""
TOO_FAST = 0.2
"""Frames are too far apart where half their rate would lose a larger share of events, see `Pace`.
"""
_SAMPLED_PIXELS = 1 << 14
# Luminance of linear red, green and blue with BT.709's primaries, which sRGB shares.
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_DEFAULT_GAMMA = 2.2


class Film:
    """Frames that a sensor watches: iterating gives the events between each two of them.

    The first frame is read at once: it says how large the sensor is.

    Attributes:
        frames: where they come from.
        pixels: how light becomes events.
        video: what light the frames stand for, and what puts more of them in between.
        seed: of all that the sensor draws.
        light: what turns frames into light.
        width_px, height_px: of the frames.
        count: frames so far, those in between included.
        events: events so far.
        span_us: times of the first frame and of the latest.
        pace: whether frames are close enough together.
        doubts: what seems wrong with the frames as they are in the files.

    Raises:
        InputError: no frame that can be read, or no function of the name to put frames in between.
    """

    def __init__(self, frames: Frames, pixels: PixelConfig, video: VideoConfig, seed: int) -> None:
        self.frames, self.pixels, self.video, self.seed = frames, pixels, video, seed
        self.doubts = Doubts(frames.path, video, pixels)
        sources: Iterable[Frame] = self.doubts.watched(checked(frames, frames.path))
        if video.upsample is not None:
            sources = upsampled(sources, find_upsampler(video.upsample), video.upsample)
        self._rest = iter(sources)
        first = next(self._rest)
        self.height_px, self.width_px = first.image.shape[:2]
        self.light = Light(first.image.dtype, video)
        self._first = first
        self.sensor = Sensor(0, self.width_px, self.height_px, pixels, seed)
        self.pace = Pace(pixels)
        self.count = self.events = 0
        self.span_us = first.t_us, first.t_us

    def __iter__(self) -> Generator[LabelledEvents]:
        """Packets in order of time, one from each frame to the next.

        Raises:
            InputError: a frame that cannot be read, does not fit the others, or is no light.
        """
        for frame, light in ahead(self._lit()):
            self.pace.take(light)
            if not self.count:
                self.sensor.start(light, frame.t_us)
            else:
                labelled = self.sensor.step(light, frame.t_us)
                self.events += len(labelled)
                self.span_us = self.span_us[0], frame.t_us
                yield labelled
            self.count += 1
        self.sensor.finish()

    def _lit(self) -> Iterator[tuple[Frame, NDArray[np.float32]]]:
        """Frames and their light."""
        for frame in chain([self._first], self._rest):
            light = self.light(frame.image)
            low, high = float(light.min()), float(light.max())
            if not (low >= 0 and np.isfinite(high)):
                raise InputError(
                    f"{self.frames.path}: {frame.name} decodes to light from {low:g} to {high:g} "
                    f"({self.light.said}); needs finite values of at least 0"
                )
            yield frame, light


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The items, each made in a thread while the one before is at work."""
    nothing = object()
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, items, nothing)
        while (item := coming.result()) is not nothing:
            coming = thread.submit(next, items, nothing)
            yield item  # type: ignore[misc]


class Pace:
    """Whether frames are close enough together for straight lines between them.

    Of every three frames in a row: how much less a pixel's logarithm would have moved, in all, had
    the middle one been missing. Summed over all pixels that moved by at least a contrast threshold,
    this is the share of the events that half the frame rate would have lost. It is 0 where every
    pixel only rises or only falls within three frames, and 1/2 where frames have nothing to do with
    one another; what the full rate itself loses is less, and of the same order. About 2^14 pixels,
    evenly spread, are looked at.
    """

    def __init__(self, pixels: PixelConfig) -> None:
        self._threshold = min(pixels.contrast_threshold_pos, pixels.contrast_threshold_neg)
        self._log_eps = np.float32(pixels.log_eps)
        self._latest: list[NDArray[np.float32]] = []
        self._moved = self._lost = 0.0

    @property
    def lost_at_half_rate(self) -> float:
        """Share of the events that would be missing without every second frame, 0 to 1."""
        return max(0.0, self._lost / self._moved) if self._moved else 0.0

    def take(self, light: NDArray[np.float32]) -> None:
        """Looks at the next frame (H, W)."""
        stride = max(1, int((light.size / _SAMPLED_PIXELS) ** 0.5))
        log = np.log(light[::stride, ::stride] + self._log_eps)
        if len(self._latest) == 2:
            first, middle = self._latest
            moved = np.abs(middle - first) + np.abs(log - middle)
            events = moved >= self._threshold
            self._moved += float(moved[events].sum())
            self._lost += float((moved - np.abs(log - first))[events].sum())
        self._latest = [*self._latest[-1:], log]


def _srgb(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1."""
    bent = ((np.maximum(value, 0) + 0.055) / 1.055) ** 2.4
    return np.where(value <= 0.04045, value / 12.92, bent)


class Light:
    """Turns images of one kind, uint8, uint16 or float32, into light.

    Raises:
        InputError: logarithms in whole numbers.
    """

    def __init__(self, kind: np.dtype[Any], video: VideoConfig) -> None:
        whole = kind.kind == "u"
        self.encoding: Encoding = video.encoding or ("srgb" if whole else "linear")
        if self.encoding == "log" and whole:
            raise InputError(
                f"encoding log of {kind} images: integers cannot hold logarithms; needs float "
                "images with ln of intensity"
            )
        gamma = video.gamma or _DEFAULT_GAMMA
        decoders: dict[Encoding, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
            "srgb": _srgb, "gamma": lambda v: v**gamma, "linear": lambda v: v, "log": np.exp,
        }  # fmt: skip
        self._decode = decoders[self.encoding]
        self.full_scale = video.full_scale or (float(np.iinfo(kind).max) if whole else 1.0)
        self.said = f"{self.encoding} {gamma:g}" if self.encoding == "gamma" else self.encoding
        if whole:
            table = self._decode(np.arange(np.iinfo(kind).max + 1) / self.full_scale)
            self._grey, *self._colours = [
                (weight * table).astype(np.float32) for weight in (1.0, *_LUMINANCE)
            ]

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """(H, W) linear intensity of an image: of colours their luminance."""
        if image.dtype.kind == "f":
            decoded = self._decode(np.divide(image, self.full_scale, dtype=np.float64))
            grey = decoded if image.ndim == 2 else decoded @ _LUMINANCE
            return np.asarray(grey, np.float32)
        if image.ndim == 2:
            return _looked_up(image, self._grey)
        red, green, blue = (
            _looked_up(image[..., k], table) for k, table in enumerate(self._colours)
        )
        red += green
        red += blue
        return red


def _looked_up(plane: Image, table: NDArray[np.float32]) -> NDArray[np.float32]:
    if plane.dtype == np.uint8:  # faster than NumPy's look-up
        return np.asarray(cv2.LUT(np.ascontiguousarray(plane), table))
    return table[plane]


def find_upsampler(name: str) -> Upsampler:
    """The function of a name: MODULE:FUNCTION, FILE.py:FUNCTION, or an entry point of `GROUP`.

    Raises:
        InputError: there is none, or what defines it cannot be imported.
    """
    try:
        function = _named(name)
    except InputError as error:
        raise InputError(f"upsample {name}: {error}") from error
    except Exception as error:  # whatever a stranger's code raises
        heed_interrupt(error)
        raise InputError(f"upsample {name}: cannot be imported ({said(error)}); fix it") from error
    if not callable(function):
        raise InputError(f"upsample {name} is {shown(function)}: needs a function of two frames")
    return cast(Upsampler, function)


def _named(name: str) -> Any:
    if ":" in name:
        return named(name)
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name not in points:
        known = f"; registered are {', '.join(sorted(points))}" if points else ""
        raise InputError(f"needs {FUNCTION}{known}")
    return points[name].load()


def upsampled(frames: Iterable[Frame], upsample: Upsampler, name: str) -> Iterator[Frame]:
    """The frames in order of time, and between each two what the function makes of them.

    Raises:
        InputError: the function fails, or gives times or frames that do not belong between the two.
    """
    before: Frame | None = None
    for frame in frames:
        if before is not None:
            yield from _between(before, frame, upsample, name)
        before = frame
        yield frame


def _between(before: Frame, after: Frame, upsample: Upsampler, name: str) -> Iterator[Frame]:
    where = f"upsample {name} between {before.name} and {after.name}"
    seen, now = np.ascontiguousarray(before.image), np.ascontiguousarray(after.image)
    last_us = before.t_us
    made = _guarded(lambda: iter(upsample(seen, now, before.t_us, after.t_us)), where)
    while (pair := _guarded(lambda: next(made, None), where)) is not None:
        try:
            t_us, image = pair
            t_us, image = int(t_us), np.asarray(image)
        except (TypeError, ValueError) as error:
            raise InputError(f"{where}: gave {shown(pair)}; needs pairs (t_us, frame)") from error
        if (image.shape, image.dtype) != (now.shape, now.dtype):
            raise InputError(
                f"{where}: a frame {image.shape} of {image.dtype}; needs {now.shape} of "
                f"{now.dtype}, as the frames it is given"
            )
        if not last_us < t_us < after.t_us:
            raise InputError(
                f"{where}: a frame at {t_us} µs; needs increasing times between {before.t_us} "
                f"and {after.t_us} µs"
            )
        last_us = t_us
        yield Frame(t_us, image, f"the frame at {t_us} µs of {name}")


def _guarded(call: Callable[[], Item], where: str) -> Item:
    try:
        return call()
    except Exception as error:  # whatever a stranger's code raises
        heed_interrupt(error)
        raise InputError(f"{where} fails ({said(error)}): fix it, or leave it out") from error
