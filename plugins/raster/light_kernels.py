"""Compiled loops of light at the corners of triangles, as OpenGL's fixed pipeline defines it.

Powers are made from sums and products in a stated order, so all machines get the same bits.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

import numpy as np
from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

DIRECTED, SPOT = 0, 1
"""Kinds of lights: from far away, and from a place."""
_ROOT_HALF, _LN_2 = math.sqrt(0.5), math.log(2.0)


@njit(cache=True, nogil=True, error_model="numpy")
def log2(value):
    """Base-2 logarithm of a positive number, to 1e-8."""
    share, whole = math.frexp(value)
    t = (share - _ROOT_HALF) / (share + _ROOT_HALF)
    q = t * t
    series = 1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0))))
    return whole - 0.5 + 2.0 / _LN_2 * t * series


@njit(cache=True, nogil=True, error_model="numpy")
def power(base, exponent):
    """A number of 0 to 1 to a power of at least 0; 1 where that is 0."""
    if exponent == 0.0:
        return 1.0
    if base <= 0.0:
        return 0.0
    total = exponent * log2(base)
    if total < -200.0:
        return 0.0
    whole = math.floor(total + 0.5)
    x = (total - whole) * _LN_2
    series = 1.0
    for k in range(10, 0, -1):
        series = 1.0 + x / k * series
    return math.ldexp(series, int(whole))


@njit(cache=True, nogil=True, error_model="numpy")
def _unit(x, y, z):
    """A vector of length 1; 0 where it has none."""
    length = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _towards(kind, vectors, cone, p):
    """Direction from a corner to a light, and how much of the light arrives."""
    d_x, d_y, d_z = _unit(vectors[1, 0], vectors[1, 1], vectors[1, 2])
    if kind == DIRECTED:
        return -d_x, -d_y, -d_z, 1.0
    x, y, z = vectors[0, 0] - p[0], vectors[0, 1] - p[1], vectors[0, 2] - p[2]
    far = math.sqrt(x * x + y * y + z * z)
    x, y, z = _unit(x, y, z)
    fading = 1.0 / (vectors[5, 0] + far * (vectors[5, 1] + far * vectors[5, 2]))
    along = -(x * d_x + y * d_y + z * d_z)
    if cone[1] > -1.0:
        fading *= power(along, cone[0]) if along >= cone[1] else 0.0
    return x, y, z, fading


@njit(cache=True, nogil=True, error_model="numpy")
def lit(
    which, corners, normals, owner, colours, shine, channels, kinds, vectors, cones, ambient,
    weights, eye, cut, share, light,
):  # fmt: skip
    """Fills `light` (N, 3, 3) of corners: their luma, or that of each colour.

    Args:
        which: (N,) triangles.
        corners: (T, 3, 3) places of the corners, in the world's axes, m.
        normals: (T, 3, 3) of length 1.
        owner: (T,) the geom of each triangle.
        colours: (G, 4) of geoms.
        shine: (G, 3) emission, specular, exponent.
        channels: (G,) 3 to keep colours apart, else 1.
        kinds: (L,) of lights.
        vectors: (L, 6, 3) place, direction, ambient, diffuse, specular, attenuation.
        cones: (L, 2) exponent and cosine of the cut-off.
        ambient: of the scene.
        weights: (3,) of colours in luma.
        eye: (3,) where the camera is.
        cut: whether light ends at 1.
        share: what is left of colours in a mirror, else 1.
        light: out.
    """
    sums = np.empty(3)
    for n, t in enumerate(which):
        g = owner[t]
        for k in range(3):
            p, up = corners[t, k], normals[t, k]
            v_x, v_y, v_z = _unit(eye[0] - p[0], eye[1] - p[1], eye[2] - p[2])
            for c in range(3):
                sums[c] = (shine[g, 0] + ambient) * share * colours[g, c]
            for i in range(len(kinds)):
                x, y, z, arrives = _towards(kinds[i], vectors[i], cones[i], p)
                facing = up[0] * x + up[1] * y + up[2] * z
                glossy = 0.0
                if facing > 0.0 and shine[g, 1] > 0.0:
                    h_x, h_y, h_z = _unit(x + v_x, y + v_y, z + v_z)
                    towards = max(0.0, up[0] * h_x + up[1] * h_y + up[2] * h_z)
                    glossy = shine[g, 1] * power(min(1.0, towards), shine[g, 2])
                facing = max(0.0, facing)
                for c in range(3):
                    matt = share * colours[g, c] * (vectors[i, 2, c] + facing * vectors[i, 3, c])
                    sums[c] += arrives * (matt + glossy * vectors[i, 4, c])
            total = 0.0
            for c in range(3):
                value = min(1.0, sums[c]) if cut else sums[c]
                light[n, k, c] = weights[c] * value
                total += weights[c] * value
            if channels[g] == 1:
                light[n, k, 0] = total
