"""Events of straight edges without a renderer: points close together on segments in space."""

import numpy as np

import point_world as world


def edges(segments=60, per_segment=120, seed=0, near_m=0.7, far_m=3.0):
    """(N, 3) points on random segments before a camera at the origin, m."""
    rng = np.random.default_rng(seed)
    rho = rng.uniform(1 / far_m, 1 / near_m, segments)
    middle = np.c_[rng.uniform(-0.8, 0.8, (segments, 2)), np.ones(segments)] / rho[:, None]
    along = rng.normal(size=(segments, 3)) * [1, 1, 0.4]
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
