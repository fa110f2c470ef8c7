"""Distorting lenses and large views: pinhole pictures, resampled onto the sensor by a table.

A graphics library draws straight lines, so the picture that a distorting lens makes is taken from a
pinhole picture of the same optical centre and axes that is wider than the sensor and has at least
as many samples per sensor pixel, everywhere, as asked for. Where each sensor pixel lies in it is
worked out once per lens.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig

# Samples beyond the outermost position that bilinear interpolation and one-sided slopes touch.
_MARGIN = 3
_LONGEST_SIDE = 8192
_CANDIDATES = 64


@dataclass(frozen=True, eq=False)
class LensMap:
    """Where the pixels of a sensor lie in a pinhole picture.

    Attributes:
        source: the pinhole picture's camera; its pixels are the samples.
        position: (H, W, 2) float32 column and row of each sensor pixel's centre in the source
            picture, whose bottom row comes first, as graphics libraries return it.
        step: (H, W, 2, 2) float32, by how much the position changes ([..., :, 0] along the
            sensor's columns, [..., :, 1] along its rows) per sensor pixel.
    """

    source: Camera
    position: NDArray[np.float32]
    step: NDArray[np.float32]


@lru_cache(maxsize=16)
def bearing_steps(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(H, W, 2) bearings of all pixels, and (H, W, 2, 2) their change by column and by row.

    Raises:
        InputError: the lens gives a pixel no ray.
    """
    bearing = camera.bearing_table()
    blind = int(np.isnan(bearing).any(axis=-1).sum())
    if blind:
        raise InputError(
            f"{camera.model} lens {camera.distortion} has no ray for {blind} of "
            f"{camera.width_px * camera.height_px} pixels: it folds over, or sees 180 degrees or "
            "more; correct the calibration or crop the sensor"
        )
    by_row, by_column = np.gradient(bearing, axis=(0, 1), edge_order=2)
    return bearing, np.stack([by_column, by_row], axis=-1)


@lru_cache(maxsize=4)
def lens_map(camera: Camera, supersample: int) -> LensMap:
    """Chooses the source picture for a distorting camera and finds every pixel in it.

    It has at least `supersample` samples per sensor pixel and axis, anywhere on the sensor.

    Raises:
        InputError: a pixel without a ray, or a lens so wide that no pinhole picture can hold it.
    """
    bearing, slope = bearing_steps(camera)
    focal = supersample / _finest(slope)
    reach = 0.5 * np.abs(slope).sum(axis=-1)
    low = (bearing - reach).min(axis=(0, 1)) * focal
    high = (bearing + reach).max(axis=(0, 1)) * focal
    width, height = (int(n) for n in np.ceil(high - low) + 2 * _MARGIN)
    if max(width, height) > _LONGEST_SIDE:
        degrees = np.degrees(np.arctan(np.abs([low, high]).max() / focal))
        raise InputError(
            f"a lens that sees {degrees:.0f} degrees off its axis needs a pinhole picture of "
            f"{width}x{height} samples, {_LONGEST_SIDE} are possible: lower supersample or crop "
            "the sensor"
        )
    centre = _MARGIN - low
    source = Camera(width, height, focal, focal, centre[0], centre[1])
    position = bearing * focal + centre
    step = slope * focal
    position[..., 1] = height - 1 - position[..., 1]
    step[..., 1, :] *= -1
    return LensMap(source, position.astype(np.float32), step.astype(np.float32))


def _finest(slope: NDArray[np.float64]) -> float:
    """The least singular value of all matrices (H, W, 2, 2)."""
    squares = (slope**2).sum(axis=(-2, -1))
    product = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
    # In closed form for all; exactly for those that may be the least.
    least = squares - np.sqrt(np.maximum(squares**2 - 4 * product**2, 0))
    few = np.argpartition(least.ravel(), min(_CANDIDATES, least.size) - 1)[:_CANDIDATES]
    chosen = slope.reshape(-1, 2, 2)[few]
    return float(np.linalg.svd(chosen, compute_uv=False)[:, 1].min())


def nearest_samples(lens: LensMap, samples: NDArray[np.int32]) -> NDArray[np.int32]:
    """Returns the sample nearest to each pixel's centre, (H, W), from (Hs, Ws)."""
    columns, rows = np.rint(lens.position).astype(np.int32).transpose(2, 0, 1)
    nearest: NDArray[np.int32] = samples[rows, columns]
    return nearest


def edges(camera: Camera) -> NDArray[np.float64]:
    """Bearings x/z of the left and right and y/z of the top and bottom edge of the sensor."""
    # Pixel centres are integers, so the sensor ends half a pixel beyond the outermost centres.
    x = (np.array([0, camera.width_px]) - 0.5 - camera.cx_px) / camera.fx_px
    y = (np.array([0, camera.height_px]) - 0.5 - camera.cy_px) / camera.fy_px
    return np.concatenate([x, y])


def lens_of(rig: Rig, k: int, supersample: int) -> LensMap | None:
    """The map of one camera's lens; None for a pinhole.

    Raises:
        InputError: a lens that no pinhole picture can hold; names the camera.
    """
    if rig.cameras[k].model == "pinhole":
        return None
    try:
        return lens_map(rig.cameras[k], supersample)
    except InputError as error:
        raise InputError(f"camera {rig.camera_names[k]} of rig {rig.name}: {error}") from error


def widened(rig: Rig, border_px: int) -> Rig:
    """The rig with sensors that reach `border_px` further on all sides, or as far as lenses do."""
    cameras = tuple(widened_camera(camera, border_px) for camera in rig.cameras)
    return replace(rig, cameras=cameras)


def border_of(camera: Camera, drawn: Camera) -> int:
    """How far a camera of `widened` reaches beyond the original, px."""
    return (drawn.width_px - camera.width_px) // 2


@lru_cache(maxsize=16)
def widened_camera(camera: Camera, border_px: int) -> Camera:
    """The camera with a sensor that reaches so much further, or as far as its lens does."""
    wide = replace(
        camera,
        width_px=camera.width_px + 2 * border_px,
        height_px=camera.height_px + 2 * border_px,
        cx_px=camera.cx_px + border_px,
        cy_px=camera.cy_px + border_px,
    )
    if border_px == 0 or camera.model == "pinhole" or not np.isnan(wide.bearing_table()).any():
        return wide
    return widened_camera(camera, border_px - 1)


def buffer_size(rig: Rig, lenses: tuple[LensMap | None, ...], supersample: int) -> tuple[int, int]:
    """Width and height of the largest picture that is drawn at once, samples."""
    cameras = rig.cameras * (len(lenses) // len(rig))
    drawn = [(m.source, 1) if m else (c, supersample) for c, m in zip(cameras, lenses, strict=True)]
    return max(n * c.width_px for c, n in drawn), max(n * c.height_px for c, n in drawn)


def tiles(view: Camera, width_px: int, height_px: int) -> Iterator[tuple[Camera, slice, slice]]:
    """Cuts a pinhole view into parts no larger than a buffer, each with its rows and columns."""
    for row in range(0, view.height_px, height_px):
        for column in range(0, view.width_px, width_px):
            tile = replace(
                view,
                width_px=min(width_px, view.width_px - column),
                height_px=min(height_px, view.height_px - row),
                cx_px=view.cx_px - column,
                cy_px=view.cy_px - row,
            )
            rows = slice(row, row + tile.height_px)
            yield tile, rows, slice(column, column + tile.width_px)
