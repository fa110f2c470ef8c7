"""Events of ideal pixels between two fine frames: compiled; steps as fine as thresholds ask for."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

import emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from sim.compensation.light_kernels import light_at
from sim.compensation.path_kernels import path_of
from sim.sensor.esim_kernels import NEAR, level_of, number_of_falls, number_of_rises

# Steps are never shorter and never longer than this way, px; a crossing within a step longer than
# the third is looked at once more.
_LEAST_PX, _MOST_PX, _COARSE_PX = 0.1, 1.0, 0.02
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
def blended(
    light_a: NDArray[np.float32],
    light_b: NDArray[np.float32],
    grid: int,
    u_a: float,
    v_a: float,
    u_b: float,
    v_b: float,
    share: float,
) -> tuple[float, float]:
    """Light of both frames at two places of the grid, blended; and by how much they differ."""
    before = light_at(light_a, grid * u_a, grid * v_a)
    behind = light_at(light_b, grid * u_b, grid * v_b)
    return (1.0 - share) * before + share * behind, abs(behind - before)


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

    A step goes as far as the light cannot change to a threshold, by the steepest slope around the
    place in both frames. Within a step light is taken for linear in its logarithm; at the first
    guess of a crossing the light is looked at, and the crossing found anew beside it.

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
    last_row, last_column = float(slope_a.shape[0] - 1), float(slope_a.shape[1] - 1)
    room, n = _FIRST_ROOM, 0
    pixel, offset_us = np.empty(room, np.int32), np.empty(room, np.int64)
    polarity = np.empty(room, np.uint8)
    for y in range(height):
        for x in range(width):
            k = y * width + x
            rise, fall = rise_light[k], fall_light[k]
            if high[y, x] < rise and low[y, x] > fall:
                continue
            au1, au2, av1, av2, bu1, bu2, bv1, bv2, way_px = path_of(
                x, y, bearing, rho_a, rho_b, body_a, body_b, ways, lens
            )
            per_px = 1.0 / max(way_px, 1e-6)
            least, most = _LEAST_PX * per_px, _MOST_PX * per_px
            x0, y0 = float(x + border), float(y + border)
            now = np.float64(light_a[grid * (y + border), grid * (x + border)])
            last = np.float64(light_b[grid * (y + border), grid * (x + border)])
            s, apart = 0.0, abs(last - now)
            u_a, v_a, u_b, v_b = x0, y0, x0 + bu1 + bu2, y0 + bv1 + bv2
            while s < 1.0:
                i = np.uint64(min(max(v_a, 0.0), last_row))
                j = np.uint64(min(max(u_a, 0.0), last_column))
                steepest = slope_a[i, j]
                i = np.uint64(min(max(v_b, 0.0), last_row))
                j = np.uint64(min(max(u_b, 0.0), last_column))
                steepest = max(steepest, slope_b[i, j])
                far = min(rise - now, now - fall)
                step = min(max(far / (steepest * way_px + apart + 1e-9), least), most)
                then = s + step
                if then > 1.0 - 0.5 * least:
                    then, light = 1.0, last
                else:
                    t = 1.0 - then
                    u_a, v_a = x0 + then * (au1 + au2 * then), y0 + then * (av1 + av2 * then)
                    u_b, v_b = x0 + t * (bu1 + bu2 * t), y0 + t * (bv1 + bv2 * t)
                    light, apart = blended(light_a, light_b, grid, u_a, v_a, u_b, v_b, then)
                if light >= rise or light <= fall:
                    first = np.float64(memory[k].first_log)
                    up, down = memory[k].up, memory[k].down
                    log_now, log_then = math.log(now + log_eps), math.log(light + log_eps)
                    rises = light >= rise
                    if rises:
                        number = number_of_rises(log_then, first, up, down, c_pos, c_neg)
                    else:
                        number = number_of_falls(log_then, first, up, down, c_pos, c_neg)
                    for _ in range(number):
                        up, down = up + rises, down + (not rises)
                        level = level_of(first, up, down, c_pos, c_neg)
                        share = (level - log_now) / (log_then - log_now)
                        when = s + min(max(share, 0.0), 1.0) * (then - s)
                        if (then - s) * way_px > _COARSE_PX:
                            t = 1.0 - when
                            looked, _ = blended(
                                light_a, light_b, grid,
                                x0 + when * (au1 + au2 * when), y0 + when * (av1 + av2 * when),
                                x0 + t * (bu1 + bu2 * t), y0 + t * (bv1 + bv2 * t), when,
                            )  # fmt: skip
                            log_there = math.log(looked + log_eps)
                            if (log_there >= level) == rises:
                                share = (level - log_now) / (log_there - log_now + 1e-30)
                                when = s + min(max(share, 0.0), 1.0) * (when - s)
                            else:
                                share = (level - log_there) / (log_then - log_there + 1e-30)
                                when += min(max(share, 0.0), 1.0) * (then - when)
                        offset = min(max(int(np.rint(when * step_us)), 1), step_us)
                        if before_us + offset - memory[k].last_emitted_us < refractory_us:
                            offset = 0
                        else:
                            memory[k].last_emitted_us = before_us + offset
                        if n == room:
                            room *= 2
                            pixel = _roomier(pixel, room)
                            offset_us, polarity = _roomier(offset_us, room), _roomier(polarity, room)
                        pixel[n], offset_us[n], polarity[n] = k, offset, rises
                        n += 1
                    if number:
                        memory[k].up, memory[k].down = up, down
                        reference[k] = level_of(first, up, down, c_pos, c_neg)
                        rise = math.exp(reference[k] + c_pos - NEAR) - log_eps
                        fall = math.exp(reference[k] - c_neg + NEAR) - log_eps
                        rise_light[k], fall_light[k] = rise, fall
                now, s = light, then
    return pixel[:n], offset_us[:n], polarity[:n]


@numba.njit(cache=True, nogil=True)
def _roomier(values, room):  # type: ignore[no-untyped-def]
    """The same values in an array of `room`."""
    more = np.empty(room, values.dtype)
    more[: len(values)] = values
    return more
