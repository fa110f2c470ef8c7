"""The compiled loops of the rays: from events and poses to rays, and rays grouped by image rows."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

VOTES, NO_POSE, NO_RAY, BACKWARDS = range(4)
EVENT_BLOCK = 4096  # events that a thread casts in one go
RAY_BLOCK = 1 << 17  # rays that a thread moves to their bands in one go


@njit(cache=True, nogil=True)
def _turned(quat, axis, angle):
    """Rotation matrix, row by row, of `quat` (x, y, z, w) times a turn about `axis` by `angle`."""
    s, c = np.sin(0.5 * angle), np.cos(0.5 * angle)
    ax, ay, az = axis[0] * s, axis[1] * s, axis[2] * s
    qx, qy, qz, qw = quat[0], quat[1], quat[2], quat[3]
    x = qw * ax + qx * c + qy * az - qz * ay
    y = qw * ay - qx * az + qy * c + qz * ax
    z = qw * az + qx * ay - qy * ax + qz * c
    w = qw * c - qx * ax - qy * ay - qz * az
    return (
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _pose(share, s, position_m, quat, axis, angle, offset_m):
    """Rotation of the body and place of the camera, in the reference view, `share` into segment s.

    Rotation along the great arc, position along the line.
    """
    r = _turned(quat[s], axis[s], share * angle[s])
    now, later, far = position_m[s], position_m[s + 1], 1 - share
    ox, oy, oz = offset_m[0], offset_m[1], offset_m[2]
    return r, (
        far * now[0] + share * later[0] + r[0] * ox + r[1] * oy + r[2] * oz,
        far * now[1] + share * later[1] + r[3] * ox + r[4] * oy + r[5] * oz,
        far * now[2] + share * later[2] + r[6] * ox + r[7] * oy + r[8] * oz,
    )


@njit(cache=True, nogil=True)
def _look_up(x, y, bearing):
    """(N, 2) bearings of N pixels: a loop so short that the waits for the table overlap."""
    found = np.empty((len(x), 2))
    for k in range(len(x)):
        found[k, 0] = bearing[y[k], x[k], 0]
        found[k, 1] = bearing[y[k], x[k], 1]
    return found


@njit(cache=True, nogil=True)
def rays(
    start, stop, x, y, pose_us, bearing, knots_us, position_m, quat, axis, angle, T_body_cam, K,
    a_u, b_u, a_v, b_v, c_z, outcome,
):  # fmt: skip
    """Rays of events in the reference view (rv), each with a pose of its own.

    Arrays:
        start, stop: the blocks of `EVENT_BLOCK` events to cast here.
        x, y: (N,) uint16 pixels.
        pose_us: (N,) int64, non-decreasing, the time of the pose that each event gets.
        bearing: (H, W, 2) float64, NaN where a pixel has no ray.
        knots_us: (S + 1,) int64 pose times.
        position_m: (S + 1, 3) float64, body in rv.
        quat: (S + 1, 4) float64, body in rv, x y z w.
        axis: (S, 3) float64, unit axis of the turn from each pose to the next, in the body.
        angle: (S,) float64, that turn's angle.
        T_body_cam: (4, 4) float64.
        K: (3, 3) float64, the reference view's intrinsics.
        a_u, b_u, a_v, b_v, c_z: (N,) float32, filled where `outcome` is VOTES.
        outcome: (N,) uint8, filled: VOTES, NO_POSE, NO_RAY or BACKWARDS.
    """
    R, offset_m = T_body_cam[:3, :3], T_body_cam[:3, 3]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    last_segment = len(angle) - 1
    for block in range(start, stop):
        lo, hi = block * EVENT_BLOCK, min((block + 1) * EVENT_BLOCK, len(x))
        seen = _look_up(x[lo:hi], y[lo:hi], bearing)
        s = np.searchsorted(knots_us, pose_us[lo], side="right") - 1
        s = min(max(s, 0), last_segment)
        # In dense streams many events share a microsecond, and a pose.
        posed_us = pose_us[lo] - 1
        r, place = _pose(0.0, s, position_m, quat, axis, angle, offset_m)
        for k in range(lo, hi):
            t = pose_us[k]
            if t < knots_us[0] or t > knots_us[-1]:
                outcome[k] = NO_POSE
                continue
            bx, by = seen[k - lo, 0], seen[k - lo, 1]
            if np.isnan(bx) or np.isnan(by):
                outcome[k] = NO_RAY
                continue
            if t != posed_us:
                posed_us = t
                while s < last_segment and t >= knots_us[s + 1]:
                    s += 1
                share = (t - knots_us[s]) / (knots_us[s + 1] - knots_us[s])
                r, place = _pose(share, s, position_m, quat, axis, angle, offset_m)
            ex = R[0, 0] * bx + R[0, 1] * by + R[0, 2]
            ey = R[1, 0] * bx + R[1, 1] * by + R[1, 2]
            ez = R[2, 0] * bx + R[2, 1] * by + R[2, 2]
            dz = r[6] * ex + r[7] * ey + r[8] * ez
            if dz <= 0:
                outcome[k] = BACKWARDS
                continue
            dx = (r[0] * ex + r[1] * ey + r[2] * ez) / dz
            dy = (r[3] * ex + r[4] * ey + r[5] * ez) / dz
            a_u[k] = fx * dx + cx
            b_u[k] = fx * (place[0] - dx * place[2])
            a_v[k] = fy * dy + cy
            b_v[k] = fy * (place[1] - dy * place[2])
            c_z[k] = place[2]
            outcome[k] = VOTES


@njit(cache=True, nogil=True)
def _band(v, rows, bands):
    """The band of image row `v`; what lies outside the image, or nowhere, goes to the ends."""
    if not v > np.float32(0):
        return 0
    return bands - 1 if v >= np.float32(rows * bands) else np.int64(v) // rows


@njit(cache=True, nogil=True)
def count_bands(start, stop, a_v, b_v, rho, rows, bands, counts):
    """Counts each block's rays by band.

    Arrays:
        start, stop: the blocks of `RAY_BLOCK` rays to count here.
        a_v, b_v: (N,) float32.
        counts: (blocks, bands) int64 zeros, filled.
    """
    for block in range(start, stop):
        for k in range(block * RAY_BLOCK, min((block + 1) * RAY_BLOCK, len(a_v))):
            counts[block, _band(a_v[k] + rho * b_v[k], rows, bands)] += 1


@njit(cache=True, nogil=True)
def move_to_bands(start, stop, a_v, b_v, rho, rows, bands, place, columns, ordered):
    """Moves each ray to the next free place of its band.

    Arrays:
        start, stop: the blocks of `RAY_BLOCK` rays to move here.
        a_v, b_v: (N,) float32.
        place: (blocks, bands) int64, where each block's first ray of a band goes; counted up.
        columns, ordered: five (N,) float32 each, read and filled.
    """
    for block in range(start, stop):
        for k in range(block * RAY_BLOCK, min((block + 1) * RAY_BLOCK, len(a_v))):
            band = _band(a_v[k] + rho * b_v[k], rows, bands)
            to = place[block, band]
            place[block, band] = to + 1
            ordered[0][to] = columns[0][k]
            ordered[1][to] = columns[1][k]
            ordered[2][to] = columns[2][k]
            ordered[3][to] = columns[3][k]
            ordered[4][to] = columns[4][k]
