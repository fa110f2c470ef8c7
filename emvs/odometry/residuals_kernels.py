"""Compiled loops of the two residuals, and their normal equations. Units: px, s, m, rad.

A pose is corrected by `X_body' = exp(xi) X_body`, xi = (v, w); the twist tau = (v, w) of the body
moves points from the body's frame at dt 0 to that at dt by exp(-tau dt).
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.odometry.lines_kernels import NEAREST_M, line_at, moved

LEAST_WEIGHT = 0.1  # of a line


@njit(cache=True, nogil=True)
def later(x, y, z, twist, dt_s):
    """A point at rest, from the body's frame into that `dt_s` later: exp(-twist dt) to order 2."""
    vx, vy, vz, wx, wy, wz = twist
    ax, ay, az = -vx - (wy * z - wz * y), -vy - (wz * x - wx * z), -vz - (wx * y - wy * x)
    h = 0.5 * dt_s * dt_s
    return (
        x + dt_s * ax - h * (wy * az - wz * ay),
        y + dt_s * ay - h * (wz * ax - wx * az),
        z + dt_s * az - h * (wx * ay - wy * ax),
    )


@njit(cache=True, nogil=True)
def slope(n_u, n_v, x, y, z, body, T_cam_body, intrinsics, J):
    """Fills `J` (6,) with the derivative of n . pi(X_cam) by the motion xi of the body's frame.

    `x, y, z` is the point in the camera's frame, `body` in the body's.
    """
    d_x, d_y = n_u * intrinsics[0] / z, n_v * intrinsics[1] / z
    d_z = -(d_x * x + d_y * y) / z
    for a in range(3):
        J[a] = d_x * T_cam_body[0, a] + d_y * T_cam_body[1, a] + d_z * T_cam_body[2, a]
    J[3] = body[1] * J[2] - body[2] * J[1]
    J[4] = body[2] * J[0] - body[0] * J[2]
    J[5] = body[0] * J[1] - body[1] * J[0]


@njit(cache=True, nogil=True)
def map_to_events(
    points, T_body_world, T_cam_body, intrinsics, size, moments, cell_px, least, width, gate, H, g
):
    """`mls`: distances of projected map points from lines of motion-compensated events.

    Adds to the (6, 6) and (6,) normal equations; returns points in view, those near a line, and the
    sum of their closeness, 1 / (1 + (r / width)²).
    """
    J, part = np.empty(6), np.zeros((6, 6))
    seen, near, closeness = 0, 0, 0.0
    for k in range(len(points)):
        body = moved(T_body_world, points[k, 0], points[k, 1], points[k, 2])
        x, y, z = moved(T_cam_body, body[0], body[1], body[2])
        if z < NEAREST_M:
            continue
        u = intrinsics[0] * x / z + intrinsics[2]
        v = intrinsics[1] * y / z + intrinsics[3]
        if not (u >= 0 and v >= 0 and u <= size[0] - 1 and v <= size[1] - 1):
            continue
        seen += 1
        weight, n_u, n_v, c, _ = line_at(moments, cell_px, least, u, v)
        r = n_u * u + n_v * v - c
        if weight < LEAST_WEIGHT or abs(r) > gate:
            continue
        near += 1
        close = 1 / (1 + (r / width) ** 2)
        closeness += close
        weight *= close
        slope(n_u, n_v, x, y, z, body, T_cam_body, intrinsics, J)
        for a in range(6):
            weighted = weight * J[a]
            g[a] += weighted * r
            for b in range(a + 1):
                part[a, b] += weighted * J[b]
    for a in range(6):
        for b in range(6):
            H[a, b] += part[max(a, b), min(a, b)]
    return seen, near, closeness


@njit(cache=True, nogil=True)
def events_to_map(
    events, count, moments, cell_px, least, rho, rho_cell_px, T_now_drawn, twist,
    T_cam_body, T_body_cam, intrinsics, width, gate, H, g,
):  # fmt: skip
    """`ev`: distances of events, each at its own time, from lines of the map.

    `events` are rows (u, v, dt). `moments` and `rho`, a smooth inverse depth in larger cells, are
    drawn from the map at a body frame from which `T_now_drawn` leads to that at dt 0. An event is
    carried back there, its foot on the line there becomes a point P at the line's depth, and

        r = n . (u - pi(T_cam_body exp(-tau dt) T_now_drawn T_body_cam P)).

    Adds to the (12, 12) and (12,) normal equations of (xi, tau); the Jacobian leaves out what is
    of second order in tau dt. Returns events looked at, those near a line, and their closeness.
    """
    fx, fy, cx, cy = intrinsics
    J, parts = np.empty(6), np.zeros((3, 6, 6))
    seen, near, closeness = 0, 0, 0.0
    for k in range(count):
        u, v, dt = events[k, 0], events[k, 1], events[k, 2]
        z = 1 / rho[int(v / rho_cell_px + 0.5), int(u / rho_cell_px + 0.5)]
        x, y, z = moved(T_body_cam, (u - cx) / fx * z, (v - cy) / fy * z, z)
        x, y, z = moved(T_now_drawn, x, y, z)
        x, y, z = later(x, y, z, twist, dt)
        x, y, z = moved(T_cam_body, x, y, z)
        if z < NEAREST_M:
            continue
        at_u, at_v = u - (fx * x / z + cx - u), v - (fy * y / z + cy - v)
        weight, n_u, n_v, c, inverse = line_at(moments, cell_px, least, at_u, at_v)
        seen += 1
        off = n_u * at_u + n_v * at_v - c
        if weight < LEAST_WEIGHT or abs(off) > gate:
            continue
        z = 1 / inverse
        x, y = (at_u - n_u * off - cx) / fx * z, (at_v - n_v * off - cy) / fy * z
        x, y, z = moved(T_body_cam, x, y, z)
        x, y, z = moved(T_now_drawn, x, y, z)
        body = later(x, y, z, twist, dt)
        x, y, z = moved(T_cam_body, body[0], body[1], body[2])
        if z < NEAREST_M:
            continue
        r = n_u * (u - (fx * x / z + cx)) + n_v * (v - (fy * y / z + cy))
        if abs(r) > gate:
            continue
        near += 1
        close = 1 / (1 + (r / width) ** 2)
        closeness += close
        weight *= close
        slope(-n_u, -n_v, x, y, z, body, T_cam_body, intrinsics, J)
        for a in range(6):
            weighted = weight * J[a]
            g[a] += weighted * r
            g[6 + a] -= dt * weighted * r
            for b in range(a + 1):
                parts[0, a, b] += weighted * J[b]
                parts[1, a, b] += dt * weighted * J[b]
                parts[2, a, b] += dt * dt * weighted * J[b]
    for a in range(6):
        for b in range(6):
            i, j = max(a, b), min(a, b)
            H[a, b] += parts[0, i, j]
            H[a, 6 + b] -= parts[1, i, j]
            H[6 + a, b] -= parts[1, i, j]
            H[6 + a, 6 + b] += parts[2, i, j]
    return seen, near, closeness
