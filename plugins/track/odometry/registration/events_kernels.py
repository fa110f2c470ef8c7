"""Compiled loops over events: which have company, where they lie in the undistorted image."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-overload"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.plugins.track.odometry.registration.lines_kernels import (
    NEAREST_M,
    add_points,
    line_at,
)
from eventsweep.plugins.track.odometry.registration.residuals_kernels import DRIFTS, later

NEVER_US = -(1 << 62)
BLOCK = 512
"""Events that are carried at a time: they stay in the nearest cache until they are drawn."""


@njit(cache=True, nogil=True)
def in_company(x, y, t_us, within_us, last_us, out):
    """Says of each event whether one of the 8 pixels around fired at most `within_us` before.

    `last_us`, (H + 2, W + 2) int64, holds the time of every pixel's last event, in a frame of one
    pixel that never fires, and is kept up to date.
    """
    for k in range(len(t_us)):
        i, j, t = np.int64(x[k]) + 1, np.int64(y[k]) + 1, t_us[k]
        since = t - within_us
        out[k] = (
            last_us[j, i - 1] >= since or last_us[j, i + 1] >= since
            or last_us[j - 1, i] >= since or last_us[j + 1, i] >= since
            or last_us[j - 1, i - 1] >= since or last_us[j - 1, i + 1] >= since
            or last_us[j + 1, i - 1] >= since or last_us[j + 1, i + 1] >= since
        )  # fmt: skip
        last_us[j, i] = t


@njit(cache=True, nogil=True)
def halve(x, y, p, sums, chosen):
    """Numbers the events with which pixels of twice the size pass their threshold; says how many.

    `sums`, (H // 2, W // 2) int8, holds brighter less darker events of each larger pixel since it
    passed it last, between -3 and 3, and is kept up to date.
    """
    height, width = sums.shape
    n = 0
    for k in range(len(x)):
        i, j = np.int64(x[k]) >> 1, np.int64(y[k]) >> 1
        if i >= width or j >= height:
            continue
        total = sums[j, i] + (1 if p[k] else -1)
        if total == 4 or total == -4:
            total = 0
            chosen[n] = k
            n += 1
        sums[j, i] = total
    return n


@njit(cache=True, nogil=True)
def place(x, y, t_us, t_mid_us, table, out):
    """Fills rows (u, v, dt_s) of `out` with the events that have a place; returns how many.

    `table` is (H, W, 2) float32, the undistorted pixel of every pixel, below 0 where there is none.
    """
    n = 0
    for k in range(len(t_us)):
        u, v = table[y[k], x[k], 0], table[y[k], x[k], 1]
        if u >= 0 and v >= 0:
            out[n, 0], out[n, 1], out[n, 2] = u, v, (t_us[k] - t_mid_us) * 1e-6
            n += 1
    return n


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _seen(u, v, rho, per_cell, per_fx, per_fy, cx, cy):
    """The point that a pixel sees at the depth of `rho` there."""
    z = 1 / rho[int(v * per_cell + 0.5), int(u * per_cell + 0.5)]
    return (u - cx) * per_fx * z, (v - cy) * per_fy * z, z


@njit(cache=True, nogil=True, error_model="numpy")
def compensate(
    placed, count, rho, rho_cell_px, twist, intrinsics, size, per_spread, out
):  # fmt: skip
    """Moves (u, v, dt) events to dt 0 at the depths of `rho`; returns how many are inside.

    Fills rows (u, v, dt times `per_spread`) of `out`. `twist` is that of the camera, (v, w) in its
    own frame, m/s and rad/s; `size` is width and height.
    """
    fx, fy, cx, cy = intrinsics
    per_fx, per_fy, per_cell = 1 / fx, 1 / fy, 1 / rho_cell_px
    twist = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    right, bottom = size[0] - 1, size[1] - 1
    n = 0
    for k in range(count):
        dt_s = placed[k, 2]
        x, y, z = _seen(placed[k, 0], placed[k, 1], rho, per_cell, per_fx, per_fy, cx, cy)
        x, y, z = later(x, y, z, twist, -dt_s)
        per_z = 1 / z
        u, v = fx * x * per_z + cx, fy * y * per_z + cy
        out[n, 0], out[n, 1], out[n, 2] = u, v, dt_s * per_spread
        is_inside = (u >= 0) & (v >= 0) & (u <= right) & (v <= bottom)
        n += is_inside & (z >= NEAREST_M)
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def event_normals(events, count, rho, rho_cell_px, twist, intrinsics, place, field):
    """Fills columns 3 to 7 of `events`: n_u, n_v of the line that each lies on, or 0, and x, y, z.

    Rows begin with u, v, dt; the lines are those of compensated events, `compensate`; the point is
    what the event sees at the depth of `rho`. Of a line that drifts z is 0.
    """
    fx, fy, cx, cy = intrinsics
    per_fx, per_fy, per_cell = 1 / fx, 1 / fy, 1 / rho_cell_px
    sums, _, slots, made, lines, cells, scratch = field
    for k in range(count):
        x, y, z = _seen(events[k, 0], events[k, 1], rho, per_cell, per_fx, per_fy, cx, cy)
        events[k, 5], events[k, 6], events[k, 7] = x, y, z
        x, y, z = later(x, y, z, twist, -events[k, 2])
        events[k, 3] = events[k, 4] = 0
        if z < NEAREST_M:
            continue
        per_z = 1 / z
        u, v = fx * x * per_z + cx, fy * y * per_z + cy
        weight, n_u, n_v, _, _, drift = line_at(
            place, sums, slots, made, lines, cells, scratch, u, v
        )
        if weight > 0:  # or nothing was written of a line
            events[k, 3], events[k, 4] = n_u, n_v
            if abs(drift) > DRIFTS:
                events[k, 7] = 0  # as behind the camera: it takes no part


@njit(cache=True, nogil=True)
def draw(
    x, y, t_us, t_mid_us, table, rho, rho_cell_px, twist, intrinsics, size, per_spread, places,
    field, placed, carried, events,
):  # fmt: skip
    """Adds a batch to line fields at the scales of `places`, (L, 4).

    `per_spread` is the inverse standard deviation of the events' times, 1/s, or 0 to skip the test
    for drift. `placed`, (N, 3), and `carried`, (`BLOCK`, 3), are scratch buffers. `events` receives
    a subsample spread evenly through the batch, at most one event per row, see `event_normals`;
    returns their number.
    """
    count = 0
    for k in range(0, len(t_us), BLOCK):
        part = slice(k, k + BLOCK)
        here = placed[count : count + BLOCK]
        more = place(x[part], y[part], t_us[part], t_mid_us, table, here)
        inside = compensate(
            here, more, rho, rho_cell_px, twist, intrinsics, size, per_spread, carried
        )
        for level in range(len(places)):
            add_points(carried, inside, places[level], field)
        count += more
    taken = min(count, len(events))
    for k in range(taken):
        for column in range(3):
            events[k, column] = placed[k * count // taken, column]
    event_normals(events, taken, rho, rho_cell_px, twist, intrinsics, places[0], field)
    return taken
