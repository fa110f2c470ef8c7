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

BLOCK = 64
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
TEXEL = np.float32(1 / 65535)


@njit(cache=True, nogil=True, error_model="numpy")
def planes(first, made, edges, source, light, places, rho, light_over_z, places_over_z):
    """Fills what samples need of the triangles seen: factors of column, row, and value at 0.

    Args:
        first: the first to fill.
        made: N, how many are seen.
        edges: (N, 3, 3) of `visibility_kernels.visible`.
        source: (N,) which triangles these are.
        light: (N, 3, 3) of corners.
        places: (T, 3, 3) texture coordinates of corners.
        rho: out, (N, 3) of 1/z.
        light_over_z: out, (N, 3, 3).
        places_over_z: out, (N, 3, 3).
    """
    for n in range(first, made):
        t = source[n]
        for k in range(3):
            rho[n, k] = edges[n, 0, k] + edges[n, 1, k] + edges[n, 2, k]
            for c in range(3):
                total, place = 0.0, 0.0
                for i in range(3):
                    total += light[n, i, c] * edges[n, i, k]
                    place += places[t, i, c] * edges[n, i, k]
                light_over_z[n, c, k] = total
                places_over_z[n, c, k] = place


@njit(cache=True, nogil=True, error_model="numpy")
def at(planes, n, k, x, y):
    """The value of plane k of triangle n; views of arrays would cost more than the sums."""
    return planes[n, k, 0] * x + planes[n, k, 1] * y + planes[n, k, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _larger(u_x, v_x, u_y, v_y):
    """The base-2 logarithm of how many texels the longer of two steps passes."""
    return 0.5 * log2(max(u_x * u_x + v_x * v_x, u_y * u_y + v_y * v_y, 1e-24))


@njit(cache=True, nogil=True, error_model="numpy")
def flat_detail(places, rho, n, x, y, width, height, down):
    """Level of detail of a flat texture at a sample."""
    z = 1.0 / (rho[n, 0] * x + rho[n, 1] * y + rho[n, 2])
    u, v = at(places, n, 0, x, y) * z, at(places, n, 1, x, y) * z
    w, h = width * z, height * z
    return _larger(
        (places[n, 0, 0] - u * rho[n, 0]) * w, (places[n, 1, 0] - v * rho[n, 0]) * h,
        (places[n, 0, 1] - u * rho[n, 1]) * w * down, (places[n, 1, 1] - v * rho[n, 1]) * h * down,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def cube_detail(places, n, x, y, width, down):
    """Level of detail of a cube's texture: on the side that a direction meets."""
    s, t, r = at(places, n, 0, x, y), at(places, n, 1, x, y), at(places, n, 2, x, y)
    f_s, f_t, f_r = abs(s), abs(t), abs(r)
    far = 0 if (f_s >= f_t) & (f_s >= f_r) else (1 if f_t >= f_r else 2)
    a, b = (far + 1) % 3, (far + 2) % 3
    per = 1.0 / (s if far == 0 else (t if far == 1 else r))
    u = per * (t if far == 0 else (r if far == 1 else s))
    v = per * (r if far == 0 else (s if far == 1 else t))
    w = 0.5 * width * per
    return _larger(
        (places[n, a, 0] - u * places[n, far, 0]) * w,
        (places[n, b, 0] - v * places[n, far, 0]) * w,
        (places[n, a, 1] - u * places[n, far, 1]) * w * down,
        (places[n, b, 1] - v * places[n, far, 1]) * w * down,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _flat_places(places, rho, n, x, y, count, u, v, side):
    """Fills `u` and `v` of a flat texture, 0 to 1: it repeats."""
    q = np.float32(rho[n, 0] * x + rho[n, 1] * y + rho[n, 2])
    s, t = np.float32(at(places, n, 0, x, y)), np.float32(at(places, n, 1, x, y))
    q_x = np.float32(rho[n, 0])
    s_x, t_x = np.float32(places[n, 0, 0]), np.float32(places[n, 1, 0])
    for k in range(count):
        step = np.float32(np.int32(k))
        z = _ONE / (q + q_x * step)
        a, b = (s + s_x * step) * z, (t + t_x * step) * z
        u[k] = a - np.floor(a)
        v[k] = b - np.floor(b)
        side[k] = np.int32(0)


@njit(cache=True, nogil=True, error_model="numpy")
def side_of(a, b, c):
    """Where a direction meets a cube: 0 to 1 along two axes, and the number of the side."""
    f_a, f_b, f_c = abs(a), abs(b), abs(c)
    by_a = (f_a >= f_b) & (f_a >= f_c)
    by_b = (not by_a) & (f_b >= f_c)
    far = f_a if by_a else (f_b if by_b else f_c)
    first = (-c if a > _ZERO else c) if by_a else (a if by_b else (a if c > _ZERO else -a))
    second = -b if not by_b else (c if b > _ZERO else -c)
    per = _HALF / far
    ahead = a if by_a else (b if by_b else c)
    side = np.int32((0 if by_a else (2 if by_b else 4)) + (0 if ahead > _ZERO else 1))
    return first * per + _HALF, second * per + _HALF, side


@njit(cache=True, nogil=True, error_model="numpy")
def _cube_places(places, n, x, y, count, u, v, side):
    """Fills the side of a cube that a direction meets, and where, 0 to 1."""
    s, s_x = np.float32(at(places, n, 0, x, y)), np.float32(places[n, 0, 0])
    t, t_x = np.float32(at(places, n, 1, x, y)), np.float32(places[n, 1, 0])
    r, r_x = np.float32(at(places, n, 2, x, y)), np.float32(places[n, 2, 0])
    for k in range(count):
        step = np.float32(np.int32(k))
        a, b, c = s + s_x * step, t + t_x * step, r + r_x * step
        u[k], v[k], side[k] = side_of(a, b, c)


@njit(cache=True, nogil=True, error_model="numpy")
def _looked_up(texels, first, width, height, u, v, side, count, out):
    """Fills `out` with texels of a level that begins at `first`, between four of them."""
    w, h, row = np.float32(width), np.float32(height), np.int32(width + 2)
    area = np.int32(row * (height + 2))
    base, one, below = np.uint64(first), np.uint64(1), np.uint64(width + 2)
    for k in range(count):
        a, b = u[k] * w + _HALF, v[k] * h + _HALF
        i, j = np.int32(a), np.int32(b)
        p, q = a - np.float32(i), b - np.float32(j)
        at = base + np.uint64(np.uint32(side[k] * area + j * row + i))
        t00, t01 = np.float32(texels[at]), np.float32(texels[at + one])
        at += below
        t10, t11 = np.float32(texels[at]), np.float32(texels[at + one])
        upper, lower = t00 + p * (t01 - t00), t10 + p * (t11 - t10)
        out[k] = upper + q * (lower - upper)


@njit(cache=True, nogil=True, error_model="numpy")
def textured(texels, levels, channel, most, detail, u, v, side, n, near, far):
    """Fills `near` (n,) with a texture's values, between two levels of detail."""
    detail = min(max(detail, 0.0), float(most))
    k = int(detail)
    share = np.float32(detail - k)
    _looked_up(
        texels, levels[channel, k, 0], levels[channel, k, 1], levels[channel, k, 2], u, v, side, n,
        near,
    )  # fmt: skip
    if share > _ZERO:
        k += 1
        _looked_up(
            texels, levels[channel, k, 0], levels[channel, k, 1], levels[channel, k, 2], u, v,
            side, n, far,
        )  # fmt: skip
        for k in range(n):
            near[k] += share * (far[k] - near[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _add(light, rho, n, c, x, y, values, textured, out):
    """Adds a colour's light, times its texture."""
    q, q_x = np.float32(rho[n, 0] * x + rho[n, 1] * y + rho[n, 2]), np.float32(rho[n, 0])
    full = TEXEL if textured else _ONE
    s, s_x = np.float32(at(light, n, c, x, y)) * full, np.float32(light[n, c, 0]) * full
    for k in range(len(out)):
        step = np.float32(np.int32(k))
        value = (s + s_x * step) / (q + q_x * step)
        out[k] += value * values[k] if textured else value


@njit(cache=True, nogil=True, error_model="numpy")
def glaze(ids, glass, behind, light, opacity, view, out):
    """Puts the light of glass over what lies behind it, where nothing is nearer.

    Args:
        ids: (H, W) triangles of the glass, below 0 where there is none.
        glass: (H, W) how near they are.
        behind: (H, W) how near the rest is.
        light: (H, W) of the glass.
        opacity: (H, W) 0 to 1.
        view: (4,) first and last column, first and last row.
        out: in and out, (H, W).
    """
    for y in range(view[2], view[3] + 1):
        for x in range(view[0], view[1] + 1):
            if ids[y, x] >= 0 and glass[y, x] >= behind[y, x]:
                out[y, x] += opacity[y, x] * (light[y, x] - out[y, x])


@njit(cache=True, nogil=True, error_model="numpy")
def add_where(ids, wanted, light, view, out):
    """Adds light (H, W) where a sample sees one of the `wanted` (N,) triangles."""
    for y in range(view[2], view[3] + 1):
        for x in range(view[0], view[1] + 1):
            if ids[y, x] >= 0 and wanted[ids[y, x]]:
                out[y, x] += light[y, x]


@njit(cache=True, nogil=True, error_model="numpy")
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
    u, v = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    near, far = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    side = np.empty(BLOCK, np.int32)
    end = view[1] + 1
    for y in range(view[2], view[3] + 1):
        x0, x = shift(y, stride), view[0]
        while x < end:
            n, stop, last = ids[y, x], x + 1, min(end, x + BLOCK)
            while stop < last and ids[y, stop] == n:
                stop += 1
            part, count, left = out[y, x:stop], stop - x, x + x0
            for k in range(count):
                part[k] = _ZERO
            n = nothing if n < 0 else n
            x = stop
            if n < 0:
                continue
            g = owner[n]
            channel, is_textured = texture[g], texture[g] >= 0
            if is_textured:
                middle, most = left + 0.5 * (count - 1), shapes[channel, 0] - 1
                width, height = levels[channel, 0, 1], levels[channel, 0, 2]
                if shapes[channel, 1]:
                    detail = cube_detail(places_over_z, n, middle, y, width, stride)
                    _cube_places(places_over_z, n, left, y, count, u, v, side)
                else:
                    detail = flat_detail(places_over_z, rho, n, middle, y, width, height, stride)
                    _flat_places(places_over_z, rho, n, left, y, count, u, v, side)
            for c in range(channels[g]):
                if is_textured:
                    textured(
                        texels, levels, channel + c, most, detail + bias, u, v, side, count, near,
                        far,
                    )  # fmt: skip
                _add(light_over_z, rho, n, c, left, y, near, is_textured, part)
