"""Which pinhole pictures a rig needs: frusta, source pictures of lenses, tiles of large views."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.geometry.camera import Camera
from emvs.geometry.rig import Rig
from sim.lens import LensMap, lens_map


def edges(camera: Camera) -> NDArray[np.float64]:
    """Bearings x/z of the left and right and y/z of the top and bottom edge of the sensor."""
    # Pixel centres are integers, so the sensor ends half a pixel beyond the outermost centres.
    return np.array(
        [
            (-0.5 - camera.cx_px) / camera.fx_px,
            (camera.width_px - 0.5 - camera.cx_px) / camera.fx_px,
            (-0.5 - camera.cy_px) / camera.fy_px,
            (camera.height_px - 0.5 - camera.cy_px) / camera.fy_px,
        ]
    )


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


def buffer_size(rig: Rig, lenses: tuple[LensMap | None, ...], supersample: int) -> tuple[int, int]:
    """Width and height of the largest picture that is drawn at once, samples."""
    sizes = [
        (m.source.width_px, m.source.height_px)
        if m
        else (supersample * camera.width_px, supersample * camera.height_px)
        for camera, m in zip(rig.cameras, lenses, strict=True)
    ]
    return max(width for width, _ in sizes), max(height for _, height in sizes)


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
