"""Compiled loops of the two residuals, and their normal equations. Units: px, s, m, rad.

All is seen from one camera: its pose is corrected by `X_cam' = exp(xi) X_cam`, xi = (v, w), and its
twist tau = (v, w) moves points from its frame at dt 0 to that at dt by exp(-tau dt). What that says
of the body, `gauss_newton_kernels` adds up over the cameras.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return"

from __future__ import annotations

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.plugins.track.odometry.registration.lines_kernels import (
    NEAREST_M,
    line_at,
    moved,
    seen_at,
)

LEAST_WEIGHT = 0.1  # of a line
DRIFTS = 0.5
"""Correlation of time with the distance across a line of events, above which it moves by itself.

At rest it is 0 by chance only; what goes across a line's whole width in a batch, or farther, comes
to 0.5 to 0.7."""
# What counts of a residual between lines that cross, and are seldom of one edge.
_CROSSING = 0.25


@njit(cache=True, nogil=True, forceinline=True)
def later(x, y, z, twist, dt_s):
    """A point at rest, from a moving frame into that `dt_s` later: exp(-twist dt) to order 2."""
    vx, vy, vz, wx, wy, wz = twist
    ax, ay, az = -vx - (wy * z - wz * y), -vy - (wz * x - wx * z), -vz - (wx * y - wy * x)
    h = 0.5 * dt_s * dt_s
    return (
        x + dt_s * ax - h * (wy * az - wz * ay),
        y + dt_s * ay - h * (wz * ax - wx * az),
        z + dt_s * az - h * (wx * ay - wy * ax),
    )


@njit(cache=True, nogil=True, forceinline=True)
def slope(by_u, by_v, x, y, z, inverse):
    """The derivative of n . pi(X_cam) by xi, six numbers; `by_u`, `by_v`: n times focal lengths.

    `inverse` is 1 / z.
    """
    a, b = by_u * inverse, by_v * inverse
    c = -(a * x + b * y) * inverse
    return a, b, c, y * c - z * b, z * a - x * c, x * b - y * a


@njit(cache=True, nogil=True, forceinline=True)
def by_body(T_cam_body, by_x, by_y, by_z, X, Y, Z, J):
    """Fills `J[:6]` with the derivative by the body's xi, of one by a point in the camera's frame.

    The point is (X, Y, Z) in that of the body.
    """
    for i in range(3):
        J[i] = T_cam_body[0, i] * by_x + T_cam_body[1, i] * by_y + T_cam_body[2, i] * by_z
    J[3], J[4], J[5] = Y * J[2] - Z * J[1], Z * J[0] - X * J[2], X * J[1] - Y * J[0]


@njit(cache=True, nogil=True, forceinline=True)
def likeness(n_u, n_v, own_u, own_v):
    """Weight of two lines with these normals: 1 where they are parallel, least where they cross."""
    return _CROSSING + (1 - _CROSSING) * (n_u * own_u + n_v * own_v) ** 2


@njit(cache=True, nogil=True)
def map_to_events(
    points, normals, T_cam_world, intrinsics, size, place, field, width, gate, H, g
):  # fmt: skip
    """`mls`: distances of projected map points from lines of motion-compensated events.

    `normals` are (N, 2), of the lines of the map that the points lie on; `place` and `field`
    are those of `lines_kernels`. Adds to the upper left (6, 6) of H and (6,) of g; returns
    points in view, those near a line, and the sum of their closeness, 1 / (1 + (r / width)²).
    """
    part = np.zeros((6, 6))
    fx, fy = intrinsics[0], intrinsics[1]
    sums, _, slots, made, lines, cells, scratch = field
    seen, near, closeness, per_width = 0, 0, 0.0, 1 / width
    for k in range(len(points)):
        x, y, z = moved(T_cam_world, points[k, 0], points[k, 1], points[k, 2])
        u, v, inverse = seen_at(x, y, z, intrinsics, size)
        if inverse == 0:
            continue
        seen += 1
        weight, n_u, n_v, r, _, drift = line_at(
            place, sums, slots, made, lines, cells, scratch, u, v
        )
        if weight < LEAST_WEIGHT or abs(r) > gate or abs(drift) > DRIFTS:
            continue
        near += 1
        close = 1 / (1 + (r * per_width) ** 2)
        closeness += close
        weight *= close * likeness(n_u, n_v, normals[k, 0], normals[k, 1])
        J = slope(n_u * fx, n_v * fy, x, y, z, inverse)
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
def depth_to_events(
    points, normals, T_cam_body, T_body_world, intrinsics, size, place, field, width, gate,
    H, g, regions,
):  # fmt: skip
    """`mls` once more, by the body's pose and the logarithm of the map's scale about the body.

    A camera at the body's origin does not see the scale; others do, by the depth that they and it
    see together, whatever the motion was. Adds to (7, 7) H and (7,) g of (xi, log scale), and to
    (rows, columns, 2) `regions` of the image the points near a line and their closeness.
    """
    fx, fy = intrinsics[0], intrinsics[1]
    rows, columns = regions.shape[0] / size[1], regions.shape[1] / size[0]
    sums, _, slots, made, lines, cells, scratch = field
    J, per_width = np.empty(7), 1 / width
    for k in range(len(points)):
        X, Y, Z = moved(T_body_world, points[k, 0], points[k, 1], points[k, 2])
        x, y, z = moved(T_cam_body, X, Y, Z)
        u, v, inverse = seen_at(x, y, z, intrinsics, size)
        if inverse == 0:
            continue
        weight, n_u, n_v, r, _, _ = line_at(place, sums, slots, made, lines, cells, scratch, u, v)
        if weight < LEAST_WEIGHT or abs(r) > gate:
            continue
        close = 1 / (1 + (r * per_width) ** 2)
        region = regions[int(v * rows), int(u * columns)]
        region[0] += 1
        region[1] += close
        weight *= close * likeness(n_u, n_v, normals[k, 0], normals[k, 1])
        a, b, c, _, _, _ = slope(n_u * fx, n_v * fy, x, y, z, inverse)
        by_body(T_cam_body, a, b, c, X, Y, Z, J)
        J[6] = J[0] * X + J[1] * Y + J[2] * Z
        for i in range(7):
            g[i] += weight * J[i] * r
            for j in range(7):
                H[i, j] += weight * J[i] * J[j]


@njit(cache=True, nogil=True)
def events_to_map(
    events, count, place, field, T_now_drawn, twist, intrinsics, width, gate, H, g
):  # fmt: skip
    """`ev`: distances of events, each at its own time, from lines of the map.

    `events` are rows (u, v, dt, n_u, n_v, x, y, z), with the normal of the line of events that each
    lies on, and the point at the depth of the map around it. The map's lines are drawn at a frame
    of the camera from which `T_now_drawn` leads to that at dt 0. An event is carried back there,
    its foot on the line there becomes a point P at the line's depth, and

        r = n . (u - pi(exp(-tau dt) T_now_drawn P)).

    Adds to the (12, 12) and (12,) normal equations of (xi, tau); the Jacobian leaves out what is
    of second order in tau dt. Returns events looked at, those near a line, and their closeness.
    """
    fx, fy, cx, cy = intrinsics
    per_fx, per_fy, per_width = 1 / fx, 1 / fy, 1 / width
    sums, _, slots, made, lines, cells, scratch = field
    parts = np.zeros((6, 6, 4))
    seen, near, closeness = 0, 0, 0.0
    for k in range(count):
        u, v, dt = events[k, 0], events[k, 1], events[k, 2]
        x, y, z = moved(T_now_drawn, events[k, 5], events[k, 6], events[k, 7])
        x, y, z = later(x, y, z, twist, dt)
        if z < NEAREST_M:
            continue
        inverse = 1 / z
        at_u, at_v = u - (fx * x * inverse + cx - u), v - (fy * y * inverse + cy - v)
        weight, n_u, n_v, off, inverse, _ = line_at(
            place, sums, slots, made, lines, cells, scratch, at_u, at_v
        )
        seen += 1
        if weight < LEAST_WEIGHT or abs(off) > gate:
            continue
        z = 1 / inverse
        x, y = (at_u - n_u * off - cx) * per_fx * z, (at_v - n_v * off - cy) * per_fy * z
        x, y, z = moved(T_now_drawn, x, y, z)
        x, y, z = later(x, y, z, twist, dt)
        if z < NEAREST_M:
            continue
        inverse = 1 / z
        r = n_u * (u - (fx * x * inverse + cx)) + n_v * (v - (fy * y * inverse + cy))
        if abs(r) > gate:
            continue
        near += 1
        close = 1 / (1 + (r * per_width) ** 2)
        closeness += close
        weight *= close * likeness(n_u, n_v, events[k, 3], events[k, 4])
        J = slope(-n_u * fx, -n_v * fy, x, y, z, inverse)
        for a in range(6):
            weighted = weight * J[a]
            g[a] += weighted * r
            g[6 + a] -= dt * weighted * r
            for b in range(a + 1):
                product = weighted * J[b]
                parts[a, b, 0] += product
                parts[a, b, 1] += dt * product
                parts[a, b, 2] += dt * dt * product
                parts[a, b, 3] += dt * dt * dt * product
    for a in range(6):
        for b in range(6):
            i, j = max(a, b), min(a, b)
            H[a, b] += parts[i, j, 0]
            H[a, 6 + b] -= parts[i, j, 1]
            H[6 + a, b] -= parts[i, j, 1]
            H[6 + a, 6 + b] += parts[i, j, 2]
    return seen, near, closeness


@njit(cache=True, nogil=True)
def depths_to_events(
    points, normals, middle, T_cam_body, T_body_world, intrinsics, size, place, field, width, gate,
    H, g, a, b, c,
):  # fmt: skip
    """`mls` by the body's pose and the logarithm of each point's depth, seen from the `middle`.

    Adds to (6, 6) H and (6,) g of the pose, and to row k of (N,) a and c and of (N, 6) b those of
    the k-th point's depth and of both.
    """
    fx, fy = intrinsics[0], intrinsics[1]
    sums, _, slots, made, lines, cells, scratch = field
    J, per_width = np.empty(6), 1 / width
    for k in range(len(points)):
        X, Y, Z = moved(T_body_world, points[k, 0], points[k, 1], points[k, 2])
        x, y, z = moved(T_cam_body, X, Y, Z)
        u, v, inverse = seen_at(x, y, z, intrinsics, size)
        if inverse == 0:
            continue
        weight, n_u, n_v, r, _, drift = line_at(
            place, sums, slots, made, lines, cells, scratch, u, v
        )
        if weight < LEAST_WEIGHT or abs(r) > gate or abs(drift) > DRIFTS:
            continue
        weight *= likeness(n_u, n_v, normals[k, 0], normals[k, 1]) / (1 + (r * per_width) ** 2)
        by_x, by_y, by_z, _, _, _ = slope(n_u * fx, n_v * fy, x, y, z, inverse)
        by_body(T_cam_body, by_x, by_y, by_z, X, Y, Z, J)
        d = 0.0
        for i in range(3):
            for j in range(3):
                d += J[i] * T_body_world[i, j] * (points[k, j] - middle[j])
        a[k] += weight * d * d
        c[k] += weight * d * r
        for i in range(6):
            g[i] += weight * J[i] * r
            b[k, i] += weight * d * J[i]
            for j in range(6):
                H[i, j] += weight * J[i] * J[j]
