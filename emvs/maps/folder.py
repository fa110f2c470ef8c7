"""The map folder: what a mapper leaves for scores and reports, in files of documented form."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError, field_serializer, field_validator

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.inpainting import Dense, inpaint
from eventsweep.emvs.depth.point_cloud import back_project_map, without_outliers, write_ply
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.errors import DAMAGED_NPY, InputError, check_path, quoted
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.parameters import FrozenModel, first_fault
from eventsweep.emvs.utils.address import is_address, mirror_of, named
from eventsweep.emvs.utils.inputs import TABLE_BYTES, opened_npz, parse_json, read_text
from eventsweep.emvs.utils.runtime import versions
from eventsweep.emvs.window_result import WindowResult

SCHEMA_VERSION = 1
CURE = "run `eventsweep map` again"
Arrays = Mapping[str, NDArray[Any]]
# Arrays of a depth map that are images, and their kinds: float, bool, signed
_IMAGES = {"depth_m": "f", "confidence": "f", "mask": "b", "argmax": "i"}
_DEPTH_KEYS = (*_IMAGES, "rho", "t_us", "T_world_rv")
_JUDGED = "reliability", "error_m"  # of methods that say so


class RecordingInfo(FrozenModel):
    """Which recording was mapped; `manifest_sha256` is None for other people's formats."""

    name: str
    path: str
    manifest_sha256: str | None = None

    @field_validator("path")
    @classmethod
    def _here(cls, path: str) -> str:
        return str(mirror_of(path)) if is_address(path) else path

    @field_serializer("path")
    def _there(self, path: str) -> str:
        return named(path)

    @classmethod
    def of(cls, recording: Recording, path: Path, map_folder: Path) -> RecordingInfo:
        """What a map folder remembers of its recording; a path beside it is kept relative."""
        path, map_folder = path.resolve(), map_folder.resolve()
        together = path.parent == map_folder.parent
        # Imported here: HDF5 is a library that reading a map's index does without.
        from eventsweep.emvs.data.sequence import Sequence as EventSequence

        digest = recording.manifest.digest() if isinstance(recording, EventSequence) else None
        place = f"../{path.name}" if together else str(path)
        return cls(name=recording.name, path=place, manifest_sha256=digest)


class WindowInfo(FrozenModel):
    """One window in `map.json`; times in µs, counts per camera and by what became of events.

    `device` is what swept it: `cpu`, or the name of a GPU; `cpu` where only baselines ran.
    """

    name: str = Field(pattern=r"^\w[\w-]*$")
    t0_us: int
    t1_us: int
    t_ref_us: int
    methods: tuple[str, ...]
    counts: dict[str, dict[str, int]]
    points: dict[str, int] = Field(default_factory=dict)
    device: str = "cpu"


class SkippedWindow(FrozenModel):
    """A sliding window that could not be mapped, and why."""

    name: str
    t0_us: int
    t1_us: int
    reason: str


class HotPixelInfo(FrozenModel):
    """The hot pixels of one camera: (x, y) of each, and how many events they sent."""

    pixels: tuple[tuple[int, int], ...]
    events: int


class MapInfo(FrozenModel):
    """The whole of `map.json`: what was mapped and how, the windows in order, those skipped.

    Attributes:
        versions: of everything that can change a result.
        hot_pixels: per camera, where the filter is on.
        without_pose: with sliding windows, events per camera that no pose covers.
        recording_sha256: with sliding windows, of calibration, poses and events.
        complete: False while a run with sliding windows goes on, or where it was stopped.
    """

    schema_version: int
    recording: RecordingInfo
    config: MapperConfig
    versions: dict[str, str]
    windows: tuple[WindowInfo, ...]
    skipped: tuple[SkippedWindow, ...] = ()
    hot_pixels: dict[str, HotPixelInfo] = Field(default_factory=dict)
    without_pose: dict[str, int] = Field(default_factory=dict)
    recording_sha256: str | None = None
    complete: bool = True


def write_window(
    directory: Path,
    result: WindowResult,
    config: MapperConfig,
    camera_names: Sequence[str],
    *,
    clouds: bool = True,
    name: str | None = None,
) -> WindowInfo:
    """Writes one window's folder and returns its entry of `map.json`, for `write_index`.

    Args:
        directory: such as `MAP/w000`, in a folder that the caller writes atomically.
        result: the mapped window.
        config: radius filter of the clouds.
        camera_names: one per camera, for the counts.
        clouds: whether to write `cloud.ply`.
        name: of the window; by default its folder's.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for depth_map in result.depth_maps.values():
        folder = directory / file_name(depth_map.method)
        folder.mkdir()
        write_depth(folder / "depth.npz", depth_map)
        if config.inpaint:
            np.savez(folder / "dense.npz", **vars(inpaint(depth_map)))
        if clouds:
            cloud = back_project_map(depth_map)
            cloud = without_outliers(cloud, config.radius_m, config.radius_neighbours)
            write_ply(folder / "cloud.ply", cloud)
    slices = result.slices
    rows: dict[str, Any] = {file_name(name): values for name, values in slices.values.items()}
    np.savez(directory / "slices.npz", row_px=slices.row_px, rho=slices.rho, **rows)
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
        points={method: depth_map.points for method, depth_map in result.depth_maps.items()},
        device=result.device,
    )


def write_index(
    directory: Path,
    recording: RecordingInfo,
    config: MapperConfig,
    windows: Sequence[WindowInfo],
    hot_pixels: Mapping[str, HotPixelInfo] = MappingProxyType({}),
    skipped: Sequence[SkippedWindow] = (),
) -> None:
    """Writes `map.json`, last: a folder without it is no map."""
    info = MapInfo(
        schema_version=SCHEMA_VERSION,
        recording=recording,
        config=config,
        versions=versions(),
        windows=tuple(windows),
        skipped=tuple(skipped),
        hot_pixels=dict(hot_pixels),
    )
    (directory / "map.json").write_text(text_of(info), encoding="utf-8")


def text_of(info: BaseModel) -> str:
    """Values as the folder's JSON files have them."""
    return json.dumps(info.model_dump(mode="json"), indent=2, ensure_ascii=False) + "\n"


def read_map(folder: str | Path) -> StoredMap:
    """Opens the folder of a map (`map.json`); arrays are read when they are asked for.

    Returns:
        The map: `windows`, each with its reference time `t_ref_us` and `depth_map(method)`.

    Raises:
        InputError: no map there, or a damaged one, or one of another version.
    """
    check_path("folder", folder)
    return StoredMap(Path(folder), read_info(Path(folder)))


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
        methods = ", ".join(dict.fromkeys(name for w in self.info.windows for name in w.methods))
        state = "" if self.info.complete else ", unfinished"
        return (
            f"StoredMap({str(self.path)!r}, of {self.info.recording.name}: {len(self.windows)} "
            f"window{'s' * (len(self.windows) != 1)}{state}; methods: {methods})"
        )


class StoredWindow:
    """One window of a map folder, and its entry of `map.json`; files are read when asked for."""

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


def read_info(directory: Path) -> MapInfo:
    """Reads `map.json` of a map folder."""
    index = directory / "map.json"
    try:
        text = read_text(index, TABLE_BYTES)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"{directory} is not a map: map.json cannot be read ({why})") from error
    return _parse(index, text)


def _parse(index: Path, text: str) -> MapInfo:
    try:
        version = parse_json(text).get("schema_version")
    except (ValueError, AttributeError) as error:
        raise InputError(f"{index}: not the JSON of a map ({error}): {CURE}") from error
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{index}: schema version {quoted(version)}, needs {SCHEMA_VERSION}: {CURE}"
        )
    try:
        return MapInfo.model_validate_json(text)
    except ValidationError as error:
        raise InputError(f"{index}: {first_fault(error)}: {CURE}") from error


def write_depth(path: Path, depth_map: DepthMap) -> None:
    """Writes a depth map: arrays by name, the camera as JSON text."""
    known = (key for key in (*_DEPTH_KEYS, *_JUDGED) if getattr(depth_map, key) is not None)
    arrays = {key: getattr(depth_map, key) for key in known}
    np.savez(path, camera=json.dumps(depth_map.camera.to_json()), **arrays)


def read_depth(path: Path, method: str) -> DepthMap:
    """Reads what `write_depth` wrote."""
    arrays = dict(read_npz(path, ("camera", *_DEPTH_KEYS), also=_JUDGED))
    camera = _camera(path, str(arrays.pop("camera")))
    shape = (camera.height_px, camera.width_px)
    for key, kind in (_IMAGES | dict.fromkeys(arrays.keys() & {*_JUDGED}, "f")).items():
        check_array(path, key, arrays[key], kind, shape)
    check_array(path, "T_world_rv", arrays["T_world_rv"], "f", (4, 4))
    check_array(path, "rho", arrays["rho"], "f", arrays["rho"].shape[:1])
    check_array(path, "t_us", arrays["t_us"], "i", ())
    t_us = int(arrays.pop("t_us"))
    return DepthMap(method=method, camera=camera, t_us=t_us, **arrays)


def read_dense(path: Path, shape: tuple[int, ...]) -> Dense:
    """Reads `dense.npz` of a method, (H, W): depth_m, measured, filled."""
    kinds = {"depth_m": "f", "measured": "b", "filled": "b"}
    arrays = read_npz(path, tuple(kinds))
    for key, kind in kinds.items():
        check_array(path, key, arrays[key], kind, shape)
    dense = Dense(**arrays)
    both = int(np.count_nonzero(dense.measured & dense.filled))
    if both:
        raise InputError(f"{path}: {both} pixels are both measured and filled: {CURE}")
    return dense


def read_slices(path: Path, methods: Sequence[str], width_px: int) -> Slices:
    """Reads one image row of every fused volume: arrays by the method's file name."""
    arrays = read_npz(path, ("row_px", "rho", *map(file_name, methods)))
    check_array(path, "row_px", arrays["row_px"], "i", ())
    check_array(path, "rho", arrays["rho"], "f", arrays["rho"].shape[:1])
    for name in map(file_name, methods):
        # A method without a volume has a slice of no planes.
        planes = len(arrays["rho"]) if len(arrays[name]) else 0
        check_array(path, name, arrays[name], "f", (planes, width_px))
    values = {method: arrays[file_name(method)] for method in methods}
    return Slices(int(arrays["row_px"]), arrays["rho"], values)


def read_npz(path: Path, keys: Sequence[str], also: Sequence[str] = ()) -> Arrays:
    """Reads the named arrays, and `also` others where there are any."""
    try:
        with opened_npz(path) as file:
            return {key: file[key] for key in (*keys, *(key for key in also if key in file))}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, the map is incomplete: {CURE}") from error
    except KeyError as error:
        raise InputError(f"{path}: holds no array {error}: {CURE}") from error
    except DAMAGED_NPY as error:
        raise InputError(f"{path}: cannot be read ({error}), it is damaged: {CURE}") from error


def check_array(
    path: Path, name: str, array: NDArray[Any], kind: str, shape: tuple[int, ...]
) -> None:
    """Refuses an array of another kind (`f`, `i`, `u`, `b`) or shape."""
    if array.dtype.kind != kind or array.shape != shape:
        raise InputError(
            f"{path}: {name} is {array.dtype} {array.shape}, must be of kind {kind!r} and shape "
            f"{shape}: {CURE}"
        )


def _camera(path: Path, text: str) -> Camera:
    try:
        return Camera.from_json(parse_json(text))
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: camera cannot be read ({error}): {CURE}") from error
