"""Compiled loops that light the samples of a picture whose triangles are known.

Along a row, a run of samples sees one triangle. Light and texture coordinates over z are linear in
a sample's column and row, and so is 1/z; runs are worked through in blocks that share a level of
detail, taken at their middle.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.plugins.raster.light_kernels import log2
from eventsweep.plugins.raster.visibility_kernels import shift

_BLOCK = 32
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_TEXEL = np.float32(1 / 65535)


@njit(cache=True, nogil=True)
def planes(made, edges, source, light, places, rho, light_over_z, places_over_z):
    """Fills what samples need of the triangles seen: factors of column, row, and value at 0.

    Args:
        made: N, how many are seen.
        edges: (N, 3, 3) of `visibility_kernels.visible`.
        source: (N,) which triangles these are.
        light: (T, 3, 3) of corners.
        places: (T, 3, 3) texture coordinates of corners.
        rho: out, (N, 3) of 1/z.
        light_over_z: out, (N, 3, 3).
        places_over_z: out, (N, 3, 3).
    """
    for n in range(made):
        t = source[n]
        for k in range(3):
            rho[n, k] = edges[n, 0, k] + edges[n, 1, k] + edges[n, 2, k]
            for c in range(3):
                total, place = 0.0, 0.0
                for i in range(3):
                    total += light[t, i, c] * edges[n, i, k]
                    place += places[t, i, c] * edges[n, i, k]
                light_over_z[n, c, k] = total
                places_over_z[n, c, k] = place


@njit(cache=True, nogil=True)
def _at(plane, x, y):
    return plane[0] * x + plane[1] * y + plane[2]


@njit(cache=True, nogil=True)
def _larger(u_x, v_x, u_y, v_y):
    """The base-2 logarithm of how many texels the longer of two steps passes."""
    return 0.5 * log2(max(u_x * u_x + v_x * v_x, u_y * u_y + v_y * v_y, 1e-24))


@njit(cache=True, nogil=True)
def _flat_detail(place, rho, x, y, width, height, down):
    """Level of detail of a flat texture at a sample."""
    q = _at(rho, x, y)
    u, v = _at(place[0], x, y) / q, _at(place[1], x, y) / q
    w, h = width / q, height / q
    return _larger(
        (place[0, 0] - u * rho[0]) * w, (place[1, 0] - v * rho[0]) * h,
        (place[0, 1] - u * rho[1]) * w * down, (place[1, 1] - v * rho[1]) * h * down,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _cube_detail(place, x, y, width, down):
    """Level of detail of a cube's texture: on the side that a direction meets."""
    s, t, r = _at(place[0], x, y), _at(place[1], x, y), _at(place[2], x, y)
    far = max(abs(s), abs(t), abs(r))
    major = 0 if abs(s) == far else (1 if abs(t) == far else 2)
    a, b = (major + 1) % 3, (major + 2) % 3
    ahead = _at(place[major], x, y)
    scale = 0.5 * width / ahead
    u, v = _at(place[a], x, y) / ahead, _at(place[b], x, y) / ahead
    return _larger(
        (place[a, 0] - u * place[major, 0]) * scale, (place[b, 0] - v * place[major, 0]) * scale,
        (place[a, 1] - u * place[major, 1]) * scale * down,
        (place[b, 1] - v * place[major, 1]) * scale * down,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _flat_places(place, rho, x, y, count, u, v, side):
    """Fills `u` and `v` of a flat texture, 0 to 1: it repeats."""
    q, q_x = np.float32(_at(rho, x, y)), np.float32(rho[0])
    s, s_x = np.float32(_at(place[0], x, y)), np.float32(place[0, 0])
    t, t_x = np.float32(_at(place[1], x, y)), np.float32(place[1, 0])
    for k in range(count):
        step = np.float32(k)
        z = _ONE / (q + q_x * step)
        a, b = (s + s_x * step) * z, (t + t_x * step) * z
        u[k] = a - np.floor(a)
        v[k] = b - np.floor(b)
        side[k] = 0


@njit(cache=True, nogil=True)
def _cube_places(place, x, y, count, u, v, side):
    """Fills the side of a cube that a direction meets, and where, 0 to 1."""
    s, s_x = np.float32(_at(place[0], x, y)), np.float32(place[0, 0])
    t, t_x = np.float32(_at(place[1], x, y)), np.float32(place[1, 0])
    r, r_x = np.float32(_at(place[2], x, y)), np.float32(place[2, 0])
    for k in range(count):
        step = np.float32(k)
        a, b, c = s + s_x * step, t + t_x * step, r + r_x * step
        f_a, f_b, f_c = abs(a), abs(b), abs(c)
        by_a = (f_a >= f_b) & (f_a >= f_c)
        by_b = (not by_a) & (f_b >= f_c)
        far = f_a if by_a else (f_b if by_b else f_c)
        first = (-c if a > _ZERO else c) if by_a else (a if by_b else (a if c > _ZERO else -a))
        second = -b if not by_b else (c if b > _ZERO else -c)
        u[k] = first / far * _HALF + _HALF
        v[k] = second / far * _HALF + _HALF
        ahead = a if by_a else (b if by_b else c)
        side[k] = (0 if by_a else (2 if by_b else 4)) + (0 if ahead > _ZERO else 1)


@njit(cache=True, nogil=True)
def _looked_up(texels, level, u, v, side, count, out):
    """Fills `out` with texels of a level (3,), between four of them."""
    width, height = np.float32(level[1]), np.float32(level[2])
    row = level[1] + 2
    area = row * (level[2] + 2)
    for k in range(count):
        a, b = u[k] * width + _HALF, v[k] * height + _HALF
        i, j = np.int32(a), np.int32(b)
        p, q = a - np.float32(i), b - np.float32(j)
        at = np.uint64(level[0] + side[k] * area + j * row + i)
        below = at + np.uint64(row)
        t00, t01 = np.float32(texels[at]), np.float32(texels[at + np.uint64(1)])
        t10, t11 = np.float32(texels[below]), np.float32(texels[below + np.uint64(1)])
        upper, lower = t00 + p * (t01 - t00), t10 + p * (t11 - t10)
        out[k] = (upper + q * (lower - upper)) * _TEXEL


@njit(cache=True, nogil=True)
def _textured(texels, levels, count, detail, u, v, side, n, near, far):
    """Fills `near` (n,) with a texture's values, between two levels of detail."""
    detail = min(max(detail, 0.0), float(count - 1))
    first = int(detail)
    share = np.float32(detail - first)
    _looked_up(texels, levels[first], u, v, side, n, near)
    if share > _ZERO:
        _looked_up(texels, levels[min(first + 1, count - 1)], u, v, side, n, far)
        for k in range(n):
            near[k] += share * (far[k] - near[k])


@njit(cache=True, nogil=True)
def _add(light, rho, x, y, values, textured, out):
    """Adds a colour's light, times its texture."""
    q, q_x = np.float32(_at(rho, x, y)), np.float32(rho[0])
    s, s_x = np.float32(_at(light, x, y)), np.float32(light[0])
    for k in range(len(out)):
        step = np.float32(k)
        value = (s + s_x * step) / (q + q_x * step)
        out[k] += value * values[k] if textured else value


@njit(cache=True, nogil=True)
def shade(
    ids, owner, texture, channels, rho, light_over_z, places_over_z, texels, levels, shapes,
    stride, view, bias, nothing, out,
):  # fmt: skip
    """Fills `out` (H, W) float32 with the light of all samples in a view; 0 where nothing is seen.

    Args:
        ids: (H, W) of `visibility_kernels.visible`.
        owner: (N,) the geom of each triangle seen.
        texture: (G,) channel of a geom, -1 for none.
        channels: (G,) 3 where there are three of light and texture, else 1.
        rho: (N, 3), as the next two, of `planes`.
        light_over_z: (N, 3, 3).
        places_over_z: (N, 3, 3).
        texels: see `textures.Texels`, as the next two.
        levels: (T, 16, 3).
        shapes: (T, 2).
        stride: rows that lie beside one another.
        view: (4,) first and last column, first and last row.
        bias: added to the level of detail.
        nothing: what is seen where there is no triangle: the sky's number, or -1.
        out: light.
    """
    u, v = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    near, far = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    side = np.empty(_BLOCK, np.int64)
    end = view[1] + 1
    for y in range(view[2], view[3] + 1):
        x0 = shift(y, stride)
        x = view[0]
        while x < end:
            n, stop = ids[y, x], x + 1
            while stop < end and stop - x < _BLOCK and ids[y, stop] == n:
                stop += 1
            part = out[y, x:stop]
            part[:] = _ZERO
            n = nothing if n < 0 else n
            if n >= 0:
                g = owner[n]
                for c in range(channels[g]):
                    channel = texture[g] + c
                    if texture[g] >= 0 and c == 0:
                        middle, level = x + x0 + 0.5 * (stop - 1 - x), levels[channel, 0]
                        if shapes[channel, 1]:
                            detail = _cube_detail(places_over_z[n], middle, y, level[1], stride)
                            _cube_places(places_over_z[n], x + x0, y, stop - x, u, v, side)
                        else:
                            detail = _flat_detail(
                                places_over_z[n], rho[n], middle, y, level[1], level[2], stride
                            )
                            _flat_places(places_over_z[n], rho[n], x + x0, y, stop - x, u, v, side)
                    if texture[g] >= 0:
                        _textured(
                            texels, levels[channel], shapes[channel, 0], detail + bias, u, v, side,
                            stop - x, near, far,
                        )  # fmt: skip
                    _add(light_over_z[n, c], rho[n], x + x0, y, near, texture[g] >= 0, part)
            x = stop
