"""Writes MVSEC's file of ground truth: poses and depth of the left camera."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from emvs.data.recording import Recording
from emvs.data.sequence import Sequence
from emvs.data.trajectory import Trajectory


def write_truth(path: Path, recording: Recording, poses: Trajectory, shift_us: int) -> None:
    """Writes poses, and raw depth where the recording holds the sensor's own.

    Args:
        path: the new HDF5 file.
        recording: a sequence of ours gives depth on the distorted sensor; others give none.
        poses: `T_world_cam` of the left camera, on the file's clock.
        shift_us: from the recording's clock to the file's, µs.
    """
    with h5py.File(path, "w") as file:
        file["davis/left/pose"] = poses.at(poses.t_us)
        file["davis/left/pose_ts"] = poses.t_us / 1e6
        if not isinstance(recording, Sequence):
            return
        camera = recording.rig.cameras[0]
        times_us = recording.truth_times_us(0)
        shape = (len(times_us), camera.height_px, camera.width_px)
        if not len(times_us):
            return
        data = file.create_dataset(
            "davis/left/depth_image_raw", shape, np.float32, chunks=(1, *shape[1:])
        )
        for k, t_us in enumerate(times_us):
            data[k] = recording.truth_depth_m(0, int(t_us))
        file["davis/left/depth_image_raw_ts"] = (times_us + shift_us) / 1e6
