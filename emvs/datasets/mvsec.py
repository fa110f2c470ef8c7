"""MVSEC (Zhu et al., RA-L 2018), read and written: events and ground truth in HDF5."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.hdf5 import Hdf5Writer
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.files import find_one
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording
from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.tables.hdf5_layouts import check_columns, opened_hdf5
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory

DATA = "*_data.hdf5"
_LARGEST_S = 1 << 40
_MOST_POSES = 1_000_000


def open_mvsec(folder: Path) -> PosedRecording:
    """Opens a sequence: `NAME_data.hdf5`, `NAME_gt.hdf5`, `camchain-imucam-*.yaml`."""
    data = find_one(folder, [DATA], "the events")
    truth = find_one(folder, ["*_gt.hdf5"], "poses and depth")
    rig = read_rig(find_one(folder, ["camchain*.yaml", "*/camchain*.yaml"], "the calibration"))
    depth = MvsecDepth(truth, rig.cameras[0])
    return PosedRecording(
        path=folder,
        layout="MVSEC",
        name=data.name.removesuffix("_data.hdf5"),
        rig=rig,
        trajectory=_poses(truth),
        sources=(EventSource(data, "davis/left"), EventSource(data, "davis/right")),
        truth=depth if depth.there else None,
    )


def _poses(path: Path) -> Trajectory:
    """`davis/left/pose`: `T_world_cam` of the left camera, with times in s."""
    names = ("davis/left/pose", "davis/left/pose_ts")
    with opened_hdf5(path) as file:
        missing = [name for name in names if name not in file]
        if missing:
            raise InputError(f"{path}: lacks {', '.join(missing)}; fetch it again")
        check_columns(path, file, names[:1], 3)
        check_columns(path, file, names[1:], 1)
        shape = file[names[0]].shape
        if shape[1:] != (4, 4) or not 1 <= shape[0] <= _MOST_POSES:
            raise InputError(f"{path}: {names[0]} has shape {shape}; needs (N, 4, 4)")
        T_world_cam = np.asarray(file[names[0]][()], np.float64)
        t_us = _times(path, file[names[1]][()], len(T_world_cam))
    turned = T_world_cam[:, :3, :3]
    wrong = np.abs(turned @ turned.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if not np.isfinite(T_world_cam).all() or not (wrong < 1e-3).all():
        bad = int(np.argmax(~(wrong < 1e-3)))
        raise InputError(f"{path}: pose {bad} is not a rigid motion; fetch the file again")
    with located(path):
        return Trajectory.from_matrices(t_us, T_world_cam)


def _times(path: Path, values: object, count: int) -> NDArray[np.int64]:
    t_s = np.asarray(values, np.float64).ravel()
    if len(t_s) != count or not (np.abs(t_s) < _LARGEST_S).all():
        raise InputError(f"{path}: {len(t_s)} times for {count} entries; needs a finite one each")
    return np.round(t_s * 1e6).astype(np.int64)


class MvsecDepth:
    """`depth_image_raw` of the left camera, undistorted with the camera's own lens."""

    _DEPTH = "davis/left/depth_image_raw"

    def __init__(self, path: Path, camera: Camera) -> None:
        self._path, self._camera = path, camera
        names = (self._DEPTH, f"{self._DEPTH}_ts")
        with opened_hdf5(path) as file:
            missing = [name for name in names if name not in file]
            self.there = len(missing) < 2
            if len(missing) == 1:
                raise InputError(f"{path}: lacks {missing[0]}, but has its partner; fetch it again")
            for name in names if self.there else ():
                check_columns(path, file, (name,), 3 if name == self._DEPTH else 1)
            shape = file[self._DEPTH].shape if self.there else (0, 0, 0)
        if self.there and shape[1:] != (camera.height_px, camera.width_px):
            raise InputError(
                f"{path}: {self._DEPTH} has shape {shape}; needs (N, {camera.height_px}, "
                f"{camera.width_px}), as the calibration says"
            )
        self._count = int(shape[0])

    @cached_property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) times, µs."""
        with opened_hdf5(self._path) as file:
            return _times(self._path, file[f"{self._DEPTH}_ts"][()], self._count)

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the undistorted view at one of the times, m."""
        with opened_hdf5(self._path) as file:
            raw = np.asarray(file[self._DEPTH][int(np.argmax(self.t_us == t_us))], np.float32)
        from eventsweep.emvs.geometry.warp import undistort_depth

        return undistort_depth(np.where(raw > 0, raw, np.nan).astype(np.float32), self._camera)


def write_truth(path: Path, recording: Recording, poses: Trajectory, shift_us: int) -> None:
    """Writes poses `T_world_cam` on the file's clock, and raw depth of a sequence of ours.

    Other recordings hold no depth on the distorted sensor. `shift_us` leads to the file's clock.
    """
    with Hdf5Writer(path) as hdf5:
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
