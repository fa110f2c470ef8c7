"""The GPU's loops before the votes: events and poses to rays, and events per pixel."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, attr-defined"

import math

import numpy as np
from numba import cuda

from eventsweep.emvs.dsi import rays_kernels
from eventsweep.emvs.dsi.rays_kernels import BACKWARDS, NO_POSE, NO_RAY, VOTES
from eventsweep.plugins.cuda.device import SLOTS
from eventsweep.plugins.cuda.device import double_product as mul

WRONG = 4  # outside the sensor, or before the event that came before it
OUTCOMES = 5

_NOWHERE, _ZERO = np.float32(np.nan), np.float32(0)

_turned = cuda.jit(device=True)(rays_kernels._turned.py_func)


@cuda.jit(device=True)
def _segment(knots_us, t):
    """The last segment that begins at or before `t`, by halving."""
    low, high = 0, len(knots_us) - 2
    while low < high:
        middle = (low + high + 1) // 2
        if knots_us[middle] <= t:
            low = middle
        else:
            high = middle - 1
    return low


@cuda.jit(device=True)
def _origin(position_m, s, share, i, r0, r1, r2, T):
    """Coordinate `i` of the camera's centre, in the reference view."""
    body_m = mul(1 - share, position_m[s, i]) + mul(share, position_m[s + 1, i])
    return body_m + mul(r0, T[0, 3]) + mul(r1, T[1, 3]) + mul(r2, T[2, 3])


@cuda.jit(device=True)
def _ray(bx, by, share, s, position_m, quat, axis, angle, T, K, out, k):
    """Fills ray `k`, as `emvs.dsi.rays_kernels.rays` does; returns what becomes of its event."""
    r = _turned(quat[s], axis[s], share * angle[s])
    ex = mul(T[0, 0], bx) + mul(T[0, 1], by) + T[0, 2]
    ey = mul(T[1, 0], bx) + mul(T[1, 1], by) + T[1, 2]
    ez = mul(T[2, 0], bx) + mul(T[2, 1], by) + T[2, 2]
    dz = mul(r[6], ex) + mul(r[7], ey) + mul(r[8], ez)
    if dz <= 0:
        return BACKWARDS
    dx = (mul(r[0], ex) + mul(r[1], ey) + mul(r[2], ez)) / dz
    dy = (mul(r[3], ex) + mul(r[4], ey) + mul(r[5], ez)) / dz
    x = _origin(position_m, s, share, 0, r[0], r[1], r[2], T)
    y = _origin(position_m, s, share, 1, r[3], r[4], r[5], T)
    z = _origin(position_m, s, share, 2, r[6], r[7], r[8], T)
    out[0, k] = mul(K[0, 0], dx) + K[0, 2]
    out[1, k] = mul(K[0, 0], x - mul(dx, z))
    out[2, k] = mul(K[1, 1], dy) + K[1, 2]
    out[3, k] = mul(K[1, 1], y - mul(dy, z))
    out[4, k] = z
    return VOTES


@cuda.jit(device=True)
def _cast(k, x, y, pose_us, bearing, knots_us, position_m, quat, axis, angle, T, K, out):
    t = pose_us[k]
    if x[k] >= bearing.shape[1] or y[k] >= bearing.shape[0] or (k > 0 and t < pose_us[k - 1]):
        return WRONG
    if t < knots_us[0] or t > knots_us[len(knots_us) - 1]:
        return NO_POSE
    bx, by = bearing[y[k], x[k], 0], bearing[y[k], x[k], 1]
    if math.isnan(bx) or math.isnan(by):
        return NO_RAY
    s = _segment(knots_us, t)
    share = (t - knots_us[s]) / (knots_us[s + 1] - knots_us[s])
    return _ray(bx, by, share, s, position_m, quat, axis, angle, T, K, out, k)


@cuda.jit(cache=True)
def rays(x, y, pose_us, bearing, knots_us, position_m, quat, axis, angle, T, K, out, counts):
    """Rays of events in the reference view, each with a pose of its own; a thread per event.

    Arrays as in `emvs.dsi.rays_kernels.rays`, and
        out: (5, N) float32, filled: a_u, b_u, a_v, b_v, c_z; NaN for events that do not vote.
        counts: (OUTCOMES, SLOTS) int64 zeros, added to: events by what became of them, except
            those that vote.
    """
    k = cuda.grid(1)
    if k < len(x):
        outcome = _cast(
            k, x, y, pose_us, bearing, knots_us, position_m, quat, axis, angle, T, K, out
        )
        if outcome != VOTES:
            out[0, k] = out[2, k] = _NOWHERE
            out[1, k] = out[3, k] = out[4, k] = _ZERO
            cuda.atomic.add(counts, (outcome, k & (SLOTS - 1)), np.int64(1))


@cuda.jit(cache=True)
def count_events(x, y, p, image):
    """Adds every event to its pixel of its polarity; `image` (2, H, W) int32."""
    k = cuda.grid(1)
    if k < len(x):
        cuda.atomic.add(image, (np.int64(p[k]), np.int64(y[k]), np.int64(x[k])), np.int32(1))
