"""Writes what DSEC holds beside events: calibration, rectification maps and disparity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from emvs.data.hdf5 import Hdf5Writer
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.formats.calibration_writers import kalibr_camera
from emvs.geometry import se3
from emvs.geometry.camera import Camera
from emvs.geometry.rig import Rig
from emvs.io.dsec import DISPARITY_SCALE

Array = NDArray[np.float64]


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
    for k, (camera, kind) in enumerate(
        zip(
            [rig.cameras[j] for j in (0, 0, 1, 1)],
            ("event", "frame", "frame", "event"),
            strict=True,
        )
    ):
        intrinsics[f"cam{k}"] = {"camera_type": kind, **kalibr_camera(camera, f"cam{k}")}
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
        rays = camera.bearing_table()
        points = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ turned.T
        with Hdf5Writer(folder / "events" / side / "rectify_map.h5") as hdf5:
            hdf5.file["rectify_map"] = common.project(points).astype(np.float32)


def write_truth(folder: Path, recording: Recording, shift_us: int) -> None:
    """Writes disparity images of the left camera, where the recording has ground truth."""
    from emvs.geometry.warp import turn_depth

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
    """Writes z-depth as DSEC's 16-bit disparity: 256 units per pixel, 0 where unknown.

    Raises:
        InputError: a disparity of 256 px or more, which 16 bits do not hold.
    """
    known = np.isfinite(depth_m) & (depth_m > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        units = np.rint(np.where(known, focal_baseline_px_m / depth_m, 0) * DISPARITY_SCALE)
    if units.max(initial=0) > 65535:
        raise InputError(f"{path}: a disparity of {units.max() / 256:.1f} px; 16 bits hold 255.99")
    done, data = cv2.imencode(".png", units.astype(np.uint16))
    if not done:
        raise InputError(f"{path}: cannot be coded as PNG")
    path.write_bytes(data.tobytes())
