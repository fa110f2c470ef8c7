"""MVSEC (Zhu et al., RA-L 2018), read and written, and M3ED (Chaney et al., CVPRW 2023), read.

Both put events, poses as 4x4 matrices and depth at the sensor's own pixels into HDF5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.hdf5 import (
    Hdf5Writer,
    check_columns,
    check_dataset,
    open_hdf5,
    read_whole,
)
from eventsweep.emvs.data.image_stores import FrameCamera, Photo
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording, find_one, find_optional
from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.formats.calibration import kalibr_camera_of, read_rig
from eventsweep.emvs.formats.calibration_values import near_rigid
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

MVSEC_DATA = "*_data.hdf5"
M3ED_DATA = "*_data.h5"
_MVSEC_TRUTH, _M3ED_TRUTH = "*_gt.hdf5", "*_pose_gt.h5"
_SIDES = ("prophesee/left", "prophesee/right")
_OVC, _OVC_TIMES = ("left", "right", "rgb"), "ovc/ts"
_LARGEST_US = 2.0**60
_MOST_POSES = 1_000_000
_MOST_VALUES = 64  # of a calibration


class _Stack(NamedTuple):
    """Data sets with one entry per time, those with the times, and what a time counts, µs."""

    data: str
    times: str
    per_us: float


_MVSEC_POSES = _Stack("davis/left/pose", "davis/left/pose_ts", 1e6)
_MVSEC_DEPTH = _Stack("davis/left/depth_image_raw", "davis/left/depth_image_raw_ts", 1e6)
_M3ED_POSES = _Stack("Cn_T_C0", "ts", 1.0)
_M3ED_DEPTH = _Stack(f"depth/{_SIDES[0]}", "ts", 1.0)


def open_mvsec(folder: Path) -> PosedRecording:
    """Opens a sequence: `NAME_data.hdf5`, `camchain-imucam-*.yaml`, optionally `NAME_gt.hdf5`."""
    data = find_one(folder, [MVSEC_DATA], "the events")
    truth = find_optional(folder, [_MVSEC_TRUTH], "poses and depth")
    rig = read_rig(find_one(folder, ["camchain*.yaml", "*/camchain*.yaml"], "the calibration"))
    depth = None if truth is None else DepthStack(truth, _MVSEC_DEPTH, rig.cameras[0])
    poses: Trajectory | str = f"no {_MVSEC_POSES.data} in {_MVSEC_TRUTH}"
    if truth is not None and _has_any(truth, _MVSEC_POSES):
        poses = _trajectory(truth, *_matrices(truth, _MVSEC_POSES))
    return PosedRecording(
        path=folder,
        layout="MVSEC",
        name=data.name.removesuffix("_data.hdf5"),
        rig=rig,
        poses=poses,
        sources=(EventSource(data, "davis/left"), EventSource(data, "davis/right")),
        truth=depth if depth is not None and depth.there else None,
    )


def open_m3ed(folder: Path) -> PosedRecording:
    """Opens a sequence: `NAME_data.h5`, optionally `NAME_pose_gt.h5` and `NAME_depth_gt.h5`."""
    data = find_one(folder, [M3ED_DATA], "the events")
    pose_file = find_optional(folder, [_M3ED_TRUTH], "the poses")
    depth_file = find_optional(folder, ["*_depth_gt.h5"], "the depth")
    rig = _m3ed_rig(data)
    poses: Trajectory | str = f"no {_M3ED_TRUTH}"
    if pose_file is not None:
        t_us, T_cam_world = _matrices(
            pose_file, _M3ED_POSES
        )  # the world is the first camera's frame
        poses = _trajectory(pose_file, t_us, se3.inverse(T_cam_world))
    depth = None if depth_file is None else DepthStack(depth_file, _M3ED_DEPTH, rig.cameras[0])
    if depth is not None and not depth.there:
        raise InputError(f"{depth_file}: lacks {_M3ED_DEPTH.data}; download it again")
    return PosedRecording(
        path=folder,
        layout="M3ED",
        name=data.name.removesuffix("_data.h5"),
        rig=rig,
        poses=poses,
        sources=tuple(EventSource(data, side) for side in _SIDES),
        truth=depth,
        beside=partial(_m3ed_frames, data),
    )


def _m3ed_rig(path: Path) -> Rig:
    """The event cameras, the left one as the body."""
    with open_hdf5(path) as file, located(path):
        cameras, T_left_cam = zip(*(_m3ed_camera(file, side) for side in _SIDES), strict=True)
    T_first = se3.inverse(T_left_cam[0])
    return Rig(path.stem, cameras, tuple(T_first @ T for T in T_left_cam))


def _m3ed_camera(file: h5py.File, name: str) -> tuple[Camera, NDArray[np.float64]]:
    """The camera of a group `calib`, which holds Kalibr's keys, and its place, `T_left_cam`."""
    entry, key = _plain(file, f"{name}/calib"), f"{name}/calib/T_to_prophesee_left"
    return kalibr_camera_of(entry, name), near_rigid(entry.get("T_to_prophesee_left"), key)


def _m3ed_frames(path: Path) -> tuple[FrameCamera, ...]:
    """The imagers beside the event cameras; a stamp each, whose exposure is not known.

    Raises:
        InputError: images without times or calibration, or of another kind.
    """
    found = []
    with open_hdf5(path) as file, located(path):
        T_first = se3.inverse(_m3ed_camera(file, _SIDES[0])[1])
        for name in _OVC:
            data = f"ovc/{name}/data"
            if data not in file:
                continue
            if _OVC_TIMES not in file:
                raise InputError(f"has {data}, but not {_OVC_TIMES}; download it again")
            count = _check_images(file[data], check_dataset(path, file[data]))
            t_us = _times(path, read_whole(path, file[_OVC_TIMES]), count, 1.0)
            if (np.diff(t_us) <= 0).any():
                raise InputError(f"{_OVC_TIMES}: times of images do not rise; download it again")
            camera, T_left_cam = _m3ed_camera(file, f"ovc/{name}")
            pictures = StackedImages(path, data, t_us)
            found.append(FrameCamera(f"frame_{name}", camera, T_first @ T_left_cam, pictures))
    return tuple(found)


def _check_images(data: h5py.Dataset, count: int) -> int:
    """Checks that this is a stack of grey or colour images; returns how many."""
    if data.dtype != np.uint8 or data.ndim not in (3, 4) or data.shape[3:] not in ((), (1,), (3,)):
        raise InputError(
            f"{data.name} has shape {data.shape} of {data.dtype}; needs (N, H, W), or with 1 or 3 "
            "channels, of uint8"
        )
    return count


@dataclass(frozen=True, eq=False)
class StackedImages:
    """Pictures in a data set of HDF5, read one at a time: (N, H, W), (N, H, W, 1) or blue first."""

    path: Path
    data: str
    t_us: NDArray[np.int64]

    def photo(self, index: int) -> Photo:
        """The picture at an index, grey; its exposure has no length."""
        with open_hdf5(self.path) as file:
            image = np.asarray(file[self.data][index])
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.shape[2:] == (3,) else image
        t_us = int(self.t_us[index])
        return Photo(t_us, t_us, 1.0, np.asarray(grey.reshape(image.shape[:2]), np.uint8))


def _plain(file: h5py.File, name: str) -> dict[str, Any]:
    """The small data sets of a group, as a file of a calibration would hold them."""
    if not isinstance(file.get(name), h5py.Group):
        raise InputError(f"lacks {name}; download it again")
    values: dict[str, Any] = {}
    for key, node in file[name].items():
        if not _is_small(node):
            raise InputError(f"{name}/{key} is not a valid calibration value; download it again")
        value = node[()]
        value = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
        values[key] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return values


def _is_small(node: object) -> bool:
    """Whether a node is a short list of numbers or a text; a damaged other kind may crash HDF5."""
    if not isinstance(node, h5py.Dataset) or node.size is None or node.size > _MOST_VALUES:
        return False
    return not node.dtype.hasobject or h5py.check_string_dtype(node.dtype) is not None


def _has_any(path: Path, stack: _Stack) -> bool:
    with open_hdf5(path) as file:
        return any(name in file for name in (stack.data, stack.times))


def _matrices(path: Path, stack: _Stack) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times, µs, and motions (N, 4, 4)."""
    names = (stack.data, stack.times)
    with open_hdf5(path) as file:
        missing = [name for name in names if name not in file]
        if missing:
            raise InputError(f"{path}: lacks {', '.join(missing)}; download it again")
        check_columns(path, file, {stack.data: 3})
        check_columns(path, file, {stack.times: 1})
        shape = file[stack.data].shape
        if shape[1:] != (4, 4) or not 1 <= shape[0] <= _MOST_POSES:
            raise InputError(f"{path}: {stack.data} has shape {shape}; needs (N, 4, 4)")
        T = np.asarray(file[stack.data][()], np.float64)
        t_us = _times(path, read_whole(path, file[stack.times]), len(T), stack.per_us)
    turned = T[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # damage may be of any size
        wrong = np.abs(turned @ turned.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if not np.isfinite(T).all() or not (wrong < se3.ROUNDED).all():
        bad = int(np.argmax(~(wrong < se3.ROUNDED)))
        why = se3.fault(T[bad], se3.ROUNDED) or f"R R^T differs from 1 by {wrong[bad]:.2g}"
        raise InputError(
            f"{path}: pose {bad} is not a rigid motion ({why}); download the file again"
        )
    return t_us, T


def _trajectory(
    path: Path, t_us: NDArray[np.int64], T_world_cam: NDArray[np.float64]
) -> Trajectory:
    with located(path):
        return Trajectory.from_matrices(t_us, T_world_cam)


def _times(path: Path, values: object, count: int, per_us: float) -> NDArray[np.int64]:
    t_us = np.asarray(values, np.float64).ravel() * per_us
    if len(t_us) != count or not (np.abs(t_us) < _LARGEST_US).all():
        raise InputError(
            f"{path}: {len(t_us)} times for {count} entries; needs a finite time for each"
        )
    return np.round(t_us).astype(np.int64)


class DepthStack:
    """Depth images at the sensor's pixels, undistorted with the camera's own lens."""

    def __init__(self, path: Path, stack: _Stack, camera: Camera) -> None:
        self._path, self._stack, self._camera = path, stack, camera
        names = (stack.data, stack.times)
        with open_hdf5(path) as file:
            missing = [name for name in names if name not in file]
            self.there = len(missing) < 2
            if len(missing) == 1:
                raise InputError(
                    f"{path}: has only one of two data sets, {missing[0]} is missing; download "
                    "it again"
                )
            if self.there:
                check_columns(path, file, {stack.data: 3})
                check_columns(path, file, {stack.times: 1})
            shape = file[stack.data].shape if self.there else (0, 0, 0)
        if self.there and shape[1:] != (camera.height_px, camera.width_px):
            raise InputError(
                f"{path}: {stack.data} has shape {shape}; needs (N, {camera.height_px}, "
                f"{camera.width_px}), as the calibration says"
            )
        self._count = int(shape[0])

    @cached_property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) times, µs."""
        with open_hdf5(self._path) as file:
            times = read_whole(self._path, file[self._stack.times])
        return _times(self._path, times, self._count, self._stack.per_us)

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the undistorted view at one of the times, m."""
        from eventsweep.emvs.geometry.warp import undistort_depth

        with open_hdf5(self._path) as file:
            raw = np.asarray(file[self._stack.data][int(np.argmax(self.t_us == t_us))], np.float32)
        known = np.isfinite(raw) & (raw > 0)
        return undistort_depth(np.where(known, raw, np.nan).astype(np.float32), self._camera)


def write_truth(path: Path, recording: Recording, poses: Trajectory | None, shift_us: int) -> None:
    """Writes poses `T_world_cam` on the file's clock, if any, and raw depth of a sequence of ours.

    Other recordings hold no depth on the distorted sensor. `shift_us` leads to the file's clock.
    """
    with Hdf5Writer(path) as hdf5:
        if poses is not None:
            hdf5.create("davis/left/pose", data=poses.at(poses.t_us))
            hdf5.create("davis/left/pose_ts", data=poses.t_us / 1e6)
        hdf5.check()
        if isinstance(recording, Sequence) and len(recording.truth_times_us(0)):
            _write_depth(hdf5, recording, shift_us)


def _write_depth(hdf5: Hdf5Writer, sequence: Sequence, shift_us: int) -> None:
    camera, times_us = sequence.rig.cameras[0], sequence.truth_times_us(0)
    shape = (len(times_us), camera.height_px, camera.width_px)
    name, chunks = "davis/left/depth_image_raw", (1, *shape[1:])
    hdf5.create(name, shape, np.float32, chunks=chunks)
    with hdf5.opened(name) as data:
        for k, t_us in enumerate(times_us):
            data[k] = sequence.truth_depth_m(0, int(t_us))
            hdf5.check()
    hdf5.create(f"{name}_ts", data=(times_us + shift_us) / 1e6)
