"""Compiled loops over events: which have company, where they lie in the undistorted image."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-overload"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.odometry.registration.lines_kernels import NEAREST_M, line_at
from eventsweep.emvs.odometry.registration.residuals_kernels import later

NEVER_US = -(1 << 62)


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


@njit(cache=True, nogil=True, forceinline=True)
def _at_rest(event, rho, rho_cell_px, twist, intrinsics):
    """Where an event would be at dt 0 at the depth of `rho`: u, v, z, and its inverse depth."""
    fx, fy, cx, cy = intrinsics
    u, v, dt = event[0], event[1], event[2]
    inverse = rho[int(v / rho_cell_px + 0.5), int(u / rho_cell_px + 0.5)]
    z = 1 / inverse
    x, y, z = later((u - cx) / fx * z, (v - cy) / fy * z, z, twist, -dt)
    return fx * x / z + cx, fy * y / z + cy, z, inverse


@njit(cache=True, nogil=True)
def compensate(placed, count, rho, rho_cell_px, twist, intrinsics, size, out):
    """Moves (u, v, dt) events to dt 0 at the depths of `rho`: rows (u, v, rho); returns how many.

    `twist` is that of the camera, (v, w) in its own frame, m/s and rad/s; `size` is width and
    height.
    """
    n = 0
    for k in range(count):
        u, v, z, inverse = _at_rest(placed[k], rho, rho_cell_px, twist, intrinsics)
        if z < NEAREST_M:
            continue
        if u >= 0 and v >= 0 and u <= size[0] - 1 and v <= size[1] - 1:
            out[n, 0], out[n, 1], out[n, 2] = u, v, inverse
            n += 1
    return n


@njit(cache=True, nogil=True)
def event_normals(events, count, rho, rho_cell_px, twist, intrinsics, place, drawing, field):
    """Fills columns 3 and 4 of `events` with the normal of the line that each lies on, or 0.

    Rows are (u, v, dt, n_u, n_v); the lines are those of compensated events, `compensate`.
    """
    sums, _, made, lines, scratch = field
    for k in range(count):
        u, v, z, _ = _at_rest(events[k], rho, rho_cell_px, twist, intrinsics)
        events[k, 3] = events[k, 4] = 0
        if z < NEAREST_M:
            continue
        weight, n_u, n_v, _, _ = line_at(place, drawing, sums, made, lines, scratch, u, v)
        if weight > 0:
            events[k, 3], events[k, 4] = n_u, n_v
