"""Opens DSEC (Gehrig et al., RA-L 2021): events, calibration, disparity; poses from a file."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.data.camera import Camera
from emvs.errors import InputError
from emvs.io.calibration_values import entry_of, numbers_of, parsed
from emvs.io.descriptor import CalibrationTable, Descriptor, EventsTable, PosesTable, assembled
from emvs.io.layout_files import find_one, find_optional
from emvs.io.posed import PosedRecording

LEFT = "events/left/events.h5"
_CAMERAS = ("calibration/cam_to_cam.yaml", "cam_to_cam.yaml")
_POSES = ("poses.tum.txt", "poses.txt", "pose.txt", "*/poses.tum.txt")
_STAMPS = ("disparity/timestamps.txt", "disparity_timestamps.txt")
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
    stamps = find_optional(folder, _STAMPS, "the times of disparity")
    if stamps is None:
        return recording
    from dataclasses import replace

    truth = DsecDisparity(folder, stamps, calibration, recording.rig.cameras[0])
    return replace(recording, truth=truth)


class DsecDisparity:
    """`disparity/event/*.png`, turned from the rectified into the camera's own undistorted view."""

    def __init__(self, folder: Path, stamps: Path, calibration: Path, camera: Camera) -> None:
        self._stamps, self._calibration, self._camera = stamps, calibration, camera
        images = stamps.parent / "event"
        self._images = sorted((images if images.is_dir() else folder).glob("*.png"))

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
        from emvs.io.warp import turn_depth

        path = self._images[int(np.argmax(self.t_us == t_us))]
        rectified, R_rect_cam, focal_baseline = self._rectification
        depth_m = read_disparity(path, focal_baseline)
        if depth_m.shape != (rectified.height_px, rectified.width_px):
            raise InputError(f"{path}: shape {depth_m.shape}; needs that of camRect0, fetch again")
        return turn_depth(depth_m, rectified, self._camera.undistorted(), R_rect_cam.T)

    @cached_property
    def _rectification(self) -> tuple[Camera, NDArray[np.float64], float]:
        """The rectified camera, its rotation from the camera, and focal length x baseline, px m."""
        values = parsed(self._calibration)
        try:
            entry = entry_of(entry_of(values, "intrinsics", "file", dict), "camRect0", "file", dict)
            four = numbers_of(entry.get("camera_matrix"), 4, "camRect0.camera_matrix")
            width, height = numbers_of(entry.get("resolution"), 2, "camRect0.resolution")
            turned = _rows(values.get("extrinsics", {}).get("R_rect0"), (3, 3), "R_rect0")
            to_depth = values.get("disparity_to_depth", {}).get("cams_03")
            Q = _rows(to_depth, (4, 4), "disparity_to_depth.cams_03")
            if Q[3, 2] == 0:
                raise InputError("disparity_to_depth.cams_03 has no baseline: correct it")
            fx, fy, cx, cy = four
            camera = Camera(int(width), int(height), fx, fy, cx, cy)
        except InputError as error:
            raise InputError(f"{self._calibration}: {error}") from error
        return camera, turned, float(Q[2, 3] / abs(Q[3, 2]))


def read_disparity(path: Path, focal_baseline_px_m: float) -> NDArray[np.float32]:
    """Reads DSEC's disparity image as z-depth, m, NaN where it is 0.

    Raises:
        InputError: no readable 16-bit image.
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
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
