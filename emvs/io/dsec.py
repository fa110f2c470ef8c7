"""Opens DSEC (Gehrig et al., RA-L 2021): events, calibration, disparity; poses from a file."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from emvs.data.hdf5 import check_dataset
from emvs.errors import InputError
from emvs.formats.calibration import camera_of, entry_of, numbers_of, parsed
from emvs.formats.depth import read_png
from emvs.formats.hdf5 import opened_hdf5
from emvs.geometry.camera import Camera
from emvs.io.descriptor import CalibrationTable, Descriptor, EventsTable, PosesTable, assembled
from emvs.io.layout_files import find_one, find_optional
from emvs.io.posed import PosedRecording

LEFT = "events/left/events.h5"
_CAMERAS = ("calibration/cam_to_cam.yaml", "cam_to_cam.yaml")
_POSES = ("poses.tum.txt", "poses.txt", "pose.txt", "*/poses.tum.txt")
_STAMPS = ("disparity/timestamps.txt", "*disparity_timestamps.txt")
_IMAGES = ("disparity/event", "*disparity_event")
_RECTIFY = "events/left/rectify_map.h5"
_RECTIFY_OFF_PX = 1.0
DISPARITY_SCALE = 256
"""A disparity image holds this many units per pixel; 0 means unknown."""


def is_dsec(folder: Path) -> bool:
    """Whether a folder looks like a sequence of DSEC."""
    return (folder / LEFT).exists()


def open_dsec(folder: Path) -> PosedRecording:
    """Opens a sequence; the set has no poses, so a file of `T_world_cam0` must be beside it.

    Raises:
        InputError: a file that is missing, ambiguous or damaged.
    """
    calibration = find_one(folder, _CAMERAS, "the calibration")
    poses = find_one(folder, _POSES, "poses (T_world_cam of the left event camera, TUM format)")
    right = find_one(folder, ["events/right/events.h5"], "the right events")
    what = Descriptor(
        calibration=CalibrationTable(file=calibration.relative_to(folder).as_posix()),
        poses=PosesTable(file=poses.relative_to(folder).as_posix()),
        events=(
            EventsTable(file=LEFT),
            EventsTable(file=right.relative_to(folder).as_posix()),
        ),
    )
    recording = assembled(folder, what, "DSEC")
    camera = recording.rig.cameras[0]
    if (folder / _RECTIFY).exists():
        check_rectify_map(folder / _RECTIFY, calibration, camera)
    stamps = find_optional(folder, _STAMPS, "the times of disparity")
    images = next((path for name in _IMAGES for path in folder.glob(name) if path.is_dir()), None)
    if stamps is None and images is None:
        return recording
    if stamps is None or images is None:
        lacks, there = (_STAMPS[0], images) if stamps is None else (f"{_IMAGES[0]}/", stamps)
        raise InputError(f"{folder}: lacks {lacks}, but has {there}; fetch it, or take both away")
    from dataclasses import replace

    return replace(recording, truth=DsecDisparity(images, stamps, calibration, camera))


def check_rectify_map(path: Path, calibration: Path, camera: Camera) -> None:
    """Compares `rectify_map` with what the calibration makes of every 16th row and column.

    The mapper rectifies by the calibration, ray by ray; the map says the same per pixel, so a
    difference means that the two files belong to different cameras.

    Raises:
        InputError: an unreadable file, another shape, or a difference of more than a pixel.
    """
    with opened_hdf5(path) as file:
        data = file.get("rectify_map")
        shape = (camera.height_px, camera.width_px, 2)
        if not isinstance(data, h5py.Dataset) or data.shape != shape:
            raise InputError(
                f"{path}: needs a data set rectify_map of shape {shape}; fetch it again"
            )
        check_dataset(path, data)
        stored = np.asarray(data[()], np.float64)[::16, ::16]
    rectified, R_rect_cam, _ = rectification_of(calibration)
    rays = camera.bearing_table()[::16, ::16]
    points = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ R_rect_cam.T
    off_px = np.abs(rectified.project(points) - stored).max(axis=-1)
    wrong = np.isfinite(rays).all(axis=-1) & ~(off_px <= _RECTIFY_OFF_PX)
    if wrong.any():
        row, column = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        raise InputError(
            f"{path}: row {16 * row}, column {16 * column} lies {off_px[row, column]:.3g} px off "
            f"what {calibration.name} says; fetch both files of the same sequence"
        )


class DsecDisparity:
    """`disparity/event/*.png`, turned from the rectified into the camera's own undistorted view."""

    def __init__(self, images: Path, stamps: Path, calibration: Path, camera: Camera) -> None:
        self._stamps, self._calibration, self._camera = stamps, calibration, camera
        self._images = sorted(images.glob("*.png"))

    @cached_property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) times, µs."""
        try:
            text = self._stamps.read_text(encoding="ascii")
            t_us = np.array([int(word) for word in text.split()], np.int64)
        except (OSError, ValueError, OverflowError) as error:
            raise InputError(f"{self._stamps}: needs one whole time in µs per line") from error
        if len(t_us) != len(self._images):
            raise InputError(
                f"{self._stamps}: {len(t_us)} times for {len(self._images)} disparity images; "
                "fetch them again"
            )
        return t_us

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the undistorted view at one of the times, m, NaN where unknown."""
        from emvs.geometry.warp import turn_depth

        path = self._images[int(np.argmax(self.t_us == t_us))]
        rectified, R_rect_cam, focal_baseline = self._rectification
        depth_m = read_disparity(path, focal_baseline)
        if depth_m.shape != (rectified.height_px, rectified.width_px):
            raise InputError(f"{path}: shape {depth_m.shape}; needs that of camRect0, fetch again")
        return turn_depth(depth_m, rectified, self._camera.undistorted(), R_rect_cam.T)

    @cached_property
    def _rectification(self) -> tuple[Camera, NDArray[np.float64], float]:
        return rectification_of(self._calibration)


def rectification_of(calibration: Path) -> tuple[Camera, NDArray[np.float64], float]:
    """The rectified left camera, its rotation from the camera, and focal length x baseline, px m.

    Raises:
        InputError: a missing or impossible value of `cam_to_cam.yaml`; names the key.
    """
    values = parsed(calibration)
    try:
        entry = entry_of(entry_of(values, "intrinsics", "file", dict), "camRect0", "file", dict)
        four = numbers_of(entry.get("camera_matrix"), 4, "camRect0.camera_matrix")
        extrinsics = entry_of(values, "extrinsics", "file", dict)
        turned = _rows(extrinsics.get("R_rect0"), (3, 3), "R_rect0")
        if np.abs(turned @ turned.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turned) < 0:
            raise InputError("extrinsics.R_rect0 is no rotation: correct it")
        to_depth = entry_of(values, "disparity_to_depth", "file", dict).get("cams_03")
        Q = _rows(to_depth, (4, 4), "disparity_to_depth.cams_03")
        if Q[3, 2] == 0 or Q[2, 3] <= 0:
            raise InputError("disparity_to_depth.cams_03 has no baseline: correct it")
        if abs(Q[3, 3]) > 1e-6 * abs(Q[3, 2]):
            raise InputError("disparity_to_depth.cams_03 shifts disparities (row 3, column 3): "
                             "needs principal points that agree")  # fmt: skip
        size = entry.get("resolution")
        camera = camera_of(size, four, "pinhole", [], "camRect0.resolution", "camRect0")
    except InputError as error:
        raise InputError(f"{calibration}: {error}") from error
    return camera, turned, float(Q[2, 3] / abs(Q[3, 2]))


def read_disparity(path: Path, focal_baseline_px_m: float) -> NDArray[np.float32]:
    """Reads DSEC's disparity image as z-depth, m, NaN where it is 0.

    Raises:
        InputError: no readable 16-bit image.
    """
    image = read_png(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{path}: no 16-bit grey image; fetch it again")
    disparity_px = image.astype(np.float64) / DISPARITY_SCALE
    with np.errstate(divide="ignore"):
        depth_m = focal_baseline_px_m / disparity_px
    return np.where(image > 0, depth_m, np.nan).astype(np.float32)


def _rows(values: Any, shape: tuple[int, int], key: str) -> NDArray[np.float64]:
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{key} holds something that is no number: correct it") from error
    if found.shape != shape or not np.isfinite(found).all():
        raise InputError(f"{key} has shape {found.shape}: needs {shape} finite numbers")
    return found
