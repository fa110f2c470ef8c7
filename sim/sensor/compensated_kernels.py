"""Events of ideal pixels between two fine frames: compiled; steps as fine as thresholds ask for."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from sim.compensation.light_kernels import light_at
from sim.compensation.path_kernels import Path, path_of, places_on
from sim.sensor.esim_kernels import NEAR, level_of, number_of_falls, number_of_rises

# Steps are never shorter and never longer than this way, px.
_LEAST_PX, _MOST_PX = 0.1, 1.0
_FIRST_ROOM = 4096


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz", "reassoc", "contract", "arcp"})
def thresholds(
    reference: NDArray[np.float64],
    c_pos: float,
    c_neg: float,
    log_eps: float,
    rise_light: NDArray[np.float64],
    fall_light: NDArray[np.float64],
) -> None:
    """Fills the light, (P,) each, at which pixels may rise and fall: their levels, undone by exp.

    Slightly too near, so that whoever decides by logarithms is always asked.
    """
    for k in range(len(reference)):
        rise_light[k] = math.exp(reference[k] + c_pos - NEAR) - log_eps
        fall_light[k] = math.exp(reference[k] - c_neg + NEAR) - log_eps


@numba.njit(cache=True, nogil=True, inline="always")
def slope_at(slope: NDArray[np.float32], u: float, v: float) -> float:
    """Steepest light around a place, px from the corner; beyond the edge that of the edge."""
    i = np.uint64(min(max(v, 0.0), slope.shape[0] - 1.0))
    j = np.uint64(min(max(u, 0.0), slope.shape[1] - 1.0))
    return slope[i, j]  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, inline="always")
def levels_passed(
    rises: bool, log: float, first: float, up: int, down: int, c_pos: float, c_neg: float
) -> int:
    """How many levels `log` reaches, above the reference or below it."""
    if rises:
        return number_of_rises(log, first, up, down, c_pos, c_neg)
    return number_of_falls(log, first, up, down, c_pos, c_neg)


@numba.njit(cache=True, nogil=True, inline="always")
def between(level: float, log_s: float, log_e: float, s: float, e: float) -> float:
    """When the logarithm reaches a level if it goes straight from one time to another."""
    share = (level - log_s) / (log_e - log_s) if log_e != log_s else 1.0
    return s + min(max(share, 0.0), 1.0) * (e - s)


@numba.njit(cache=True, nogil=True, inline="always")
def crossing(
    light_a: NDArray[np.float32],
    light_b: NDArray[np.float32],
    grid: int,
    x: float,
    y: float,
    path: Path,
    level: float,
    log_eps: float,
    rises: bool,
    s: float,
    e: float,
    logs: tuple[float, float],
) -> float:
    """When light reaches a level between two times at which its logarithm is known: secants."""
    when = between(level, logs[0], logs[1], s, e)
    u_a, v_a, u_b, v_b = places_on(x, y, path, when)
    before = light_at(light_a, grid * u_a, grid * v_a)
    behind = light_at(light_b, grid * u_b, grid * v_b)
    log_there = math.log(before + when * (behind - before) + log_eps)
    if (log_there >= level) == rises:
        return between(level, logs[0], log_there, s, when)
    return between(level, log_there, logs[1], when, e)


@numba.njit(cache=True, nogil=True)
def silence(
    pixel: NDArray[np.int32],
    offset_us: NDArray[np.int64],
    before_us: int,
    refractory_us: int,
    memory: NDArray[np.void],
) -> None:
    """Puts 0 for the offset of each event in its pixel's refractory period; notes the others.

    Args:
        pixel: (N,) pixels; the events of each in order of time.
        offset_us: in and out, (N,) times after `before_us`, µs.
        before_us: µs.
        refractory_us: least time between two emitted events of a pixel, µs.
        memory: in and out, (P,) records of `sim.sensor.esim_kernels.PIXEL`.
    """
    for n in range(len(pixel)):
        t_us = before_us + offset_us[n]
        if t_us - memory[pixel[n]].last_emitted_us < refractory_us:
            offset_us[n] = 0
        else:
            memory[pixel[n]].last_emitted_us = t_us


@numba.njit(cache=True, nogil=True)
def roomier(values, room):  # type: ignore[no-untyped-def]
    """The same values in an array of `room`."""
    more = np.empty(room, values.dtype)
    more[: len(values)] = values
    return more


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz", "reassoc", "contract", "arcp"})
def events_between(
    light_a: NDArray[np.float32],
    light_b: NDArray[np.float32],
    grid: int,
    border: int,
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    slope_a: NDArray[np.float32],
    slope_b: NDArray[np.float32],
    bearing: NDArray[np.float32],
    rho_a: NDArray[np.float32],
    rho_b: NDArray[np.float32],
    body_a: NDArray[np.uint16],
    body_b: NDArray[np.uint16],
    ways: NDArray[np.float64],
    lens: NDArray[np.float64],
    reference: NDArray[np.float64],
    memory: NDArray[np.void],
    rise_light: NDArray[np.float64],
    fall_light: NDArray[np.float64],
    c_pos: float,
    c_neg: float,
    log_eps: float,
    before_us: int,
    step_us: int,
    refractory_us: int,
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.uint8]]:
    """Follows every pixel that can reach a threshold from one frame to the next.

    A step goes as far as the light cannot reach a threshold, by the steepest slope around the place
    in both frames. A crossing is found by the secant rule, in the logarithm of light, twice.

    Args:
        light_a: light on the grid of the first frame.
        light_b: light on the grid of the second.
        grid: nodes per pixel and axis.
        border: pixels between the grid's first node and the sensor's.
        low: (H, W) least light within reach of a pixel in both frames.
        high: (H, W) greatest.
        slope_a: (H + 2 B, W + 2 B) steepest light around each place, per px.
        slope_b: of the second frame.
        bearing: and up to `lens` as in `sim.compensation.path_kernels.path_of`.
        rho_a: ...
        rho_b: ...
        body_a: ...
        body_b: ...
        ways: ...
        lens: ...
        reference: in and out, (P,) as in `sim.sensor.esim_kernels.find`.
        memory: in and out, (P,) records of `sim.sensor.esim_kernels.PIXEL`.
        rise_light: in and out, (P,) of `thresholds`.
        fall_light: in and out, (P,).
        c_pos: threshold C+.
        c_neg: threshold C-.
        log_eps: added to light before the logarithm.
        before_us: time of the first frame, µs.
        step_us: time from the first frame to the second, µs.
        refractory_us: least time between two emitted events of a pixel, µs.

    Returns:
        (N,) pixels; times after `before_us`, 1 to `step_us`, 0 where suppressed, µs; polarities.
    """
    height, width = rho_a.shape
    room, n = _FIRST_ROOM, 0
    pixel, offset_us = np.empty(room, np.int32), np.empty(room, np.int64)
    polarity = np.empty(room, np.uint8)
    for y in range(height):
        for x in range(width):
            k = y * width + x
            rise, fall = float(rise_light[k]), float(fall_light[k])
            if high[y, x] < rise and low[y, x] > fall:
                continue
            path = path_of(x, y, bearing, rho_a, rho_b, body_a, body_b, ways, lens)
            way_px = path[8]
            per_px = 1.0 / max(way_px, 1e-6)
            x0, y0 = float(x + border), float(y + border)
            now = float(light_a[grid * (y + border), grid * (x + border)])
            last = float(light_b[grid * (y + border), grid * (x + border)])
            s, apart = 0.0, abs(last - now)
            u_a, v_a, u_b, v_b = places_on(x0, y0, path, 0.0)
            while s < 1.0:
                steepest = max(slope_at(slope_a, u_a, v_a), slope_at(slope_b, u_b, v_b))
                step = min(rise - now, now - fall) / (steepest * way_px + apart + 1e-9)
                then = s + min(max(step, _LEAST_PX * per_px), _MOST_PX * per_px)
                light = last
                if then < 1.0 - 0.5 * _LEAST_PX * per_px:
                    u_a, v_a, u_b, v_b = places_on(x0, y0, path, then)
                    before = light_at(light_a, grid * u_a, grid * v_a)
                    behind = light_at(light_b, grid * u_b, grid * v_b)
                    light, apart = before + then * (behind - before), abs(behind - before)
                else:
                    then = 1.0
                if light >= rise or light <= fall:
                    rises = bool(light >= rise)
                    first, up, down = memory[k].first_log, memory[k].up, memory[k].down
                    logs = math.log(now + log_eps), math.log(light + log_eps)
                    number = levels_passed(rises, logs[1], first, up, down, c_pos, c_neg)
                    if n + number > room:
                        room = 2 * (n + number)
                        pixel, offset_us = roomier(pixel, room), roomier(offset_us, room)
                        polarity = roomier(polarity, room)
                    for m in range(n, n + number):
                        up, down = up + rises, down + (not rises)
                        level = level_of(first, up, down, c_pos, c_neg)
                        when = crossing(
                            light_a, light_b, grid, x0, y0, path, level, log_eps, rises,
                            s, then, logs,
                        )  # fmt: skip
                        pixel[m], polarity[m] = k, rises
                        offset_us[m] = min(max(int(np.rint(when * step_us)), 1), step_us)
                    n += number
                    memory[k].up, memory[k].down = up, down
                    reference[k] = level_of(first, up, down, c_pos, c_neg)
                    rise = math.exp(reference[k] + c_pos - NEAR) - log_eps
                    fall = math.exp(reference[k] - c_neg + NEAR) - log_eps
                    rise_light[k], fall_light[k] = rise, fall
                now, s = light, then
    silence(pixel[:n], offset_us[:n], before_us, refractory_us, memory)
    return pixel[:n], offset_us[:n], polarity[:n]
