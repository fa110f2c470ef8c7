"""The compiled loop that lights the samples of a sensor behind a lens, each where it lies exactly.

Sub-views say which triangle is seen; depth and texture coordinates are those of its planes at the
sample's own place in the sub-view, so nothing is taken between two samples. Its light is that of
the place where the sub-view sees it: beyond a small triangle its plane may be darker than black.

As in a pinhole, rows lie beside one another, those of the sensor and those of the sub-views: an
upright edge passes one after the other. Which of two rows of a sub-view tells changes from sample
to sample, so that in the mean a level edge lies where it is: in the middle of a lens all samples
lie between rows alike.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.plugins.raster.shading_kernels import (
    BLOCK,
    TEXEL,
    at,
    cube_detail,
    flat_detail,
    side_of,
    textured,
)
from eventsweep.plugins.raster.visibility_kernels import shift

_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_ROUNDED_UP = ((np.array([0, 4, 2, 6, 1, 5, 3, 7]) + 0.5) / 8).astype(np.float32)
"""What is added before a place is cut to a row, sample by sample."""


@njit(cache=True, nogil=True, error_model="numpy")
def _flat_places(places, rho, n, x, y, right, down, count, u, v, side):
    """Fills `u` and `v` of a flat texture, 0 to 1, at places beside (x, y)."""
    q = np.float32(rho[n, 0] * x + rho[n, 1] * y + rho[n, 2])
    q_x, q_y = np.float32(rho[n, 0]), np.float32(rho[n, 1])
    s, t = np.float32(at(places, n, 0, x, y)), np.float32(at(places, n, 1, x, y))
    s_x, s_y = np.float32(places[n, 0, 0]), np.float32(places[n, 0, 1])
    t_x, t_y = np.float32(places[n, 1, 0]), np.float32(places[n, 1, 1])
    for k in range(count):
        z = _ONE / (q + q_x * right[k] + q_y * down[k])
        a = (s + s_x * right[k] + s_y * down[k]) * z
        b = (t + t_x * right[k] + t_y * down[k]) * z
        u[k] = a - np.floor(a)
        v[k] = b - np.floor(b)
        side[k] = np.int32(0)


@njit(cache=True, nogil=True, error_model="numpy")
def _cube_places(places, n, x, y, right, down, count, u, v, side):
    """Fills the side of a cube that a direction meets, and where, 0 to 1."""
    s, t = np.float32(at(places, n, 0, x, y)), np.float32(at(places, n, 1, x, y))
    r = np.float32(at(places, n, 2, x, y))
    s_x, s_y = np.float32(places[n, 0, 0]), np.float32(places[n, 0, 1])
    t_x, t_y = np.float32(places[n, 1, 0]), np.float32(places[n, 1, 1])
    r_x, r_y = np.float32(places[n, 2, 0]), np.float32(places[n, 2, 1])
    for k in range(count):
        a = s + s_x * right[k] + s_y * down[k]
        b = t + t_x * right[k] + t_y * down[k]
        c = r + r_x * right[k] + r_y * down[k]
        u[k], v[k], side[k] = side_of(a, b, c)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(light, rho, n, c, x, y, right, down, values, is_textured, out):
    """Adds a colour's light, times its texture."""
    full = TEXEL if is_textured else _ONE
    q = np.float32(rho[n, 0] * x + rho[n, 1] * y + rho[n, 2])
    q_x, q_y = np.float32(rho[n, 0]), np.float32(rho[n, 1])
    s = np.float32(at(light, n, c, x, y)) * full
    s_x, s_y = np.float32(light[n, c, 0]) * full, np.float32(light[n, c, 1]) * full
    for k in range(len(out)):
        value = (s + s_x * right[k] + s_y * down[k]) / (q + q_x * right[k] + q_y * down[k])
        out[k] += value * values[k] if is_textured else value


@njit(cache=True, nogil=True, error_model="numpy")
def _row_places(position, step, v, offset, y_offset, aside, xs, ys):
    """Fills where the samples of a row lie in the sub-views."""
    supersample = len(offset)
    for u in range(position.shape[1]):
        left = position[v, u, 0] + step[v, u, 0, 1] * y_offset
        top = position[v, u, 1] + step[v, u, 1, 1] * y_offset
        for m in range(supersample):
            xs[u * supersample + m] = left + step[v, u, 0, 0] * (offset[m] + aside)
            ys[u * supersample + m] = top + step[v, u, 1, 0] * (offset[m] + aside)


@njit(cache=True, nogil=True, error_model="numpy")
def _row_depths(ratio, v, offset, y_offset, aside, seen, known, rho, xs, ys, out):
    """Fills 1/z in the lens's axes; 0 where nothing, or the sky, is seen."""
    supersample = len(offset)
    for u in range(ratio.shape[1]):
        middle = ratio[v, u, 0] + y_offset * ratio[v, u, 2]
        for m in range(supersample):
            x = u * supersample + m
            n, value = seen[x], _ZERO
            if n >= 0 and known[n]:
                found = rho[n, 0] * xs[x] + rho[n, 1] * ys[x] + rho[n, 2]
                value = np.float32(found) / (middle + (offset[m] + aside) * ratio[v, u, 1])
            out[x] = max(value, _ZERO)


@njit(cache=True, nogil=True, error_model="numpy")
def shade_lens(  # noqa: C901
    ids, owner, texture, channels, rho, light_over_z, places_over_z, texels, levels, shapes, bias,
    known, position, step, ratio, offset, stride, sub_stride, light, inverse_depth,
):  # fmt: skip
    """Fills light and 1/z of the samples of a sensor.

    Args:
        ids: (Hs, Ws) numbers of triangles in the sub-views, below 0 for none.
        owner: (N,), as the next nine, of `shading_kernels.shade`.
        texture: (G,).
        channels: (G,).
        rho: (N, 3).
        light_over_z: (N, 3, 3).
        places_over_z: (N, 3, 3).
        texels: (M,).
        levels: (T, 16, 3).
        shapes: (T, 2).
        bias: added to the level of detail.
        known: (N,) which triangles have a depth.
        position: of `sub_views.LensMap`, as the next two.
        step: (H, W, 2, 2).
        ratio: (H, W, 3).
        offset: (S,) where samples lie in a pixel, from its centre, px.
        stride: rows of samples that lie beside one another, around these places.
        sub_stride: the same of the sub-views' rows.
        light: out, (S H, S W).
        inverse_depth: out, (S H, S W).
    """
    u, v = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    near, far = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    right, down = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    along, below = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    side = np.empty(BLOCK, np.int32)
    end, supersample = light.shape[1], len(offset)
    xs, ys, seen = np.empty(end, np.float32), np.empty(end, np.float32), np.empty(end, np.int32)
    inside_x, inside_y = np.empty(end, np.float32), np.empty(end, np.float32)
    for y in range(len(light)):
        pixel, y_offset = y // supersample, offset[y % supersample]
        aside = np.float32(shift(y, stride) / supersample)
        _row_places(position, step, pixel, offset, y_offset, aside, xs, ys)
        for x in range(end):
            row = np.int32(ys[x] + _ROUNDED_UP[x % len(_ROUNDED_UP)])
            to_right = np.float32(shift(row, sub_stride))
            column = np.int32(xs[x] - to_right + _HALF)
            seen[x] = ids[np.uint32(row), np.uint32(column)]
            inside_x[x], inside_y[x] = np.float32(column) + to_right, np.float32(row)
        _row_depths(
            ratio, pixel, offset, y_offset, aside, seen, known, rho, xs, ys, inverse_depth[y]
        )
        x = 0
        while x < end:
            n, stop, last = seen[x], x + 1, min(end, x + BLOCK)
            while stop < last and seen[stop] == n:
                stop += 1
            part, count, first = light[y, x:stop], stop - x, x
            for k in range(count):
                part[k] = _ZERO
                right[k] = xs[first + k] - xs[first]
                down[k] = ys[first + k] - ys[first]
                along[k] = inside_x[first + k] - xs[first]
                below[k] = inside_y[first + k] - ys[first]
            x = stop
            if n < 0:
                continue
            left, top = float(xs[first]), float(ys[first])
            g = owner[n]
            channel, is_textured = texture[g], texture[g] >= 0
            if is_textured:
                most, width, height = (
                    shapes[channel, 0] - 1,
                    levels[channel, 0, 1],
                    levels[channel, 0, 2],
                )
                u_mid, v_mid = float(xs[first + count // 2]), float(ys[first + count // 2])
                if shapes[channel, 1]:
                    detail = cube_detail(places_over_z, n, u_mid, v_mid, width, 1)
                    _cube_places(places_over_z, n, left, top, right, down, count, u, v, side)
                else:
                    detail = flat_detail(places_over_z, rho, n, u_mid, v_mid, width, height, 1)
                    _flat_places(places_over_z, rho, n, left, top, right, down, count, u, v, side)
            for c in range(channels[g]):
                if is_textured:
                    textured(
                        texels, levels, channel + c, most, detail + bias, u, v, side, count, near,
                        far,
                    )  # fmt: skip
                _add(light_over_z, rho, n, c, left, top, along, below, near, is_textured, part)
