"""Where depth comes from: a recording's ground truth, a map folder, or one dense map as a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.depth import PNG_UNIT_M, read_depth, read_exr, read_png
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.maps.folder import read_map
from eventsweep.plugins.align.views import Array, View, inverse

TRUTH = "truth"
Depths = list[tuple[Array, View]]
"""Maps of inverse depth, 1/m, below 0 where unknown, and who saw each."""


@dataclass(frozen=True)
class DepthSource:
    """Depth at some times, of a scene that is taken to stand still in between.

    Attributes:
        words: what it is, for people.
        t_us: (T,) times with depth, µs, in order.
        read: the maps of one of these times.
    """

    words: str
    t_us: NDArray[np.int64]
    read: Callable[[int], Depths]

    def nearest(self, t_us: float) -> Depths:
        """The maps of the nearest time."""
        return self.read(int(self.t_us[np.argmin(np.abs(self.t_us - t_us))]))


def depth_source(
    recording: Recording, source: str | None, method: str = "", taken: tuple[str, int] | None = None
) -> DepthSource:
    """Opens what `source` names: `truth`, a map folder, or a file of one dense map.

    Args:
        recording: whose poses and calibration say where the depth was seen from.
        source: by default the recording's ground truth.
        method: which of a map's methods; by default its first.
        taken: of a file: the camera's name, and the time, µs.

    Raises:
        InputError: no depth, no poses, or a file that is no depth map of this camera.
    """
    if source is None or source == TRUTH:
        return _truth(recording)
    path = Path(source)
    if path.is_dir():
        return _map(path, method)
    if not path.exists():
        raise InputError(f"{path}: no such map folder or depth file; name one, or {TRUTH!r}")
    if taken is None:
        raise InputError(f"{path}: when was it seen, and by whom? set depth_at_s, set depth_camera")
    return _file(recording, path, *taken)


def _truth(recording: Any) -> DepthSource:
    times = getattr(recording, "truth_times_us", None)
    cameras = range(len(recording.rig))
    t_us = [np.asarray(times(k)) for k in cameras] if times is not None else []
    if not sum(map(len, t_us)):
        raise InputError(
            f"{recording.name}: has no ground truth of depth: set depth, to a map folder, as `map` "
            "writes, or a depth file"
        )
    with_depth = [k for k in cameras if len(t_us[k])]
    at_sensor = hasattr(recording, "truth_depth_m")

    def read(at_us: int) -> Depths:
        found = []
        for k in with_depth:
            if at_us not in t_us[k]:
                continue
            camera = recording.rig.cameras[k]
            depth_m = recording.truth_depth_m(k, at_us) if at_sensor else (
                recording.truth_view_depth_m(k, at_us)
            )  # fmt: skip
            seen = camera if at_sensor else camera.undistorted()
            found.append((inverse(depth_m, sky=at_sensor), _view(recording, k, seen, at_us)))
        return found

    poses_us = recording.trajectory.span_us
    all_us = np.unique(np.concatenate(t_us))
    covered = all_us[(all_us >= poses_us[0]) & (all_us <= poses_us[1])]
    if not len(covered):
        raise InputError(f"{recording.name}: its poses cover no time with ground truth")
    return DepthSource("ground truth", covered, read)


def _view(recording: Recording, k: int, camera: Camera, t_us: int) -> View:
    return View(camera, recording.trajectory.at(t_us) @ recording.rig.T_body_cam[k])


def _map(path: Path, method: str) -> DepthSource:
    windows = read_map(path).windows
    if not windows:
        raise InputError(f"{path}: contains no window: map more of the recording")
    name = method or windows[0].info.methods[0]
    by_time = {window.info.t_ref_us: window for window in windows}

    def read(at_us: int) -> Depths:
        found = by_time[at_us].depth_map(name)
        depth_m = np.where(found.mask, found.depth_m, np.nan).astype(np.float32)
        return [(inverse(depth_m), View(found.camera, found.T_world_rv))]

    return DepthSource(f"{name} of {path}", np.array(sorted(by_time), np.int64), read)


def _file(recording: Recording, path: Path, name: str, t_us: int) -> DepthSource:
    from eventsweep.emvs.data.image_stores import frame_cameras

    rig = recording.rig
    known = {each.name: (each.camera, each.T_body_cam) for each in frame_cameras(recording)}
    known |= {each: (rig.cameras[k], rig.T_body_cam[k]) for k, each in enumerate(rig.camera_names)}
    if name not in known:
        raise InputError(f"{recording.name}: no camera {name!r}, it has {', '.join(known)}")
    camera, T_body_cam = known[name]
    depth_m = _dense(path)
    if depth_m.shape != (camera.height_px, camera.width_px):
        raise InputError(
            f"{path}: shape {depth_m.shape}, {name} has {(camera.height_px, camera.width_px)}: "
            "name the camera that it is depth of"
        )
    view = View(camera, recording.trajectory.at(t_us) @ T_body_cam)
    return DepthSource(str(path), np.array([t_us], np.int64), lambda _: [(inverse(depth_m), view)])


def _dense(path: Path) -> NDArray[np.float32]:
    """(H, W) z-depth, m; a PNG counts millimetres."""
    kind = path.suffix.lower()
    if kind == ".exr":
        channels = read_exr(path)
        if "Z" not in channels:
            raise InputError(f"{path}: channels {', '.join(channels) or 'none'}; needs Z, in m")
        return channels["Z"]
    if kind != ".png":
        return read_depth(path)
    image = read_png(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(f"{path}: {image.ndim}D {image.dtype}; needs one channel of 16 bits, mm")
    return np.where(image > 0, image * PNG_UNIT_M, np.nan).astype(np.float32)
