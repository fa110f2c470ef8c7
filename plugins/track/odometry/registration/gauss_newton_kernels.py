"""The compiled loop of Gauss-Newton over pose and twist of the body, all cameras at once.

One call registers a batch: no array is made and no lock is held between its steps.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.plugins.track.odometry.registration.residuals_kernels import (
    events_to_map,
    map_to_events,
)

CAUCHY_PX, GATE_PX = 0.7, 2.5
"""At the finest level; twice as much at each coarser one."""
TRUST = 0.4
"""What a squared residual of a pixel counts: events of one edge, and of batches that overlap, err
together."""
STEPS, COARSER_STEPS = 4, 1
"""Of Gauss-Newton per level, associations anew in each."""
FARTHER = 1.5
"""How much farther than a step says: weights that fall with the residual make it too short, by a
nearly constant share."""
_ENOUGH = 2e-5  # m, rad: a smaller step changes nothing
_SMALL_ANGLE = 1e-4


@njit(cache=True, nogil=True)
def product(A, B, out):
    """Fills `out` with A B, (n, n) each."""
    n = len(A)
    for i in range(n):
        for j in range(n):
            out[i, j] = 0
            for k in range(n):
                out[i, j] += A[i, k] * B[k, j]


@njit(cache=True, nogil=True)
def motion_of(xi, out):
    """Fills (4, 4) `out` with exp(xi), xi (6,) m then rad."""
    vx, vy, vz, wx, wy, wz = xi[0], xi[1], xi[2], xi[3], xi[4], xi[5]
    square = wx * wx + wy * wy + wz * wz
    angle = np.sqrt(square)
    if angle > _SMALL_ANGLE:
        a, b = np.sin(angle) / angle, (1 - np.cos(angle)) / square
        c = (1 - a) / square
    else:
        a, b, c = 1 - square / 6, 0.5 - square / 24, 1 / 6 - square / 120
    xy, xz, yz = b * wx * wy, b * wx * wz, b * wy * wz
    out[0, 0], out[0, 1], out[0, 2] = 1 - b * (wy * wy + wz * wz), xy - a * wz, xz + a * wy
    out[1, 0], out[1, 1], out[1, 2] = xy + a * wz, 1 - b * (wx * wx + wz * wz), yz - a * wx
    out[2, 0], out[2, 1], out[2, 2] = xz - a * wy, yz + a * wx, 1 - b * (wx * wx + wy * wy)
    ax, ay, az = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
    out[0, 3] = vx + b * ax + c * (wy * az - wz * ay)
    out[1, 3] = vy + b * ay + c * (wz * ax - wx * az)
    out[2, 3] = vz + b * az + c * (wx * ay - wy * ax)
    out[3, 0] = out[3, 1] = out[3, 2] = 0
    out[3, 3] = 1


@njit(cache=True, nogil=True)
def solve(H, g, factor, out):
    """Fills `out` with the solution of H x = -g, H positive definite; `factor` is scratch."""
    n = len(g)
    for i in range(n):
        for j in range(i + 1):
            left = H[i, j]
            for k in range(j):
                left -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(left) if i == j else left / factor[j, j]
    for i in range(n):
        left = -g[i]
        for k in range(i):
            left -= factor[i, k] * out[k]
        out[i] = left / factor[i, i]
    for i in range(n - 1, -1, -1):
        left = out[i]
        for k in range(i + 1, n):
            left -= factor[k, i] * out[k]
        out[i] = left / factor[i, i]


@njit(cache=True, nogil=True)
def to_body(H_cam, g_cam, A, H, g):
    """Adds a camera's normal equations to the body's: xi and tau of the camera are A times theirs.

    A is the (6, 6) adjoint of `T_cam_body`.
    """
    half = np.empty((6, 6))
    for i in range(2):
        for a in range(6):
            for k in range(6):
                g[6 * i + a] += A[k, a] * g_cam[6 * i + k]
        for j in range(2):
            product(H_cam[6 * i : 6 * i + 6, 6 * j : 6 * j + 6], A, half)
            for a in range(6):
                for b in range(6):
                    for k in range(6):
                        H[6 * i + a, 6 * j + b] += A[k, a] * half[k, b]


@njit(cache=True, nogil=True)
def equations(
    batch, points, normals, map_lines, event_lines, level, camera, pose, T_drawn_world, twist,
    scratch, H, g, fit,
):  # fmt: skip
    """Adds the normal equations of one camera, and how its residuals fit; see `gauss_newton`."""
    events, count = batch
    T_cam_body, T_body_cam, adjoint, intrinsics, size = camera
    T_half, T_cam, twist_cam, H_cam, g_cam = scratch
    width, gate = CAUCHY_PX * (1 << level), GATE_PX * (1 << level)
    H_cam[:], g_cam[:] = 0, 0
    for a in range(6):
        twist_cam[a] = 0
        for b in range(6):
            twist_cam[a] += adjoint[a, b] * twist[b]
    product(T_cam_body, pose, T_half)
    product(T_half, T_body_cam, T_cam)
    place, field = map_lines
    seen, near, closeness = events_to_map(
        events, count, place, field, T_cam, twist_cam, intrinsics, width, gate, H_cam,
        g_cam,
    )  # fmt: skip
    fit[0] += seen
    fit[1] += near
    fit[2] += closeness
    product(T_half, T_drawn_world, T_cam)
    place, field = event_lines
    seen, near, closeness = map_to_events(
        points, normals, T_cam, intrinsics, size, place, field, width, gate, H_cam, g_cam
    )
    fit[3] += seen
    fit[4] += near
    fit[5] += closeness
    to_body(H_cam, g_cam, adjoint, H, g)


@njit(cache=True, nogil=True)
def believe(H, g, belief, off):
    """Weighs the residuals against what was expected, from which pose and twist are `off` now."""
    for a in range(12):
        g[a] *= TRUST
        for b in range(12):
            H[a, b] = TRUST * H[a, b] + belief[a, b]
            g[a] += belief[a, b] * off[b]


@njit(cache=True, nogil=True)
def gauss_newton(
    events, counts, points, normals, map_lines, event_lines, places, cameras, levels,
    T_expected_drawn, T_drawn_world, expected_twist, belief, pose, twist, H, fit,
):  # fmt: skip
    """Finds pose and twist of the body that fit a batch best, coarse to fine.

    Arrays, C cameras and L levels:
        events: (C, M, 8) float64 rows of `events_to_map`, of which the first `counts`, (C,)
            int64, count; a camera of less than 0 takes no part.
        points: (P, 3) float64 map points in the world.
        normals: (C, P, 2) float64, of the lines that they lie on.
        map_lines, event_lines: fields of `lines_kernels`; `places` is (C, L, 4) int64
            of both.
        cameras: `T_cam_body`, `T_body_cam`, (C, 4, 4), the adjoint of the first, (C, 6, 6),
            intrinsics, (C, 4), and sizes, (C, 2).
        T_expected_drawn: (4, 4) to the body's expected frame, from that of the drawn map.
        T_drawn_world: (4, 4).
        expected_twist: (6,); belief: (12, 12) information about pose and twist.
        pose: (4, 4), filled: to the body's frame that was found, from that of the drawn map.
        twist: (6,), filled. H: (12, 12), filled: information about both.
        fit: (6,), filled: events, those near a line, their closeness; the same of points.
    """
    T_cam_body, T_body_cam, adjoint, intrinsics, sizes = cameras
    off, change, g, T_off, factor = (
        np.zeros(12), np.zeros(12), np.zeros(12), np.zeros((4, 4)), np.zeros((12, 12))
    )  # fmt: skip
    scratch = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(6), np.zeros((12, 12)), np.zeros(12)
    pose[:], twist[:] = T_expected_drawn, expected_twist
    for level in range(levels - 1, -1, -1):
        for _ in range(COARSER_STEPS if level else STEPS):
            fit[:], H[:], g[:] = 0, 0, 0
            for k in range(len(counts)):
                if counts[k] >= 0:
                    camera = T_cam_body[k], T_body_cam[k], adjoint[k], intrinsics[k], sizes[k]
                    equations(
                        (events[k], counts[k]), points, normals[k], (places[k, level], map_lines),
                        (places[k, level], event_lines), level, camera,
                        pose, T_drawn_world, twist, scratch, H, g, fit,
                    )  # fmt: skip
            believe(H, g, belief, off)
            solve(H, g, factor, change)
            off += FARTHER * change
            twist[:] = expected_twist + off[6:]
            motion_of(off, T_off)
            product(T_off, T_expected_drawn, pose)
            if np.abs(change[:6]).max() < _ENOUGH:
                break
