"""What radiance fields and splatting of events take: views of nerfstudio and of EventNeRF.

nerfstudio (Tancik et al., SIGGRAPH 2023) has `transforms.json`, with OpenGL's camera axes and lens
terms as OpenCV names them. EventNeRF (Rudnev et al., CVPR 2023) has a text per view, evenly spaced
over the events' time, and pinhole pixels. Both count a pixel's centre as half a pixel.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.depth import write_image
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory

_HALF_PX = 0.5
_MODELS = {"pinhole": "OPENCV", "radtan": "OPENCV", "kb4": "OPENCV_FISHEYE"}
_TERMS = {"pinhole": (), "radtan": ("k1", "k2", "p1", "p2", "k3"), "kb4": ("k1", "k2", "k3", "k4")}
_GL = np.diag([1.0, -1.0, -1.0, 1.0])
_MOST_VIEWS = 1000


def write_transforms(
    folder: Path,
    recording: Recording,
    cameras: tuple[Trajectory, ...],
    events: list[str],
    shift_us: int,
) -> None:
    """Writes `transforms.json`, and a picture per view below `images/` where there are pictures.

    Args:
        folder: where the files of events lie.
        recording: what has the lenses and pictures, on its own clock.
        cameras: `T_world_cam` of each camera on the files' clock.
        events: file of each camera.
        shift_us: leads from the recording's clock to the files'.
    """
    models = sorted({_MODELS[camera.model] for camera in recording.rig.cameras})
    if len(models) > 1:
        raise InputError(
            f"{folder}: different lens models, {', '.join(models)}; nerfstudio supports one "
            "model for all cameras"
        )
    frames: list[dict[str, Any]] = []
    for k, camera in enumerate(recording.rig.cameras):
        own_us = _picture_times_us(recording, k)
        times_us = own_us + shift_us if len(own_us) else cameras[k].t_us
        inside = (times_us >= cameras[k].span_us[0]) & (times_us <= cameras[k].span_us[1])
        for number, t_us in enumerate(times_us[inside].tolist()):
            view = {"camera": k, "events": events[k], "t_us": t_us, "time": t_us / 1e6}
            if len(own_us):
                view["file_path"] = f"images/cam{k}_{number:05d}.png"
                image = _picture(recording, k, t_us - shift_us)
                _write_picture(folder / view["file_path"], image)
            pose = cameras[k].at(t_us) @ _GL
            frames.append(view | _lens(camera) | {"transform_matrix": pose.tolist()})
    text = json.dumps({"camera_model": models[0], "frames": frames}, indent=1)
    (folder / "transforms.json").write_text(text + "\n", encoding="utf-8")


def _lens(camera: Camera) -> dict[str, Any]:
    terms = zip(_TERMS[camera.model], camera.distortion, strict=False)
    return {
        "fl_x": camera.fx_px, "fl_y": camera.fy_px,
        "cx": camera.cx_px + _HALF_PX, "cy": camera.cy_px + _HALF_PX,
        "w": camera.width_px, "h": camera.height_px, **dict(terms),
    }  # fmt: skip


def _picture_times_us(recording: Recording, camera: int) -> NDArray[np.int64]:
    """When there are pictures of a camera, µs: a frame camera's, else those of the truth."""
    for name in ("photo_times_us", "frame_times_us", "truth_times_us"):
        times_us = getattr(recording, name, lambda _: np.empty(0, np.int64))(camera)
        if len(times_us) and _picture(recording, camera, int(times_us[0])) is not None:
            return np.asarray(times_us, np.int64)
    return np.empty(0, np.int64)


def _picture(recording: Any, camera: int, t_us: int) -> NDArray[np.uint8] | None:
    """(H, W) the picture nearest to a time on the recording's clock, if there is one."""
    photos = getattr(recording, "photo_times_us", lambda _: ())(camera)
    if len(photos):
        return np.asarray(recording.photo(camera, t_us).image)
    image: NDArray[np.uint8] | None = recording.frame(camera, t_us)
    return image


def _write_picture(path: Path, image: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, ".png", np.asarray(image, np.uint8))


def view_times_us(poses: Trajectory, span_us: tuple[int, int]) -> NDArray[np.int64]:
    """Evenly spaced times of views, µs, about as many as there are poses in a span."""
    inside = np.count_nonzero((poses.t_us >= span_us[0]) & (poses.t_us <= span_us[1]))
    return np.rint(np.linspace(*span_us, int(np.clip(inside, 2, _MOST_VIEWS)))).astype(np.int64)


def write_views(
    folder: Path, recording: Recording, camera: int, T_world_cam: Trajectory, shift_us: int
) -> None:
    """Writes EventNeRF's `pose/`, `intrinsics/` and `rgb/` of one camera, undistorted.

    Pictures are black where the recording has none: its loader asks for a file per view.

    Args:
        folder: of the split.
        recording: what has the lenses and pictures.
        camera: which camera.
        T_world_cam: the views, on the events' clock.
        shift_us: leads from the recording's clock to theirs.
    """
    lens = recording.rig.cameras[camera]
    K = np.eye(4)
    K[:3, :3] = lens.K
    K[:2, 2] += _HALF_PX
    rows = np.concatenate([K, np.zeros((1, 4))])  # the last: no lens terms
    for name in ("pose", "intrinsics", "rgb"):
        (folder / name).mkdir(parents=True)
    rays = lens.undistorted().ray_table()  # of the view's pixels, and where the sensor has them:
    table = np.nan_to_num(lens.project(rays), nan=-1e4).astype(np.float32)
    for number, t_us in enumerate(T_world_cam.t_us.tolist()):
        stem = f"{number:06d}"
        np.savetxt(folder / "pose" / f"{stem}.txt", T_world_cam.at(t_us), fmt="%.17g")
        np.savetxt(folder / "intrinsics" / f"{stem}.txt", rows, fmt="%.17g")
        image = _picture(recording, camera, t_us - shift_us)
        image = np.zeros(table.shape[:2], np.uint8) if image is None else image
        seen = cv2.remap(image, table[..., 0], table[..., 1], cv2.INTER_LINEAR)
        _write_picture(folder / "rgb" / f"{stem}.png", seen)


class Undistorter:
    """Moves events to the nearest pixel of the undistorted view; drops those beside it."""

    def __init__(self, camera: Camera) -> None:
        self._same = camera.model == "pinhole"
        self._size_px = (camera.width_px, camera.height_px)
        uv = np.nan_to_num(camera.undistorted().project(camera.ray_table()), nan=-1.0)
        self._table = np.rint(np.clip(uv, -1, 70_000)).astype(np.int64)

    def __call__(self, events: Events) -> Events:
        """The events in the view."""
        if self._same:
            return events
        x, y = self._table[events.y, events.x].T
        inside = (x >= 0) & (y >= 0) & (x < self._size_px[0]) & (y < self._size_px[1])
        kept = events.take(inside)
        return Events(x[inside].astype(np.uint16), y[inside].astype(np.uint16), kept.t_us, kept.p)
