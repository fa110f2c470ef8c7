"""Events of straight edges without a renderer, and trackers that are fed with them."""

import numpy as np

import point_world as world
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Change, Tracked
from eventsweep.plugins.track.odometry.tracker import Tracker

CONFIG = TrackConfig(map_rate_hz=8, map_s=0.2, planes=40)


def edges(segments=60, per_segment=120, seed=0, near_m=0.7, far_m=3.0, along=(1, 1, 0.4)):
    """(N, 3) points on random segments before a camera at the origin, m; `along` weighs axes."""
    rng = np.random.default_rng(seed)
    rho = rng.uniform(1 / far_m, 1 / near_m, segments)
    middle = np.c_[rng.uniform(-0.8, 0.8, (segments, 2)), np.ones(segments)] / rho[:, None]
    along = rng.normal(size=(segments, 3)) * along
    along *= 0.25 / rho[:, None] / np.linalg.norm(along, axis=1, keepdims=True)
    share = np.linspace(-1, 1, per_segment)
    return (middle[:, None] + share[:, None] * along[:, None]).reshape(-1, 3)


def recorded(trajectory, cameras=2, seed=0, camera=None):
    """A recording of a rig of `cameras` that moves so among edges, in memory."""
    camera = camera or world.pinhole(width=160, height=120, f=130.0)
    rig = world.stereo_rig(camera, 0.1, cameras)
    points = edges(seed=seed)
    streams = tuple(world._entered(points, trajectory, camera, T) for T in rig.T_body_cam)
    return world.Recorded(rig, trajectory, streams, (0.5, 4.0))


def swaying(duration_us):
    """A recording of a pair that sways a little among edges."""
    way = world.swinging(turn_deg=(3, 4, 2), way_m=(0.08, 0.05, 0.04), duration_us=duration_us)
    return recorded(way)


class Wrapped:
    """A recording, of which a class changes what it defines."""

    def __init__(self, recording):
        self._recording = recording

    def __getattr__(self, name):
        return getattr(self._recording, name)


def tracker_of(recording, config=CONFIG):
    """A tracker of a recording's rig, and the list that its poses come into."""
    poses = []
    return Tracker(recording.rig, config, depth_range_m=(0.5, 4.0), on_pose=poses.append), poses


def worst_m(trajectory, truth, at=0):
    """Largest error of position relative to one pose, the first or the last, m."""
    G, E = truth.at(trajectory.t_us), trajectory.at(trajectory.t_us)
    off = se3.inverse(se3.inverse(G[at]) @ G) @ (se3.inverse(E[at]) @ E)
    return float(np.linalg.norm(off[:, :3, 3], axis=1).max())


def tracked_truly(recording, *_arguments, **_settings):
    """What a tracker without errors says, in a world that begins at its first pose."""
    poses, span_us = recording.trajectory, recording.event_span_us(0)
    T_own_world = se3.inverse(poses.at(poses.t_us[0]))
    own = Trajectory.from_matrices(poses.t_us, T_own_world @ poses.at(poses.t_us))
    began = Change(span_us[0], Status.TRACKING, "")
    return Tracked(
        own, (Status.TRACKING,) * len(own), (began,), span_us, 0, np.zeros((len(own), 6, 6))
    )
