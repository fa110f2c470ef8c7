"""Distorting lenses and large views: what each pixel sees, and in which sub-view it is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.rendering.sub_views import LensMap, sub_views

# Of a unit ray, anywhere in its pixel: less is no depth along the axis to speak of.
_LEAST_Z = 1e-3


@lru_cache(maxsize=8)
def _bearings(camera: Camera) -> NDArray[np.float64]:
    """(H, W, 2) bearings of all pixels, NaN where there is no ray; every table here begins so."""
    bearing = camera.bearing_table()
    bearing.setflags(write=False)
    return bearing


@lru_cache(maxsize=16)
def bearing_steps(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(H, W, 2) bearings of all pixels, and (H, W, 2, 2) their change by column and by row.

    Raises:
        InputError: the lens gives a pixel no ray.
    """
    bearing = _bearings(camera)
    _refuse_blind(camera, np.isnan(bearing[..., 0]))
    by_row, by_column = np.gradient(bearing, axis=(0, 1), edge_order=2)
    return bearing, np.stack([by_column, by_row], axis=-1)


def _refuse_blind(camera: Camera, blind: NDArray[np.bool_]) -> None:
    if blind.any():
        raise InputError(
            f"{camera.model} lens {camera.distortion} has no ray for {int(blind.sum())} of "
            f"{camera.width_px * camera.height_px} pixels: it folds over, or sees 180 degrees or "
            "more; correct the calibration or crop the sensor"
        )


@lru_cache(maxsize=4)
def lens_map(camera: Camera, supersample: int, border_px: int = 0) -> LensMap:
    """The sub-views of a camera with S x S samples per pixel, and every pixel in them.

    Pixels of a border that have no ray show what the nearest pixel with one shows.

    Raises:
        InputError: the lens gives a pixel within the border no ray.
    """
    rays = _rays(camera)
    by_row, by_column = (_gradient(rays, axis) for axis in (0, 1))
    change = np.stack([by_column, by_row], axis=-1)
    least_z = rays[..., 2] - 0.5 * np.abs(change[..., 2, :]).sum(axis=-1)
    blind = ~(least_z > _LEAST_Z)
    inner = slice(border_px, -border_px or None)
    _refuse_blind(camera, blind[inner, inner])
    rays[blind] = change[blind] = np.nan
    lens = sub_views(rays, change, supersample)
    if not blind.any():
        return lens
    at = _nearest_known(blind)
    return replace(lens, position=lens.position[at], step=lens.step[at], ratio=lens.ratio[at])


@lru_cache(maxsize=16)
def known_bearings(camera: Camera) -> NDArray[np.float64]:
    """(H, W, 2) bearings of all pixels; those without a ray have the nearest one's."""
    bearing = _bearings(camera)
    blind = np.isnan(bearing[..., 0])
    known: NDArray[np.float64] = bearing[_nearest_known(blind)] if blind.any() else bearing
    return known


def _rays(camera: Camera) -> NDArray[np.float64]:
    """(H, W, 3) unit vectors, which change evenly up to the rim; NaN where there is no ray."""
    bearing = _bearings(camera)
    rays = np.concatenate([bearing, np.ones_like(bearing[..., :1])], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _gradient(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """`np.gradient`, one-sided beside NaN."""
    central: NDArray[np.float64] = np.gradient(values, axis=axis, edge_order=2)
    if not np.isnan(central).any():
        return central
    ahead = np.diff(values, axis=axis, append=np.nan * values.take([-1], axis))
    behind = np.diff(values, axis=axis, prepend=np.nan * values.take([0], axis))
    for other in (ahead, behind):
        central = np.where(np.isnan(central), other, central)
    return central


def _nearest_known(blind: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """Row and column of the nearest pixel that is not blind, (H, W) each."""
    from scipy import ndimage  # few lenses need it, and a first picture waits for imports

    return tuple(ndimage.distance_transform_edt(blind, return_distances=False, return_indices=True))


def nearest_samples(lens: LensMap, samples: NDArray[Any]) -> NDArray[Any]:
    """The sample nearest to each pixel's centre, (H, W, ...), from (Hs, Ws, ...)."""
    columns, rows = np.rint(lens.position).astype(np.int32).transpose(2, 0, 1)
    nearest: NDArray[Any] = samples[rows, columns]
    return nearest


def edges(camera: Camera) -> NDArray[np.float64]:
    """Bearings x/z of the left and right and y/z of the top and bottom edge of the sensor."""
    # Pixel centres are integers, so the sensor ends half a pixel beyond the outermost centres.
    x = (np.array([0, camera.width_px]) - 0.5 - camera.cx_px) / camera.fx_px
    y = (np.array([0, camera.height_px]) - 0.5 - camera.cy_px) / camera.fy_px
    return np.concatenate([x, y])


def lens_of(rig: Rig, k: int, supersample: int, border_px: int = 0) -> LensMap | None:
    """The map of one camera's lens, with pixels beyond its sensor; None for a pinhole.

    Raises:
        InputError: a pixel of the sensor without a ray; names the camera.
    """
    if rig.cameras[k].model == "pinhole":
        return None
    with located(f"camera {rig.camera_names[k]} of rig {rig.name}"):
        return lens_map(widened_camera(rig.cameras[k], border_px), supersample, border_px)


def widened(rig: Rig, border_px: int) -> Rig:
    """The rig with sensors that reach `border_px` further on all sides."""
    cameras = tuple(widened_camera(camera, border_px) for camera in rig.cameras)
    return replace(rig, cameras=cameras)


def border_of(camera: Camera, drawn: Camera) -> int:
    """How far a camera of `widened` reaches beyond the original, px."""
    return (drawn.width_px - camera.width_px) // 2


def widened_camera(camera: Camera, border_px: int) -> Camera:
    """The camera with a sensor that reaches so much further; a lens may have no rays there."""
    return replace(
        camera,
        width_px=camera.width_px + 2 * border_px,
        height_px=camera.height_px + 2 * border_px,
        cx_px=camera.cx_px + border_px,
        cy_px=camera.cy_px + border_px,
    )


def buffer_size(rig: Rig, lenses: tuple[LensMap | None, ...], supersample: int) -> tuple[int, int]:
    """Width and height of the largest picture that is drawn at once, samples."""
    cameras = rig.cameras * (len(lenses) // len(rig))
    shapes = [
        lens.shape if lens else (supersample * camera.height_px, supersample * camera.width_px)
        for camera, lens in zip(cameras, lenses, strict=True)
    ]
    return max(columns for _, columns in shapes), max(rows for rows, _ in shapes)


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
