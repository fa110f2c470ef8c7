"""The map folder: what a mapper leaves for scores and reports, in files of documented form."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.depth.depth_map import DepthMap
from emvs.depth.inpainting import Dense, inpaint, write_dense
from emvs.depth.point_cloud import back_project_map, without_outliers, write_ply
from emvs.dsi.method import file_name
from emvs.dsi.slices import Slices
from emvs.errors import InputError
from emvs.map_files import (
    check_array,
    read_dense,
    read_depth,
    read_npz,
    read_slices,
    write_depth,
    write_slices,
)
from emvs.map_info import (
    SCHEMA_VERSION,
    HotPixelInfo,
    MapInfo,
    RecordingInfo,
    WindowInfo,
    read_info,
)
from emvs.result import WindowResult
from emvs.utils.runtime import versions

__all__ = [
    "MapInfo", "RecordingInfo", "StoredMap", "StoredWindow", "WindowInfo", "read_map",
    "write_index", "write_window",
]  # fmt: skip


def write_window(
    directory: Path,
    result: WindowResult,
    config: MapperConfig,
    camera_names: Sequence[str],
    *,
    clouds: bool = True,
    name: str | None = None,
) -> WindowInfo:
    """Writes one window's folder; `directory` is made, and its name becomes the window's.

    Args:
        directory: such as `MAP/w000`, in a folder that the caller writes atomically.
        result: the mapped window.
        config: radius filter of the clouds.
        camera_names: one per camera, for the counts.
        clouds: whether to write `cloud.ply` (loads open3d).
        name: of the window, where its folder has another one for now.

    Returns:
        The window's entry of `map.json`, for `write_index`.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for depth_map in result.depth_maps.values():
        folder = directory / file_name(depth_map.method)
        folder.mkdir()
        write_depth(folder / "depth.npz", depth_map)
        if config.inpaint:
            write_dense(folder / "dense.npz", inpaint(depth_map))
        if clouds:
            cloud = back_project_map(depth_map)
            cloud = without_outliers(cloud, config.radius_m, config.radius_neighbours)
            write_ply(folder / "cloud.ply", cloud)
    write_slices(directory / "slices.npz", result.slices)
    np.savez(directory / "events.npz", counts=result.event_image)
    return WindowInfo(
        name=name or directory.name,
        t0_us=result.window.t0_us,
        t1_us=result.window.t1_us,
        t_ref_us=result.window.t_ref_us,
        methods=tuple(result.depth_maps),
        counts={
            name: counts.to_json() for name, counts in zip(camera_names, result.counts, strict=True)
        },
        points={method: found.points for method, found in result.depth_maps.items()},
        device=result.device,
    )


def write_index(
    directory: Path,
    recording: RecordingInfo,
    config: MapperConfig,
    windows: Sequence[WindowInfo],
    hot_pixels: Mapping[str, HotPixelInfo] = MappingProxyType({}),
) -> None:
    """Writes `map.json`, last: a folder without it is no map."""
    info = MapInfo(
        schema_version=SCHEMA_VERSION,
        recording=recording,
        config=config,
        versions=versions(),
        windows=tuple(windows),
        hot_pixels=dict(hot_pixels),
    )
    text = json.dumps(info.model_dump(mode="json"), indent=2, ensure_ascii=False)
    (directory / "map.json").write_text(text + "\n", encoding="utf-8")


class StoredWindow:
    """One window of a map folder; files are read when asked for.

    Attributes:
        path: its folder.
        info: its entry of `map.json`.
    """

    def __init__(self, path: Path, info: WindowInfo) -> None:
        self.path, self.info = path, info

    def __repr__(self) -> str:
        info = self.info
        points = ", ".join(f"{name} {info.points.get(name, '?')}" for name in info.methods)
        return (
            f"StoredWindow({str(self.path)!r}, {info.t0_us} to {info.t1_us} µs; points: {points})"
        )

    def depth_map(self, method: str) -> DepthMap:
        """Reads one method's depth map.

        Raises:
            InputError: a method that was not mapped, or a missing or damaged file.
        """
        return read_depth(self._folder(method) / "depth.npz", method)

    def dense(self, method: str) -> Dense:
        """Reads one method's depth with its gaps filled, which `inpaint` writes.

        Raises:
            InputError: a method that was not mapped, a map made without `inpaint`, or a damaged
                file.
        """
        path = self._folder(method) / "dense.npz"
        if not path.exists():
            raise InputError(f"{path}: no such file; map with inpaint=True to fill")
        camera = self.depth_map(method).camera
        return read_dense(path, (camera.height_px, camera.width_px))

    def _folder(self, method: str) -> Path:
        if method not in self.info.methods:
            raise InputError(
                f"{self.path}: no method {method!r}, it has {', '.join(self.info.methods)}"
            )
        return self.path / file_name(method)

    @cached_property
    def slices(self) -> Slices:
        """One image row of every fused volume."""
        # The view may have a size of its own, unlike the sensor whose events are counted.
        width_px = self.depth_map(self.info.methods[0]).camera.width_px
        return read_slices(self.path / "slices.npz", self.info.methods, width_px)

    @cached_property
    def event_image(self) -> NDArray[np.uint32]:
        """(2, H, W) events of camera 0 per pixel: darker, brighter."""
        path = self.path / "events.npz"
        counts = read_npz(path, ("counts",))["counts"]
        check_array(path, "counts", counts, "u", (2, *counts.shape[1:3]))
        return counts


class StoredMap:
    """A map folder.

    Attributes:
        path: the folder.
        info: what `map.json` says.
        windows: its windows, in order.
    """

    def __init__(self, path: Path, info: MapInfo) -> None:
        self.path, self.info = path, info
        self.windows = tuple(StoredWindow(path / window.name, window) for window in info.windows)

    def __repr__(self) -> str:
        methods = ", ".join(
            dict.fromkeys(name for one in self.info.windows for name in one.methods)
        )
        state = "" if self.info.complete else ", unfinished"
        return (
            f"StoredMap({str(self.path)!r}, of {self.info.recording.name}: {len(self.windows)} "
            f"window{'s' * (len(self.windows) != 1)}{state}; methods: {methods})"
        )


def read_map(path: Path) -> StoredMap:
    """Opens a map folder; the arrays are read when asked for.

    Raises:
        InputError: no map there, or a `map.json` that is damaged or of another version.
    """
    return StoredMap(Path(path), read_info(Path(path)))
