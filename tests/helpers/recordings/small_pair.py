"""A sequence that commands can work on in no time."""

from pathlib import Path

import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

CAMERA = Camera(40, 30, 30, 30, 19.5, 14.5)


def small_sequence(path: Path, *, poses_end_us: int = 100_000) -> Path:
    """A pair that slides sideways before random points: enough to map, in no time."""
    T_body_right = np.eye(4)
    T_body_right[0, 3] = 0.1
    rig = Rig("small", (CAMERA, CAMERA), (np.eye(4), T_body_right))
    t_us = np.linspace(0, poses_end_us, 11).astype(np.int64)
    positions_m = np.outer(np.linspace(0, 0.2, 11), [1.0, 0, 0])
    trajectory = Trajectory(t_us, positions_m, np.tile([0.0, 0, 0, 1], (11, 1)))
    with SequenceWriter(
        path, name="small", rig=rig, trajectory=trajectory, config={}, depth_range_m=(0.5, 4)
    ) as writer:
        rng = np.random.default_rng(5)
        for camera in (0, 1):
            t_us = np.sort(rng.integers(0, 100_000, 4000)).astype(np.int64)
            x, y = rng.integers(0, 40, 4000, np.uint16), rng.integers(0, 30, 4000, np.uint16)
            writer.append_events(camera, Events(x, y, t_us, (np.arange(4000) % 2).astype(np.uint8)))
            for truth_us in (0, 50_000, 100_000):
                image = np.full((30, 40), 2.0, np.float32)
                writer.append_truth(camera, truth_us, image, np.zeros((30, 40), np.uint8))
    return path
