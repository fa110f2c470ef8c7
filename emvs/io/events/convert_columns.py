"""Columns of any numeric type to events, refusing what would have to be clipped."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.indexed import checked_times

Numbers = NDArray[Any]


def to_events(
    where: str, x: Numbers, y: Numbers, t: Numbers, p: Numbers, unit_s: float | None
) -> Events:
    """Events from columns of one length.

    Args:
        where: file and place, for the errors' sake.
        x: (N,) columns, px.
        y: (N,) rows, px.
        t: (N,) times in `unit_s`.
        p: (N,) polarity: 0 or -1 for darker, 1 for brighter.
        unit_s: what times count, s; None: µs where whole numbers, seconds where floating.

    Raises:
        InputError: a value that is not finite, whole (pixels) or in range.
    """
    if unit_s is None:
        unit_s = 1.0 if t.dtype.kind == "f" else 1e-6
    t_us = times_us(where, t, unit_s)
    columns = _pixels(where, "x", x), _pixels(where, "y", y)
    return checked_times(Events(*columns, t_us, _polarity(where, p)), where)


def times_us(where: str, t: Numbers, unit_s: float) -> NDArray[np.int64]:
    """Times in whole µs, rounded to the nearest."""
    if t.dtype.kind == "f":
        with np.errstate(over="ignore", invalid="ignore"):
            t_us = t.astype(np.float64) * (unit_s * 1e6)
        _refuse(where, "t", t, ~(np.abs(t_us) < 2.0**62), "finite times below 2^62 µs")
        return np.rint(t_us).astype(np.int64)
    _refuse(where, "t", t, t > np.iinfo(np.int64).max // 2, "times below 2^62")
    whole = t.astype(np.int64, copy=False)
    if unit_s == 1e-9:
        return (whole + 500) // 1000
    if unit_s == 1.0:
        _refuse(where, "t", t, np.abs(whole) >= 1 << 42, "times below 2^42 s")
        return whole * 1_000_000
    return whole


def _pixels(where: str, name: str, values: Numbers) -> NDArray[np.uint16]:
    if values.dtype == np.uint16:
        return values
    with np.errstate(invalid="ignore"):
        bad = ~((values >= 0) & (values <= 65535))
        if values.dtype.kind == "f":
            bad |= values != np.floor(values)
    _refuse(where, name, values, bad, "whole pixels from 0 to 65535")
    return values.astype(np.uint16)


def _polarity(where: str, values: Numbers) -> NDArray[np.uint8]:
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    bad = (values != 0) & (values != 1)
    if values.dtype.kind != "u":
        bad &= values != -1
    _refuse(where, "p", values, bad, "0 or 1, or -1 or 1")
    return (values > 0).astype(np.uint8)


def _refuse(where: str, name: str, values: Numbers, bad: NDArray[np.bool_], needs: str) -> None:
    if bad.any():
        k = int(np.argmax(bad))
        raise InputError(
            f"{where}: {name} of event {k} is {values[k]}, needs {needs}: the file is damaged or "
            "its columns mean something else"
        )
