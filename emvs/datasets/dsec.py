"""DSEC (Gehrig et al., RA-L 2021), read and written: events, calibration, disparity."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import yaml
from numpy.typing import NDArray

from eventsweep.emvs.data.hdf5 import Hdf5Writer, check_dataset, open_hdf5
from eventsweep.emvs.data.image_stores import FrameCamera
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets.custom import described
from eventsweep.emvs.datasets.posed import PosedRecording, find_folder, find_one, find_optional
from eventsweep.emvs.errors import InputError, located
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.calibration_values import (
    camera_of,
    entry_of,
    numbers_in,
    numbers_of,
    parsed,
)
from eventsweep.emvs.formats.calibration_writers import kalibr_camera
from eventsweep.emvs.formats.depth import read_png, write_image
from eventsweep.emvs.formats.frame_files import image_files, read_times_us
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.inputs import TABLE_BYTES, read_text

LEFT = "events/left/events.h5"
_CAMERAS = ("calibration/cam_to_cam.yaml", "cam_to_cam.yaml")
_POSES = ("poses.tum.txt", "poses.txt", "pose.txt", "*/poses.tum.txt")
_STAMPS = ("disparity/timestamps.txt", "*disparity_timestamps.txt")
_IMAGES = ("disparity/event", "*disparity_event")
_RECTIFY = "events/left/rectify_map.h5"
_RECTIFY_OFF_PX = 1.0
_FRAMES = {
    "distorted": ("images/{}/distorted", "*images_distorted_{}"),
    "rectified": ("images/{}/rectified", "*images_rectified_{}"),
}
_FRAME_TIMES = ("images/timestamps.txt", "*images_timestamps.txt")
_EXPOSURES = ("images/{}/exposure_timestamps.txt", "*images_exposure_timestamps_{}.txt")
DISPARITY_SCALE = 256
"""A disparity image holds this many units per pixel; 0 means unknown."""
Array = NDArray[np.float64]


def open_dsec(folder: Path) -> PosedRecording:
    """Opens a sequence; the set has no poses, but a file of `T_world_cam0` may be beside it."""
    calibration = find_one(folder, _CAMERAS, "the calibration")
    poses = find_optional(folder, _POSES, "the poses")
    right = find_one(folder, ["events/right/events.h5"], "the right events")
    names = [path.relative_to(folder).as_posix() for path in (calibration, right)]
    recording = described(
        folder,
        "DSEC",
        calibration={"file": names[0]},
        lacks=f"no {_POSES[1]} with T_world_cam of the left event camera",
        poses=None if poses is None else {"file": poses.relative_to(folder).as_posix()},
        events=[{"file": LEFT}, {"file": names[1]}],
    )
    recording = replace(recording, beside=partial(_frame_cameras, folder, calibration))
    camera = recording.rig.cameras[0]
    if (folder / _RECTIFY).exists():
        check_rectify_map(folder / _RECTIFY, calibration, camera)
    stamps = find_optional(folder, _STAMPS, "the times of disparity")
    images = next((path for name in _IMAGES for path in folder.glob(name) if path.is_dir()), None)
    if stamps is None and images is None:
        return recording
    if stamps is None or images is None:
        lacks, there = (_STAMPS[0], images) if stamps is None else (f"{_IMAGES[0]}/", stamps)
        raise InputError(f"{folder}: has {there}, but not {lacks}; download it, or remove both")
    return replace(recording, truth=DsecDisparity(images, stamps, calibration, camera))


def _frame_cameras(folder: Path, calibration: Path) -> tuple[FrameCamera, ...]:
    """The frame cameras whose images are there, on the body of the left event camera.

    Raises:
        InputError: images without times, or of another number.
    """
    found = []
    for k, side in enumerate(("left", "right"), 1):
        places = ((kind, find_folder(folder, names, side)) for kind, names in _FRAMES.items())
        kind, images = next((pair for pair in places if pair[1] is not None), ("", None))
        if images is None:
            continue
        rig = read_rig(calibration, ("cam0", f"cam{k}"))
        camera, T_body_cam = rig.cameras[1], rig.T_body_cam[1].copy()
        if kind == "rectified":
            camera, R_rect_cam = _rectified_camera(calibration, k)
            T_body_cam[:3, :3] = T_body_cam[:3, :3] @ R_rect_cam.T
        pictures = image_files(images, "*.png", *_exposures(folder, side))
        found.append(FrameCamera(f"frame_{side}", camera, T_body_cam, pictures))
    return tuple(found)


def _exposures(folder: Path, side: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Begin and end of the exposures, µs; both the stamp where they are not known."""
    exposures = find_optional(folder, [name.format(side) for name in _EXPOSURES], "the exposures")
    if exposures is not None:
        table = read_times_us(exposures, 2)
        return table[:, 0], table[:, 1]
    t_us = read_times_us(find_one(folder, _FRAME_TIMES, "the times of images"), 1)[:, 0]
    return t_us, t_us


def check_rectify_map(path: Path, calibration: Path, camera: Camera) -> None:
    """Compares `rectify_map` with what the calibration makes of every 16th row and column.

    The mapper rectifies ray by ray, by the calibration; a difference of more than a pixel means
    that the two files belong to different cameras.
    """
    with open_hdf5(path) as file:
        data = file.get("rectify_map")
        shape = (camera.height_px, camera.width_px, 2)
        if not isinstance(data, h5py.Dataset) or data.shape != shape:
            raise InputError(
                f"{path}: needs a data set rectify_map of shape {shape}; download it again"
            )
        check_dataset(path, data)
        with np.errstate(invalid="ignore"):  # a damaged number may be one that signals
            stored = np.asarray(data[()], np.float64)[::16, ::16]
    rectified, R_rect_cam, _ = rectification_of(calibration)
    rays = camera.ray_table()[::16, ::16]
    off_px = np.abs(rectified.project(rays @ R_rect_cam.T) - stored).max(axis=-1)
    wrong = np.isfinite(rays).all(axis=-1) & ~(off_px <= _RECTIFY_OFF_PX)
    if wrong.any():
        row, column = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        raise InputError(
            f"{path}: row {16 * row}, column {16 * column} lies {off_px[row, column]:.3g} px "
            f"from where {calibration.name} puts it; download both files of the same sequence"
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
            text = read_text(self._stamps, TABLE_BYTES, "ascii")
            t_us = np.array([int(word) for word in text.split()], np.int64)
        except (OSError, ValueError, OverflowError) as error:
            raise InputError(f"{self._stamps}: needs one integer time in µs per line") from error
        if len(t_us) != len(self._images):
            raise InputError(
                f"{self._stamps}: {len(t_us)} times for {len(self._images)} disparity images; "
                "download them again"
            )
        return t_us

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the undistorted view at one of the times, m, NaN where unknown."""
        from eventsweep.emvs.geometry.warp import turn_depth

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
    """The rectified left camera, its rotation from the camera, focal length x baseline in px m."""
    values = parsed(calibration)
    with located(calibration):
        camera, turned = _rectified(values, 0)
        to_depth = entry_of(values, "disparity_to_depth", "file", dict).get("cams_03")
        Q = _rows(to_depth, (4, 4), "disparity_to_depth.cams_03")
        if Q[3, 2] == 0 or Q[2, 3] <= 0:
            raise InputError("disparity_to_depth.cams_03 has no baseline: correct it")
        if abs(Q[3, 3]) > 1e-6 * abs(Q[3, 2]):
            raise InputError(
                "disparity_to_depth.cams_03 shifts disparities (row 3, column 3): needs equal "
                "principal points"
            )
    return camera, turned, float(Q[2, 3] / abs(Q[3, 2]))


def _rectified_camera(calibration: Path, k: int) -> tuple[Camera, NDArray[np.float64]]:
    """The rectified camera k, and its (3, 3) rotation from the camera."""
    values = parsed(calibration)
    with located(calibration):
        return _rectified(values, k)


def _rectified(values: dict[str, Any], k: int) -> tuple[Camera, NDArray[np.float64]]:
    name, turn = f"camRect{k}", f"R_rect{k}"
    entry = entry_of(entry_of(values, "intrinsics", "file", dict), name, "file", dict)
    four = numbers_of(entry.get("camera_matrix"), 4, f"{name}.camera_matrix")
    turned = _rows(entry_of(values, "extrinsics", "file", dict).get(turn), (3, 3), turn)
    if np.abs(turned @ turned.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turned) < 0:
        raise InputError(f"extrinsics.{turn} is not a rotation: correct it")
    size = entry.get("resolution")
    return camera_of(size, four, "pinhole", [], f"{name}.resolution", name), turned


def read_disparity(path: Path, focal_baseline_px_m: float) -> NDArray[np.float32]:
    """Reads DSEC's disparity image as z-depth, m, NaN where it is 0."""
    image = read_png(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{path}: not a 16-bit grey image; download it again")
    disparity_px = image.astype(np.float64) / DISPARITY_SCALE
    with np.errstate(divide="ignore"):
        depth_m = focal_baseline_px_m / disparity_px
    return np.where(image > 0, depth_m, np.nan).astype(np.float32)


def _rows(values: Any, shape: tuple[int, int], key: str) -> NDArray[np.float64]:
    array = numbers_in(values, key, f"{shape} numbers")
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{key} has shape {array.shape}: needs {shape} finite numbers")
    return array


def rectification(rig: Rig) -> tuple[Camera, Array, Array, float]:
    """Rectifies the first two cameras: common pinhole, R_rect0, R_rect3, baseline in m."""
    left, right = (camera.undistorted() for camera in rig.cameras[:2])
    T_right_left = se3.inverse(rig.T_body_cam[1]) @ rig.T_body_cam[0]
    R, t = T_right_left[:3, :3], T_right_left[:3, 3]
    baseline_m = float(np.linalg.norm(t))
    if np.allclose(R, np.eye(3)) and np.allclose(left.K, right.K) and abs(t[1:]).max() < 1e-9:
        return left, np.eye(3), np.eye(3), baseline_m
    size = (left.width_px, left.height_px)
    zero = np.zeros(4)
    R_left, R_right, P, *_ = cv2.stereoRectify(
        left.K, zero, right.K, zero, size, R, t[:, None], alpha=-1
    )
    fx, fy, cx, cy = (float(v) for v in (P[0, 0], P[1, 1], P[0, 2], P[1, 2]))
    common = Camera(*size, fx, fy, cx, cy)
    return common, np.asarray(R_left), np.asarray(R_right), baseline_m


def write_calibration(folder: Path, rig: Rig) -> None:
    """Writes `cam_to_cam.yaml` and both `rectify_map.h5`; DSEC's frame cameras repeat ours."""
    common, R_left, R_right, baseline_m = rectification(rig)
    T_right_left = se3.inverse(rig.T_body_cam[1]) @ rig.T_body_cam[0]
    intrinsics: dict[str, Any] = {}
    for k, (eye, kind) in enumerate(((0, "event"), (0, "frame"), (1, "frame"), (1, "event"))):
        entry = kalibr_camera(rig.cameras[eye], f"cam{k}")
        intrinsics[f"cam{k}"] = {"camera_type": kind, **entry}
        intrinsics[f"cam{k}"]["camera_matrix"] = intrinsics[f"cam{k}"].pop("intrinsics")
        rectified = kalibr_camera(common, f"camRect{k}")
        rectified["camera_matrix"] = rectified.pop("intrinsics")
        intrinsics[f"camRect{k}"] = {"camera_type": kind, **rectified}
    f = float(common.fx_px)
    Q = [[1.0, 0.0, 0.0, -common.cx_px], [0.0, 1.0, 0.0, -common.cy_px],
         [0.0, 0.0, 0.0, f], [0.0, 0.0, 1.0 / baseline_m, 0.0]]  # fmt: skip
    links = {"T_10": np.eye(4), "T_21": T_right_left, "T_32": np.eye(4),
             "R_rect0": R_left, "R_rect3": R_right}  # fmt: skip
    values = {
        "intrinsics": intrinsics,
        "extrinsics": {name: T.tolist() for name, T in links.items()},
        "disparity_to_depth": {"cams_03": [[float(v) for v in row] for row in Q]},
    }
    path = folder / "calibration" / "cam_to_cam.yaml"
    path.parent.mkdir()
    path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    for side, camera, turned in zip(
        ("left", "right"), rig.cameras, (R_left, R_right), strict=False
    ):
        points = camera.ray_table() @ turned.T
        with Hdf5Writer(folder / "events" / side / "rectify_map.h5") as hdf5:
            hdf5.create("rectify_map", data=common.project(points).astype(np.float32))


def write_truth(folder: Path, recording: Recording, shift_us: int) -> None:
    """Writes disparity images of the left camera, where the recording has ground truth."""
    from eventsweep.emvs.geometry.warp import turn_depth

    view_depth = getattr(recording, "truth_view_depth_m", None)
    times = getattr(recording, "truth_times_us", None)
    if view_depth is None or times is None or not len(times(0)):
        return
    common, R_left, _, baseline_m = rectification(recording.rig)
    images = folder / "disparity" / "event"
    images.mkdir(parents=True)
    for k, t_us in enumerate(times(0)):
        view = recording.rig.cameras[0].undistorted()
        depth_m = turn_depth(view_depth(0, int(t_us)), view, common, R_left)
        write_disparity(images / f"{2 * k:06d}.png", depth_m, common.fx_px * baseline_m)
    stamps = "".join(f"{int(t_us) + shift_us}\n" for t_us in times(0))
    (folder / "disparity" / "timestamps.txt").write_text(stamps, encoding="ascii")


def write_disparity(path: Path, depth_m: NDArray[np.float32], focal_baseline_px_m: float) -> None:
    """Writes z-depth as DSEC's 16-bit disparity: 256 units per pixel, 0 where unknown."""
    known = np.isfinite(depth_m) & (depth_m > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        units = np.rint(np.where(known, focal_baseline_px_m / depth_m, 0) * DISPARITY_SCALE)
    if units.max(initial=0) > 65535:
        raise InputError(
            f"{path}: a disparity of {units.max() / 256:.1f} px does not fit 16 bits (at most "
            "255.99 px); choose another format"
        )
    write_image(path, ".png", units.astype(np.uint16))
