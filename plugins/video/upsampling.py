"""Frames between frames, made by functions of others: interpolators such as FILM or RIFE."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import entry_points
from typing import Any, TypeVar, cast

import numpy as np

from eventsweep.emvs.errors import InputError, heed_interrupt, said, shown
from eventsweep.emvs.utils.plugins import FUNCTION, named
from eventsweep.plugins.video.frames import Frame
from eventsweep.plugins.video.images import Image

GROUP = "eventsweep.upsamplers"
Value = TypeVar("Value")
Upsampler = Callable[[Image, Image, int, int], Iterable[tuple[int, Image]]]
"""Takes two frames, as they are in the files, and their times in µs; gives times between these, in
order, and the frames then, of the same shape and type."""


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
        t_us, image = _checked(pair, after, where)
        if not last_us < t_us < after.t_us:
            raise InputError(
                f"{where}: a frame at {t_us} µs; needs increasing times between {before.t_us} "
                f"and {after.t_us} µs"
            )
        last_us = t_us
        yield Frame(t_us, image, f"the frame at {t_us} µs of {name}")


def _checked(pair: Any, like: Frame, where: str) -> tuple[int, Image]:
    try:
        t_us, image = pair
        time_us, picture = int(t_us), np.asarray(image)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: gave {shown(pair)}; needs pairs (t_us, frame)") from error
    if (picture.shape, picture.dtype) != (like.image.shape, like.image.dtype):
        raise InputError(
            f"{where}: a frame {picture.shape} of {picture.dtype}; needs {like.image.shape} of "
            f"{like.image.dtype}, as the frames it is given"
        )
    return time_us, picture


def _guarded(call: Callable[[], Value], where: str) -> Value:
    try:
        return call()
    except Exception as error:  # whatever a stranger's code raises
        heed_interrupt(error)
        raise InputError(f"{where} fails ({said(error)}): fix it, or leave it out") from error
