"""A rig from the `camera_info` topics of a ROS bag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.data import se3
from emvs.data.camera import Camera, Model
from emvs.data.rig import Rig
from emvs.errors import InputError
from emvs.io.bag_poses import messages, topics
from emvs.io.calibration_values import camera_of

_TYPE = "sensor_msgs/msg/CameraInfo"
_MODELS: dict[str, Model] = {
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "equidistant": "kb4",
    "fisheye": "kb4",
    "": "pinhole",
}


def read_bag_rig(path: Path, event_topics: Sequence[str]) -> Rig:
    """Reads `camera_info` of each event camera: the topic beside its events.

    The projection matrices and rectifying rotations say how the cameras stand to each other: the
    rectified frames are parallel, and the fourth column of `P` is minus the focal length times
    the offset from the first camera.

    Raises:
        InputError: no such topic, or impossible values.
    """
    kinds = topics(path)
    entries = [_info(path, kinds, topic) for topic in event_topics]
    where = f"{path}, camera_info"
    T_rect_cam = [_place(info, where) for info in entries]
    T_first = se3.inverse(T_rect_cam[0])
    return Rig(
        path.stem,
        tuple(_camera(info, where) for info in entries),
        tuple(T_first @ T for T in T_rect_cam),
    )


def _place(info: Any, where: str) -> NDArray[np.float64]:
    """Where a camera stands in the rig's common rectified frame, (4, 4)."""
    R, P = _of(info, "R").reshape(3, 3), _of(info, "P").reshape(3, 4)
    if (
        np.abs(R @ R.T - np.eye(3)).max() > 1e-3
        or abs(np.linalg.det(P[:, :3])) < 1e-9
        or not np.isfinite(P).all()
    ):
        raise InputError(f"{where}: R is no rotation or P no projection; name a calibration file")
    T_rect_cam = np.eye(4)
    T_rect_cam[:3, :3] = R
    T_rect_cam[:3, 3] = -np.linalg.solve(P[:, :3], P[:, 3])
    return T_rect_cam


def _info(path: Path, kinds: dict[str, str], topic: str) -> Any:
    name = f"{topic.rsplit('/', 1)[0]}/camera_info"
    if kinds.get(name) != _TYPE:
        raise InputError(
            f"{path}: no topic {name} ({_TYPE}); put a Kalibr camera chain beside the bag"
        )
    found = next(messages(path, name), None)
    if found is None:
        raise InputError(f"{path}: topic {name} is empty; put a Kalibr camera chain beside the bag")
    return found


def _camera(info: Any, where: str) -> Camera:
    kind = str(info.distortion_model)
    terms = [float(v) for v in _of(info, "D")]
    if kind not in _MODELS:
        raise InputError(f"{where}: lens model {kind!r}; needs {', '.join(filter(None, _MODELS))}")
    model = _MODELS[kind] if any(terms) else "pinhole"
    K = _of(info, "K").reshape(3, 3)
    four = [float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]
    kept = [] if model == "pinhole" else terms
    return camera_of([int(info.width), int(info.height)], four, model, kept, where, where)


def _of(info: Any, name: str) -> NDArray[np.float64]:
    """ROS1 calls it `K`, ROS2 `k`."""
    values = getattr(info, name, None)
    return np.asarray(getattr(info, name.lower()) if values is None else values, np.float64)
