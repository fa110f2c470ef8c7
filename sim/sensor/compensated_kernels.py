"""Events of ideal pixels between two fine frames: compiled; steps as fine as thresholds ask for.

The pixels of an image row take their steps side by side, one step each in turn: what one step waits
for, memory and divisions, is hidden behind the steps of the others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.layer_kernels import (
    NUMBERS,
    Layered,
    begin_layers,
    layered_light,
)
from eventsweep.sim.compensation.layer_search_kernels import MOST
from eventsweep.sim.compensation.path_kernels import (
    FAST,
    NO_ARRAYS,
    Geometry,
    View,
    light_at,
    paths_of_row,
    places_on,
)
from eventsweep.sim.sensor.esim_kernels import NEAR, level_of, number_of_falls, number_of_rises

# Steps are never shorter and never longer than this way, px.
_LEAST_PX, _MOST_PX = 0.1, 1.0
_FIRST_ROOM = 4096
_NONE: int = np.int64(0)  # type: ignore[assignment]  # numba compiles once more for a literal
# What is known of each pixel of a row, behind its path: the time it has come to, and the light
# there and at the end; where it may rise and fall; how fast light can change; pixels per way; and
# the step that it takes.
_WAY = 8
_TIME, _LIGHT, _LAST, _RISE, _FALL, _RATE, _PER_PX, _THEN, _SEEN = range(9, 18)
_ROWS = 18


class Frames(NamedTuple):
    """The light of both frames.

    Attributes:
        light_a: on the grid of the first frame.
        light_b: on the grid of the second.
        slope_a: (H + 2 B, W + 2 B) steepest light around each place of the first, per px.
        slope_b: of the second.
        grid: nodes per pixel and axis.
        border: B, pixels between the grid's first node and the sensor's.
        low: (H, W) least light within reach of a pixel in both frames.
        high: (H, W) greatest.
    """

    light_a: NDArray[np.float32]
    light_b: NDArray[np.float32]
    slope_a: NDArray[np.float32]
    slope_b: NDArray[np.float32]
    grid: int
    border: int
    low: NDArray[np.float32]
    high: NDArray[np.float32]


class Pixels(NamedTuple):
    """What the pixels remember, in and out, and when they fire.

    Attributes:
        reference: (P,) as in `sim.sensor.esim_kernels.find`.
        memory: (P,) records of `sim.sensor.esim_kernels.PIXEL`.
        c_pos: threshold C+.
        c_neg: threshold C-.
        log_eps: added to light before the logarithm.
    """

    reference: NDArray[np.float64]
    memory: NDArray[np.void]
    c_pos: float
    c_neg: float
    log_eps: float


@numba.njit(cache=True, nogil=True, fastmath=FAST, **NO_ARRAYS)
def thresholds(
    pixels: Pixels, rise_light: NDArray[np.float64], fall_light: NDArray[np.float64]
) -> None:
    """Fills the light, (P,) each, at which pixels may rise and fall: their levels, undone by exp.

    Slightly too near, so that whoever decides by logarithms is always asked.
    """
    reference, _, c_pos, c_neg, log_eps = pixels
    for k in range(len(reference)):
        rise_light[k] = math.exp(reference[k] + c_pos - NEAR) - log_eps
        fall_light[k] = math.exp(reference[k] - c_neg + NEAR) - log_eps


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def slope_at(slope: NDArray[np.float32], u: float, v: float) -> float:
    """Steepest light around a place, px from the corner; beyond the edge that of the edge."""
    i = np.uint64(min(max(v, 0.0), slope.shape[0] - 1.0))
    j = np.uint64(min(max(u, 0.0), slope.shape[1] - 1.0))
    return slope[i, j]  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
def levels_passed(
    rises: bool, log: float, first: float, up: int, down: int, c_pos: float, c_neg: float
) -> int:
    """How many levels `log` reaches, above the reference or below it."""
    if rises:
        return number_of_rises(log, first, up, down, c_pos, c_neg)  # type: ignore[no-any-return]
    return number_of_falls(log, first, up, down, c_pos, c_neg)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def between(level: float, log_s: float, log_e: float, s: float, e: float) -> float:
    """When the logarithm reaches a level if it goes straight from one time to another."""
    share = (level - log_s) / (log_e - log_s) if log_e != log_s else 1.0
    return s + min(max(share, 0.0), 1.0) * (e - s)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def light_between(
    frames: Frames, places: tuple[float, float, float, float], s: float
) -> tuple[float, float]:
    """Light at time s of what lies at some places of both frames; and how far those are apart."""
    grid = frames.grid
    before = light_at(frames.light_a, grid * places[0], grid * places[1])
    behind = light_at(frames.light_b, grid * places[2], grid * places[3])
    return before + s * (behind - before), np.float64(abs(behind - before))


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def rate_at(
    frames: Frames, places: tuple[float, float, float, float], way_px: float, apart: float
) -> float:
    """How fast light can change from here on: by motion, and by how far the frames are apart."""
    a = slope_at(frames.slope_a, places[0], places[1])
    b = slope_at(frames.slope_b, places[2], places[3])
    return max(a, b) * way_px + apart + 1e-9  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def begin_row(
    y: int,
    pixels: NDArray[np.int64],
    frames: Frames,
    rise_light: NDArray[np.float64],
    fall_light: NDArray[np.float64],
    row: NDArray[np.float64],
) -> None:
    """Fills in what is known of some pixels of a row at the first frame, their paths given."""
    grid, border = frames.grid, frames.border
    i, y0 = grid * (y + border), np.float64(y + border)
    for x in pixels:
        j = grid * (x + border)
        row[_TIME, x], row[_LIGHT, x] = 0.0, frames.light_a[i, j]
        row[_LAST, x] = frames.light_b[i, j]
        row[_RISE, x], row[_FALL, x] = rise_light[x], fall_light[x]
        row[_PER_PX, x] = 1.0 / max(row[_WAY, x], 1e-6)
        places = places_on(np.float64(x + border), y0, row, x, 0.0)
        apart = abs(row[_LAST, x] - row[_LIGHT, x])
        row[_RATE, x] = rate_at(frames, places, row[_WAY, x], apart)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def step_of_row(
    y: int,
    pixels: NDArray[np.int64],
    frames: Frames,
    row: NDArray[np.float64],
    reached: NDArray[np.int64],
) -> int:
    """Takes one step with each of some pixels; fills in and counts those that reach a threshold."""
    n, border, y0 = 0, frames.border, np.float64(y + frames.border)
    for x in pixels:
        room = min(row[_RISE, x] - row[_LIGHT, x], row[_LIGHT, x] - row[_FALL, x])
        least, most = _LEAST_PX * row[_PER_PX, x], _MOST_PX * row[_PER_PX, x]
        then = row[_TIME, x] + min(max(room / row[_RATE, x], least), most)
        light = row[_LAST, x]
        if then < 1.0 - 0.5 * least:
            places = places_on(np.float64(x + border), y0, row, x, then)
            light, apart = light_between(frames, places, then)
            row[_RATE, x] = rate_at(frames, places, row[_WAY, x], apart)
        else:
            then = 1.0
        row[_THEN, x], row[_SEEN, x] = then, light
        reached[n] = x
        n += not (row[_FALL, x] < light < row[_RISE, x])
    return n


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
def end_step(pixels: NDArray[np.int64], row: NDArray[np.float64]) -> int:
    """Brings pixels to where their step leads; those not at the end yet come first: how many."""
    n = 0
    for x in pixels:
        row[_TIME, x], row[_LIGHT, x] = row[_THEN, x], row[_SEEN, x]
        pixels[n] = x
        n += row[_THEN, x] < 1.0
    return n


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def crossing(
    x: int,
    y: int,
    frames: Frames,
    row: NDArray[np.float64],
    level: float,
    log_eps: float,
    rises: bool,
    log_s: float,
    log_e: float,
) -> float:
    """When a pixel's light reaches a level within its step: the secant rule, twice.

    The logarithms of light are given, plus `log_eps`, at the step's beginning and end.
    """
    s, e = row[_TIME, x], row[_THEN, x]
    when = between(level, log_s, log_e, s, e)
    border = frames.border
    places = places_on(np.float64(x + border), np.float64(y + border), row, x, when)
    light, _ = light_between(frames, places, when)
    log_there = math.log(light + log_eps)
    if (log_there >= level) == rises:
        return between(level, log_s, log_there, s, when)  # type: ignore[no-any-return]
    return between(level, log_there, log_e, when, e)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=False)
def roomier(values: NDArray[np.int64], room: int) -> NDArray[np.int64]:
    """The same values in an array of `room`."""
    more = np.empty(room, np.int64)
    for n in range(len(values)):  # as a slice it would compile two seconds longer
        more[n] = values[n]
    return more


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
def append_by_column(
    columns: NDArray[np.int64],
    found: NDArray[np.int64],
    n: int,
    first: int,
    ends: NDArray[np.int64],
    pixel: NDArray[np.int64],
    event: NDArray[np.int64],
) -> None:
    """Writes a row's events behind the first `n`, pixel by pixel, each pixel's in their order."""
    ends[:] = 0
    for x in columns:
        ends[x + 1] += 1
    for x in range(len(ends) - 1):
        ends[x + 1] += ends[x]
    for m in range(len(columns)):
        x = columns[m]
        pixel[n + ends[x]], event[n + ends[x]] = first + x, found[m]
        ends[x] += 1


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True)
def crossings(
    x: int, k: int, s: float, e: float, light_s: float, light_e: float, rises: bool,
    pixels: Pixels, rise_row: NDArray[np.float64], fall_row: NDArray[np.float64], step_us: int,
    n: int, columns: NDArray[np.int64], found: NDArray[np.int64],
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Appends the events of one short step of pixel `k`, in column `x`.

    The logarithm of light is taken as straight from time `s` to `e`; `rises` says whether a
    threshold is reached upwards, and the rest is as in `layered_events`.
    """
    reference, memory, c_pos, c_neg, log_eps = pixels
    first, up, down = memory[k].first_log, memory[k].up, memory[k].down
    log_s, log_e = math.log(light_s + log_eps), math.log(light_e + log_eps)
    number = levels_passed(rises, log_e, first, up, down, c_pos, c_neg)
    if n + number > len(columns):
        columns, found = roomier(columns, 2 * (n + number)), roomier(found, 2 * (n + number))
    for m in range(n, n + number):
        up, down = up + rises, down + (not rises)
        level = level_of(first, up, down, c_pos, c_neg)
        when = between(level, log_s, log_e, s, e)
        columns[m], found[m] = x, 2 * min(max(int(np.rint(when * step_us)), 1), step_us) + rises
    memory[k].up, memory[k].down = up, down
    reference[k] = level_of(first, up, down, c_pos, c_neg)
    rise_row[x] = math.exp(reference[k] + c_pos - NEAR) - log_eps
    fall_row[x] = math.exp(reference[k] - c_neg + NEAR) - log_eps
    return n + number, columns, found


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True)
def layered_events(
    y: int, frames: Frames, layered: Layered, view: View, pixels: Pixels,
    rise_row: NDArray[np.float64], fall_row: NDArray[np.float64], step_us: int,
    numbers: NDArray[np.float64], n: int, columns: NDArray[np.int64], found: NDArray[np.int64],
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Appends the events of a row's pixels that see several surfaces.

    A step goes as far as an edge of the greatest contrast within reach may go before it reaches a
    threshold, at least 0.1 px.

    Args:
        y: row.
        frames: light of both.
        layered: these pixels.
        view: without a border.
        pixels: all pixels' memory.
        rise_row: in and out, (W,) of `thresholds`.
        fall_row: in and out, (W,) likewise.
        step_us: time from the first frame to the second, µs.
        numbers: memory for `begin_layers`.
        n: events of the row so far.
        columns: their columns, and room for more.
        found: 2 x time after the first frame, µs, + polarity.

    Returns:
        How many events there are then, and where: `columns` and `found`, or roomier ones.
    """
    light_a, light_b, grid, border = frames.light_a, frames.light_b, frames.grid, frames.border
    layers, low, high = layered.layers, frames.low[y], frames.high[y]
    for x in range(len(low)):
        slot = layers.slot[y, x]
        if slot < 0:
            continue
        dark, bright = min(layers.dark[slot], low[x]), max(layers.bright[slot], high[x])
        if bright < rise_row[x] and dark > fall_row[x]:
            continue
        i, j = grid * (y + border), grid * (x + border)
        way_px = begin_layers(x, y, layers, slot, view, numbers)
        per_px, rate = 1.0 / max(way_px, 1e-6), bright - dark + 1e-9
        time, light = 0.0, 1.0 * light_a[i, j]
        while time < 1.0:
            room = min(rise_row[x] - light, light - fall_row[x])
            then = time + per_px * min(max(room / rate, _LEAST_PX), _MOST_PX)
            seen = 1.0 * light_b[i, j]  # a double, whatever is drawn
            if then < 1.0 - 0.5 * _LEAST_PX * per_px:
                seen, _ = layered_light(x, y, layered, slot, numbers, then)
            else:
                then = 1.0
            if not (fall_row[x] < seen < rise_row[x]):
                n, columns, found = crossings(
                    x, y * len(low) + x, time, then, light, seen, bool(seen >= rise_row[x]),
                    pixels, rise_row, fall_row, step_us, n, columns, found,
                )  # fmt: skip
            time, light = then, seen
    return n, columns, found


@numba.njit(cache=True, nogil=True, fastmath=FAST)
def events_between(
    frames: Frames,
    layered: Layered,
    geometry: Geometry,
    pixels: Pixels,
    rise_light: NDArray[np.float64],
    fall_light: NDArray[np.float64],
    step_us: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Follows every pixel that can reach a threshold from one frame to the next.

    A step goes as far as the light cannot reach a threshold, by the steepest slope around the place
    in both frames. A crossing is found by the secant rule, in the logarithm of light, twice.

    Args:
        frames: light of both.
        layered: the pixels that see several surfaces.
        geometry: of all pixels.
        pixels: in and out.
        rise_light: (P,) of `thresholds`.
        fall_light: (P,) likewise.
        step_us: time from the first frame to the second, µs.

    Returns:
        (N,) pixels, the events of each in order of time; times after the first frame, 1 to
        `step_us`, µs; polarities.
    """
    reference, memory, c_pos, c_neg, log_eps = pixels
    height, width = geometry.rho_a.shape
    row, chosen, reached = np.empty((_ROWS, width)), np.arange(width), np.arange(width)
    pixel, event = np.empty(_FIRST_ROOM, np.int64), np.empty(_FIRST_ROOM, np.int64)
    columns, found = np.empty(_FIRST_ROOM, np.int64), np.empty(_FIRST_ROOM, np.int64)
    ends, total = np.empty(width + 1, np.int64), _NONE
    numbers = np.empty((MOST, NUMBERS))
    for y in range(height):
        first_pixel, left, n = y * width, 0, _NONE
        rise_row = rise_light[first_pixel : first_pixel + width]
        fall_row = fall_light[first_pixel : first_pixel + width]
        for x in range(width):
            chosen[left] = x
            reaches = not (frames.high[y, x] < rise_row[x] and frames.low[y, x] > fall_row[x])
            left += reaches and layered.layers.slot[y, x] < 0
        paths_of_row(y, chosen[:left], geometry, row)
        begin_row(y, chosen[:left], frames, rise_row, fall_row, row)
        while left:
            crossed = step_of_row(y, chosen[:left], frames, row, reached)
            for x in reached[:crossed]:
                k = first_pixel + x
                rises = bool(row[_SEEN, x] >= row[_RISE, x])
                first, up, down = memory[k].first_log, memory[k].up, memory[k].down
                log_s, log_e = math.log(row[_LIGHT, x] + log_eps), math.log(row[_SEEN, x] + log_eps)
                number = levels_passed(rises, log_e, first, up, down, c_pos, c_neg)
                if n + number > len(columns):
                    columns = roomier(columns, 2 * (n + number))
                    found = roomier(found, 2 * (n + number))
                for m in range(n, n + number):
                    up, down = up + rises, down + (not rises)
                    level = level_of(first, up, down, c_pos, c_neg)
                    when = crossing(x, y, frames, row, level, log_eps, rises, log_s, log_e)
                    after_us = min(max(int(np.rint(when * step_us)), 1), step_us)
                    columns[m], found[m] = x, 2 * after_us + rises
                n += number
                memory[k].up, memory[k].down = up, down
                reference[k] = level_of(first, up, down, c_pos, c_neg)
                row[_RISE, x] = math.exp(reference[k] + c_pos - NEAR) - log_eps
                row[_FALL, x] = math.exp(reference[k] - c_neg + NEAR) - log_eps
            left = end_step(chosen[:left], row)
        n, columns, found = layered_events(
            y, frames, layered, geometry.lens_view, pixels, rise_row, fall_row, step_us, numbers,
            n, columns, found,
        )  # fmt: skip
        if total + n > len(pixel):
            pixel, event = roomier(pixel, 2 * (total + n)), roomier(event, 2 * (total + n))
        append_by_column(columns[:n], found[:n], total, first_pixel, ends, pixel, event)
        total += n
    return pixel[:total], event[:total] >> 1, (event[:total] & 1).astype(np.uint8)
