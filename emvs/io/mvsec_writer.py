"""Writes MVSEC's file of ground truth: poses and depth of the left camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from emvs.data.hdf5 import Hdf5Writer
from emvs.data.recording import Recording
from emvs.data.sequence import Sequence
from emvs.geometry.trajectory import Trajectory


def write_truth(path: Path, recording: Recording, poses: Trajectory, shift_us: int) -> None:
    """Writes poses, and raw depth where the recording holds the sensor's own.

    Args:
        path: the new HDF5 file.
        recording: a sequence of ours gives depth on the distorted sensor; others give none.
        poses: `T_world_cam` of the left camera, on the file's clock.
        shift_us: from the recording's clock to the file's, µs.
    """
    with Hdf5Writer(path) as hdf5:
        hdf5.file["davis/left/pose"] = poses.at(poses.t_us)
        hdf5.file["davis/left/pose_ts"] = poses.t_us / 1e6
        hdf5.check()
        if isinstance(recording, Sequence) and len(recording.truth_times_us(0)):
            _write_depth(hdf5, recording, shift_us)


def _write_depth(hdf5: Hdf5Writer, sequence: Sequence, shift_us: int) -> None:
    camera, times_us = sequence.rig.cameras[0], sequence.truth_times_us(0)
    shape = (len(times_us), camera.height_px, camera.width_px)
    name, chunks = "davis/left/depth_image_raw", (1, *shape[1:])
    data = hdf5.file.create_dataset(name, shape, np.float32, chunks=chunks)
    for k, t_us in enumerate(times_us):
        data[k] = sequence.truth_depth_m(0, int(t_us))
        hdf5.check()
    hdf5.file[f"{name}_ts"] = (times_us + shift_us) / 1e6
