"""What radiance fields and splatting take: views of nerfstudio, COLMAP and EventNeRF.

nerfstudio (Tancik et al., SIGGRAPH 2023) has `transforms.json`, with OpenGL's camera axes and lens
terms as OpenCV names them; COLMAP (Schoenberger and Frahm, CVPR 2016) tables of cameras and images.
EventNeRF (Rudnev et al., CVPR 2023) has a text per view, evenly spaced over the events' time, and
pinhole pixels. All count a pixel's centre as half a pixel.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import FrameCamera
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.depth import write_image
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory

_HALF_PX = 0.5
_MODELS = {"pinhole": "OPENCV", "radtan": "OPENCV", "kb4": "OPENCV_FISHEYE"}
_TERMS = {"pinhole": (), "radtan": ("k1", "k2", "p1", "p2", "k3"), "kb4": ("k1", "k2", "k3", "k4")}
_GL = np.diag([1.0, -1.0, -1.0, 1.0])
_MOST_VIEWS = 1000
_COLMAP = {
    "cameras": "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n",
    "images": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ (T_cam_world), CAMERA_ID, NAME; no points\n",
    "points3D": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n",
}
"""First lines of its texts."""


Picture = Callable[[], NDArray[np.uint8] | None]


class View(NamedTuple):
    """What one camera saw, or would have seen, at one time.

    Attributes:
        camera: number; frame cameras follow those of events.
        lens: of that camera.
        t_us: time on the files' clock, µs.
        T_world_cam: (4, 4) pose.
        events: file of the camera's events; empty for a frame camera.
        file: where its picture belongs; empty where there is none.
        picture: gives the (H, W) picture.
    """

    camera: int
    lens: Camera
    t_us: int
    T_world_cam: NDArray[np.float64]
    events: str
    file: str
    picture: Picture


class Placed(NamedTuple):
    """A frame camera and where it went, `T_world_cam` on the files' clock."""

    seen: FrameCamera
    T_world_cam: Trajectory

    def inside(self, shift_us: int) -> Iterator[tuple[int, int]]:
        """Index and time, on the files' clock, of the pictures that the poses cover."""
        first_us, last_us = self.T_world_cam.span_us
        for index, t_us in enumerate((self.seen.pictures.t_us + shift_us).tolist()):
            if first_us <= t_us <= last_us:
                yield index, t_us


def views_of(
    recording: Recording,
    cameras: Sequence[Trajectory],
    beside: Sequence[Placed],
    events: Sequence[str],
    shift_us: int,
) -> Iterator[View]:
    """The views of all cameras: at their pictures, or else at the poses.

    Args:
        recording: what has the lenses and pictures, on its own clock.
        cameras: `T_world_cam` of each event camera on the files' clock.
        beside: the frame cameras.
        events: file of each event camera.
        shift_us: leads from the recording's clock to the files'.
    """
    for k, camera in enumerate(recording.rig.cameras):
        own_us = _picture_times_us(recording, k)
        times_us = own_us + shift_us if len(own_us) else cameras[k].t_us
        inside = (times_us >= cameras[k].span_us[0]) & (times_us <= cameras[k].span_us[1])
        for number, t_us in enumerate(times_us[inside].tolist()):
            file = f"images/cam{k}_{number:05d}.png" if len(own_us) else ""
            picture: Picture = partial(_picture, recording, k, t_us - shift_us)
            yield View(k, camera, t_us, cameras[k].at(t_us), events[k], file, picture)
    for k, placed in enumerate(beside):
        number, seen = len(recording.rig) + k, placed.seen
        for count, (index, t_us) in enumerate(placed.inside(shift_us)):
            file, picture = f"images/frame{k}_{count:05d}.png", partial(_frame, seen, index)
            pose = placed.T_world_cam.at(t_us)
            yield View(number, seen.camera, t_us, pose, "", file, picture)


def _frame(seen: FrameCamera, index: int) -> NDArray[np.uint8]:
    return seen.photo(index).image


def one_model(
    cameras: Iterable[Camera], beside: Sequence[FrameCamera]
) -> tuple[str, list[FrameCamera]]:
    """Nerfstudio's model of the event cameras' lenses, and the frame cameras that have it, too.

    Raises:
        InputError: event cameras of different models, of which nerfstudio takes one.
    """
    models = sorted({_MODELS[camera.model] for camera in cameras})
    if len(models) > 1:
        raise InputError(
            f"different lens models, {', '.join(models)}; nerfstudio supports one model for all "
            "cameras"
        )
    return models[0], [seen for seen in beside if _MODELS[seen.camera.model] == models[0]]


def write_transforms(folder: Path, model: str, views: Iterable[View]) -> None:
    """Writes `transforms.json`, and a picture per view below `images/` where there are pictures."""
    frames: list[dict[str, Any]] = []
    for view in views:
        entry: dict[str, Any] = {"camera": view.camera}
        entry |= {"events": view.events} if view.events else {}
        entry |= {"t_us": view.t_us, "time": view.t_us / 1e6}
        if view.file:
            entry["file_path"] = view.file
            _write_picture(folder / view.file, view.picture())
        pose = {"transform_matrix": (view.T_world_cam @ _GL).tolist()}
        frames.append(entry | _lens(view.lens) | pose)
    text = json.dumps({"camera_model": model, "frames": frames}, indent=1)
    (folder / "transforms.json").write_text(text + "\n", encoding="utf-8")


def _lens(camera: Camera) -> dict[str, Any]:
    terms = zip(_TERMS[camera.model], camera.distortion, strict=False)
    return {
        "fl_x": camera.fx_px, "fl_y": camera.fy_px,
        "cx": camera.cx_px + _HALF_PX, "cy": camera.cy_px + _HALF_PX,
        "w": camera.width_px, "h": camera.height_px, **dict(terms),
    }  # fmt: skip


def write_colmap(folder: Path, views: Iterable[View]) -> None:
    """Writes COLMAP's text model into `sparse/0`, without points, and pictures into `images`.

    Raises:
        InputError: no view has a picture.
    """
    lenses: dict[int, str] = {}
    poses: list[str] = []
    for view in views:
        if view.file:
            _write_picture(folder / view.file, view.picture())
            lenses.setdefault(view.camera, _colmap_lens(view.lens))
            position_m, (x, y, z, w) = se3.to_quat_xyzw(se3.inverse(view.T_world_cam))
            numbers = " ".join(f"{value:.17g}" for value in (w, x, y, z, *position_m))
            name = Path(view.file).name
            poses.append(f"{len(poses) + 1} {numbers} {view.camera + 1} {name}\n\n")
    if not poses:
        raise InputError(f"{folder.name}: no pictures, which COLMAP's views are; choose nerfstudio")
    texts = {
        "cameras": [f"{camera + 1} {lens}\n" for camera, lens in lenses.items()],
        "images": poses, "points3D": [],
    }  # fmt: skip
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    for name, lines in texts.items():
        (model / f"{name}.txt").write_text("".join([_COLMAP[name], *lines]), encoding="ascii")


def _colmap_lens(camera: Camera) -> str:
    """Model, size and parameters; a radial-tangential lens of five terms has three more that are 0.

    COLMAP's order of terms is OpenCV's.
    """
    terms = list(camera.distortion)
    model = {"pinhole": "PINHOLE", "radtan": "OPENCV", "kb4": "OPENCV_FISHEYE"}[camera.model]
    if len(terms) > 4:
        model, terms = "FULL_OPENCV", [*terms, 0.0, 0.0, 0.0]
    centre = camera.cx_px + _HALF_PX, camera.cy_px + _HALF_PX
    numbers = (camera.fx_px, camera.fy_px, *centre, *terms)
    values = " ".join(f"{value:.17g}" for value in numbers)
    return f"{model} {camera.width_px} {camera.height_px} {values}"


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
    folder: Path, lens: Camera, views: Iterable[tuple[NDArray[np.float64], Picture]]
) -> None:
    """Writes EventNeRF's `pose/`, `intrinsics/` and `rgb/` of one camera, undistorted.

    Pictures are black where there are none: its loader asks for a file per view.

    Args:
        folder: of the split.
        lens: of the camera.
        views: `T_world_cam` of each, and what gives its picture.
    """
    K = np.eye(4)
    K[:3, :3] = lens.K
    K[:2, 2] += _HALF_PX
    rows = np.concatenate([K, np.zeros((1, 4))])  # the last: no lens terms
    for name in ("pose", "intrinsics", "rgb"):
        (folder / name).mkdir(parents=True)
    rays = lens.undistorted().ray_table()  # of the view's pixels, and where the sensor has them:
    table = np.nan_to_num(lens.project(rays), nan=-1e4).astype(np.float32)
    for number, (T_world_cam, picture) in enumerate(views):
        stem = f"{number:06d}"
        np.savetxt(folder / "pose" / f"{stem}.txt", T_world_cam, fmt="%.17g")
        np.savetxt(folder / "intrinsics" / f"{stem}.txt", rows, fmt="%.17g")
        image = picture()
        image = np.zeros(table.shape[:2], np.uint8) if image is None else image
        seen = cv2.remap(image, table[..., 0], table[..., 1], cv2.INTER_LINEAR)
        _write_picture(folder / "rgb" / f"{stem}.png", seen)


def event_views(
    recording: Recording, camera: int, T_world_cam: Trajectory, shift_us: int
) -> Iterator[tuple[NDArray[np.float64], Picture]]:
    """Poses of views of an event camera on the files' clock, with the nearest picture."""
    for t_us in T_world_cam.t_us.tolist():
        yield T_world_cam.at(t_us), partial(_picture, recording, camera, t_us - shift_us)


def frame_views(placed: Placed, shift_us: int) -> Iterator[tuple[NDArray[np.float64], Picture]]:
    """Poses and pictures of a frame camera."""
    for index, t_us in placed.inside(shift_us):
        yield placed.T_world_cam.at(t_us), partial(_frame, placed.seen, index)


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
