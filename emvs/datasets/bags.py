"""Rigs, trajectories and typed messages from ROS1 and ROS2 bags, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, located, quoted, refused
from eventsweep.emvs.formats.calibration_values import camera_of
from eventsweep.emvs.formats.rosbag import is_ros2, opened_bag
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

_TYPE = "sensor_msgs/msg/CameraInfo"
_NOT_RIGID_M = 1e-3
_MODELS: dict[str, Model] = {
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "equidistant": "kb4",
    "fisheye": "kb4",
    "": "pinhole",
}
POSE_TYPES: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/TransformStamped": lambda message: message.transform,
}
"""Types of messages with a pose, and where it is in them."""
_MOST_POSES = 10_000_000


def info_topic(events_topic: str) -> str:
    """The topic of `camera_info` that belongs to a topic of events: the one beside it."""
    return f"{events_topic.rpartition('/')[0]}/camera_info"


def read_bag_rig(path: Path, event_topics: Sequence[str]) -> Rig:
    """Reads `camera_info` of each event camera: the topic beside its events.

    The projection matrices and rectifying rotations say how the cameras stand to each other: the
    rectified frames are parallel, and the fourth column of `P` is minus the focal length times
    the offset from the first camera. Where they put all cameras into one place, as ESIM does, the
    topics of poses beside the events say it.
    """
    kinds = topics(path)
    entries = [_info(path, kinds, topic) for topic in event_topics]
    wheres = [f"{path}, topic {quoted(info_topic(topic))}" for topic in event_topics]
    cameras = tuple(map(_camera, entries, wheres))
    T_rect_cam = list(map(_place, entries, wheres))
    T_first = se3.inverse(T_rect_cam[0])
    T_body_cam = [T_first @ T for T in T_rect_cam]
    if len(entries) > 1 and max(np.abs(T[:3, 3]).max() for T in T_body_cam) < 1e-6:
        T_body_cam = _by_poses(path, kinds, event_topics)
    return Rig(path.stem, cameras, tuple(T_body_cam))


def _by_poses(
    path: Path, kinds: Mapping[str, str], event_topics: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Where each camera sits in the first one's frame, by the poses of all of them."""
    names = [f"{topic.rpartition('/')[0]}/pose" for topic in event_topics]
    absent = [name for name in names if kinds.get(name) not in POSE_TYPES]
    if absent:
        raise InputError(
            f"{path}: camera_info puts all cameras in the same place, and there are no poses in "
            f"{quoted(*absent)}; put a Kalibr camera chain beside the bag"
        )
    first, *others = (read_bag_poses(path, name) for name in names)
    pairs = zip(names[1:], others, strict=True)
    return [np.eye(4), *(_constant(path, name, first, other) for name, other in pairs)]


def _constant(path: Path, name: str, first: Trajectory, other: Trajectory) -> NDArray[np.float64]:
    """`T_first_other`, which must be the same whenever both have a pose."""
    common_us = np.intersect1d(first.t_us, other.t_us)
    if not len(common_us):
        raise InputError(
            f"{path}, topic {quoted(name)}: no time stamp in common with the first camera's "
            "poses; put a Kalibr camera chain beside the bag"
        )
    T_first_other = se3.inverse(first.at(common_us)) @ other.at(common_us)
    off_m = np.abs(T_first_other - T_first_other[0]).max()
    if off_m > _NOT_RIGID_M:
        raise InputError(
            f"{path}, topic {quoted(name)}: moves by {off_m:.3g} relative to the first camera; "
            "needs a rigid rig: put a Kalibr camera chain beside the bag"
        )
    return np.asarray(T_first_other[0], np.float64)


def _place(info: Any, where: str) -> NDArray[np.float64]:
    """Where a camera stands in the rig's common rectified frame, (4, 4)."""
    R, P = _of(info, "R").reshape(3, 3), _of(info, "P").reshape(3, 4)
    if (
        not (np.isfinite(R).all() and np.isfinite(P).all())
        or np.abs(R @ R.T - np.eye(3)).max() > 1e-3
        or abs(np.linalg.det(P[:, :3])) < 1e-9
    ):
        raise InputError(
            f"{where}: R is not a rotation, or P is not a projection; give a calibration file"
        )
    T_rect_cam = np.eye(4)
    T_rect_cam[:3, :3] = R
    T_rect_cam[:3, 3] = -np.linalg.solve(P[:, :3], P[:, 3])
    return T_rect_cam


def _info(path: Path, kinds: dict[str, str], topic: str) -> Any:
    name = info_topic(topic)
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


def pose_topic(kinds: Mapping[str, str], streams: Sequence[str]) -> tuple[str, str]:
    """Chooses among a bag's topics: the only one with poses, or that beside the first events.

    ESIM writes a topic of poses for every camera, `/cam0/pose` beside `/cam0/events`; those of the
    first camera are the rig's.

    Args:
        kinds: type of each topic.
        streams: topics of events, the first camera's first.

    Returns:
        The topic, or else an empty name and why none is meant.
    """
    names = [name for name, kind in kinds.items() if kind in POSE_TYPES]
    own = f"{streams[0].rpartition('/')[0]}/pose" if streams else ""
    if own in names or len(names) == 1:
        return own if own in names else names[0], ""
    if not names:
        return "", "no pose topic in it, no poses.txt beside it"
    return "", f"poses in {quoted(*names)}: choose one with poses.topic in a recording.toml"


def topics(path: Path) -> dict[str, str]:
    """Type of each topic of a bag."""
    with opened_bag(path) as bag:
        return {c.topic: c.msgtype for c in bag.connections}


def messages(path: Path, topic: str) -> Iterator[Any]:
    """The decoded messages of a topic of standard type, in the order of recording."""
    from rosbags.typesys import Stores, get_typestore

    ros2 = is_ros2(path)
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    with opened_bag(path) as bag:
        wanted = [c for c in bag.connections if c.topic == topic]
        decode = store.deserialize_cdr if ros2 else store.deserialize_ros1
        for number, (connection, stamp_ns, data) in enumerate(bag.messages(wanted)):
            where = f"{path}, topic {quoted(topic)}, message {number} at {stamp_ns} ns"
            what = f"{where}: cannot be read as {connection.msgtype}"
            # The library's decoders end in whatever Python has.
            with refused(what, Exception, cure="; damaged, record the bag again"):
                message = decode(data, connection.msgtype)
            yield message


def read_bag_poses(path: Path, topic: str = "", shift_us: int = 0) -> Trajectory:
    """Reads the poses of a topic; their own stamps count, not those of recording.

    Args:
        path: a ROS1 bag, the folder of a ROS2 bag, or a lone MCAP file.
        topic: which one; may be empty where only one has poses.
        shift_us: added to every time, µs.

    Raises:
        InputError: no such topic, several to choose from, a damaged bag, or impossible poses.
    """
    kinds = topics(path)
    found = [name for name, kind in kinds.items() if kind in POSE_TYPES]
    if topic and topic not in found:
        raise InputError(
            f"{path}: no poses in {topic!r}; topics with poses: {', '.join(found) or 'none'}"
        )
    if not topic and len(found) != 1:
        raise InputError(
            f"{path}: poses in {quoted(*found) or 'no topic'}; needs one: set poses.topic in a "
            "recording.toml, or name a pose file there"
        )
    topic = topic or found[0]
    rows, part = [], POSE_TYPES[kinds[topic]]
    for message in messages(path, topic):
        pose = part(message)
        at = getattr(pose, "position", None) or pose.translation
        turn = getattr(pose, "orientation", None) or pose.rotation
        stamp = message.header.stamp
        t_us = stamp.sec * 1_000_000 + round(stamp.nanosec / 1000) + shift_us
        rows.append((t_us, at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w))
        if len(rows) > _MOST_POSES:
            raise InputError(f"{path}, topic {topic}: more than {_MOST_POSES} poses: split the bag")
    if not rows:
        raise InputError(f"{path}, topic {topic}: no poses; record it again")
    t_us_all = np.array([row[0] for row in rows], np.int64)
    values = np.array([row[1:] for row in rows], np.float64)
    with located(f"{path}, topic {topic}"):
        return Trajectory(t_us_all, values[:, :3].copy(), values[:, 3:].copy())
