"""Slow, plain twins of the mapper's kernels: one event, one voxel, one pixel at a time."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

F = np.float32


def rays(events, camera, T_body_cam, trajectory, T_world_rv, rv_camera, pose_us=None):
    """Per event: (fate, a_u, b_u, a_v, b_v, c_z); fate in votes, pose, ray, backwards."""
    rows = []
    table = camera.bearing_table()
    for k in range(len(events)):
        t_us = int(events.t_us[k] if pose_us is None else pose_us[k])
        rows.append(_ray(events.x[k], events.y[k], t_us, table, T_body_cam, trajectory,
                         T_world_rv, rv_camera))  # fmt: skip
    return rows


def _ray(x, y, t_us, table, T_body_cam, trajectory, T_world_rv, rv_camera):
    if not trajectory.span_us[0] <= t_us <= trajectory.span_us[1]:
        return ("pose",)
    bearing = table[y, x]
    if not np.isfinite(bearing).all():
        return ("ray",)
    T_rv_cam = np.linalg.inv(T_world_rv) @ _pose(trajectory, t_us) @ T_body_cam
    direction = T_rv_cam[:3, :3] @ np.array([*bearing, 1.0])
    if direction[2] <= 0:
        return ("backwards",)
    # Where the ray meets two depths gives the line u = a + rho b.
    centre = T_rv_cam[:3, 3]
    slope = direction / direction[2]
    at_infinity = rv_camera.K @ slope
    u_b = rv_camera.fx_px * (centre[0] - slope[0] * centre[2])
    v_b = rv_camera.fy_px * (centre[1] - slope[1] * centre[2])
    return ("votes", at_infinity[0], u_b, at_infinity[1], v_b, centre[2])


def _pose(trajectory, t_us):
    i = int(np.searchsorted(trajectory.t_us, t_us, side="right")) - 1
    i = min(i, len(trajectory.t_us) - 2)
    t0, t1 = int(trajectory.t_us[i]), int(trajectory.t_us[i + 1])
    share = (t_us - t0) / (t1 - t0)
    q0, q1 = trajectory.quats_xyzw[i], trajectory.quats_xyzw[i + 1]
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(_slerp(q0, q1, share)).as_matrix()
    T[:3, 3] = (1 - share) * trajectory.positions_m[i] + share * trajectory.positions_m[i + 1]
    return T


def _slerp(q0, q1, share):
    dot = float(np.dot(q0, q1))
    q1, dot = (q1, dot) if dot >= 0 else (-q1, -dot)
    angle = math.acos(min(dot, 1.0))
    if angle < 1e-9:
        return q0
    return (math.sin((1 - share) * angle) * q0 + math.sin(share * angle) * q1) / math.sin(angle)


def vote(a_u, b_u, a_v, b_v, c_z, rho, width, height, cast=None):
    """Votes (N, H, W), and per plane how many counted and how many lay behind their camera."""
    cast = cast or bilinear
    volume = np.zeros((len(rho), height, width), np.float32)
    counted, behind = np.zeros(len(rho), int), np.zeros(len(rho), int)
    with np.errstate(all="ignore"):
        for i, r in enumerate(rho):
            for k in range(len(a_u)):
                if not F(1) - c_z[k] * r > 0:
                    behind[i] += 1
                    continue
                u, v = a_u[k] + r * b_u[k], a_v[k] + r * b_v[k]
                counted[i] += cast(volume[i], u, v)
    return volume, counted, behind


def _is_inside(image, u, v):
    height, width = image.shape
    return u >= 0 and v >= 0 and u < width - 1 and v < height - 1


def nearest(image, u, v):
    if not _is_inside(image, u, v):
        return 0
    image[math.floor(v + F(0.5)), math.floor(u + F(0.5))] += F(1)
    return 1


def bilinear(image, u, v):
    if not _is_inside(image, u, v):
        return 0
    x, y = math.floor(u), math.floor(v)
    right, down = F(u) - F(x), F(v) - F(y)
    left, up = F(1) - right, F(1) - down
    image[y, x] += left * up
    image[y, x + 1] += right * up
    image[y + 1, x] += left * down
    image[y + 1, x + 1] += right * down
    return 1


def fuse(name, values):
    """Fuses one voxel's votes in float64."""
    x = [float(value) for value in values]
    n = len(x)
    if name == "H":
        return 0.0 if min(x) == 0 else n / sum(1 / value for value in x)
    return {
        "min": min(x),
        "G": math.prod(x) ** (1 / n),
        "A": sum(x) / n,
        "RMS": math.sqrt(sum(value * value for value in x) / n),
        "max": max(x),
    }[name]


def maximum(column):
    """First maximum of one pixel's (N,) values: value, plane, position by a parabola."""
    best = int(np.argmax(column))
    position = float(best)
    if 0 < best < len(column) - 1:
        left, top, right = (float(value) for value in column[best - 1 : best + 2])
        curvature = left - 2 * top + right
        if curvature < 0:
            position += 0.5 * (left - right) / curvature
    return column[best], best, position


def masked_median(values, mask, kernel_px):
    out = values.copy()
    radius = kernel_px // 2
    for y, x in np.argwhere(mask):
        window = np.s_[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1]
        near = np.sort(values[window][mask[window]])
        out[y, x] = near[(len(near) - 1) // 2]
    return out


def order_by_rows(rows, bands, band_rows):
    """Positions of image rows, stably by band; what lies outside, or nowhere, goes to the ends."""

    def band(row):
        if not row > 0:
            return 0
        return min(int(min(row, 1e9)) // band_rows, bands - 1)

    return sorted(range(len(rows)), key=lambda k: band(rows[k]))
