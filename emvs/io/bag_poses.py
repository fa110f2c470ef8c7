"""Trajectories and typed messages from ROS1 and ROS2 bags, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from emvs.errors import InputError
from emvs.formats.rosbag import opened_bag
from emvs.geometry.trajectory import Trajectory
from emvs.io.events.wording import quoted, said

POSE_TYPES: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "geometry_msgs/msg/PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (
        m.pose.pose.position,
        m.pose.pose.orientation,
    ),
    "nav_msgs/msg/Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
_MOST_POSES = 10_000_000


class PoseTopic(NamedTuple):
    """Which topic's poses are meant, or why none is."""

    name: str
    lacks: str


def pose_topic(kinds: Mapping[str, str], streams: Sequence[str]) -> PoseTopic:
    """Chooses among a bag's topics: the only one with poses, or that beside the first events.

    ESIM writes a topic of poses for every camera, `/cam0/pose` beside `/cam0/events`; those of the
    first camera are the rig's.

    Args:
        kinds: type of each topic.
        streams: topics of events, the first camera's first.
    """
    found = [name for name, kind in kinds.items() if kind in POSE_TYPES]
    own = f"{streams[0].rpartition('/')[0]}/pose" if streams else ""
    if own in found:
        return PoseTopic(own, "")
    if len(found) == 1:
        return PoseTopic(found[0], "")
    if not found:
        return PoseTopic("", "no poses: no topic of poses, no poses.txt beside it")
    words = f"poses in {quoted(*found)}: name one as poses.topic in a recording.toml"
    return PoseTopic("", words)


def topics(path: Path) -> dict[str, str]:
    """Type of each topic of a bag.

    Raises:
        InputError: a missing or damaged bag.
    """
    with opened_bag(path) as bag:
        return {c.topic: c.msgtype for c in bag.connections}


def messages(path: Path, topic: str) -> Iterator[Any]:
    """The decoded messages of a topic of standard type, in the order of recording.

    Raises:
        InputError: a damaged bag or message.
    """
    from rosbags.typesys import Stores, get_typestore

    ros2 = path.is_dir()
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    with opened_bag(path) as bag:
        wanted = [c for c in bag.connections if c.topic == topic]
        decode = store.deserialize_cdr if ros2 else store.deserialize_ros1
        for number, (connection, stamp_ns, data) in enumerate(bag.messages(wanted)):
            try:
                message = decode(data, connection.msgtype)
            except Exception as error:  # the library's decoders end in whatever Python has
                raise InputError(
                    f"{path}, topic {quoted(topic)}, message {number} at {stamp_ns} ns: cannot be "
                    f"read as {connection.msgtype} ({said(error)}); damaged, record the bag again"
                ) from error
            yield message


def read_bag_poses(path: Path, topic: str = "", shift_us: int = 0) -> Trajectory:
    """Reads the poses of a topic; their own stamps count, not those of recording.

    Args:
        path: a ROS1 bag or the folder of a ROS2 bag.
        topic: which one; may be empty where only one has poses.
        shift_us: added to every time, µs.

    Raises:
        InputError: no such topic, several to choose from, a damaged bag, or impossible poses.
    """
    kinds = topics(path)
    found = [name for name, kind in kinds.items() if kind in POSE_TYPES]
    if topic and topic not in found:
        raise InputError(f"{path}: no poses in {topic!r}; there are {', '.join(found) or 'none'}")
    if not topic and len(found) != 1:
        raise InputError(
            f"{path}: poses in {quoted(*found) or 'no topic'}; needs one: name it as poses.topic "
            "in a recording.toml, or name a file of poses there"
        )
    topic = topic or found[0]
    rows, part = [], POSE_TYPES[kinds[topic]]
    for message in messages(path, topic):
        at, turn = part(message)
        stamp = message.header.stamp
        t_us = stamp.sec * 1_000_000 + round(stamp.nanosec / 1000) + shift_us
        rows.append((t_us, at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w))
        if len(rows) > _MOST_POSES:
            raise InputError(f"{path}, topic {topic}: more than {_MOST_POSES} poses: cut the bag")
    if not rows:
        raise InputError(f"{path}, topic {topic}: no poses; record it again")
    t_us_all = np.array([row[0] for row in rows], np.int64)
    values = np.array([row[1:] for row in rows], np.float64)
    try:
        return Trajectory(t_us_all, values[:, :3].copy(), values[:, 3:].copy())
    except InputError as error:
        raise InputError(f"{path}, topic {topic}: {error}") from error
