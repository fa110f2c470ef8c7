"""Perturbs a recording on purpose: poses, clocks, calibration, events; the truth stays as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from emvs.data.events import Events
from emvs.data.recording import DerivedRecording, Recording
from emvs.geometry import se3
from emvs.geometry.camera import Camera
from emvs.geometry.rig import Rig
from emvs.geometry.trajectory import Trajectory
from eval.studies.perturbation import Perturbation
from eval.studies.poses import perturbed_trajectory


class PerturbedRecording(DerivedRecording):
    """A recording as a careless user would hand it in.

    Attributes:
        perturbation: what is wrong, and by how much.
        seed: of the random parts.
    """

    def __init__(self, recording: Recording, perturbation: Perturbation, seed: int) -> None:
        super().__init__(recording)
        self.perturbation, self.seed = perturbation, seed

    @property
    def rig(self) -> Rig:
        """The calibration with its errors."""
        return perturbed_rig(self.recording.rig, self.perturbation)

    @property
    def trajectory(self) -> Trajectory:
        """The poses with their errors."""
        return perturbed_trajectory(self.recording.trajectory, self.perturbation, self.seed)

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us` on its own clock."""
        delay_us = self._delay_us(camera)
        events = self.recording.events(camera, t0_us - delay_us, t1_us - delay_us)
        kept = thinned(events, self.perturbation.keep_events, self.seed + camera)
        return replace(kept, t_us=kept.t_us + delay_us)

    def _delay_us(self, camera: int) -> int:
        return round(1e3 * self.perturbation.camera_delay_ms) if camera == 1 else 0


def perturbed_rig(rig: Rig, amount: Perturbation) -> Rig:
    """The calibration with its errors: all intrinsics, and the extrinsics of camera 1."""
    cameras = tuple(_perturbed_camera(camera, amount) for camera in rig.cameras)
    T_body_cam = list(rig.T_body_cam)
    if len(rig) > 1:
        T_0_1 = se3.inverse(T_body_cam[0]) @ T_body_cam[1]
        angles_deg = [amount.stereo_pitch_deg, amount.stereo_yaw_deg, 0]
        turn = se3.from_rotation(Rotation.from_euler("xyz", angles_deg, degrees=True), np.zeros(3))
        T_0_1[:3, 3] *= 1 + amount.baseline_percent / 100
        T_body_cam[1] = T_body_cam[0] @ T_0_1 @ turn
    return replace(rig, cameras=cameras, T_body_cam=tuple(T_body_cam))


def _perturbed_camera(camera: Camera, amount: Perturbation) -> Camera:
    scale = 1 + amount.focal_percent / 100
    return replace(
        camera,
        fx_px=camera.fx_px * scale,
        fy_px=camera.fy_px * scale,
        cx_px=camera.cx_px + amount.centre_px,
    )


def thinned(events: Events, share: float, seed: int) -> Events:
    """Keeps a share of the events, the same ones however the stream is cut into slices."""
    if share >= 1:
        return events
    kept = _uniform(events, seed) < share
    return Events(events.x[kept], events.y[kept], events.t_us[kept], events.p[kept])


def _uniform(events: Events, seed: int) -> NDArray[np.float64]:
    """A number in [0, 1) that each event's own values decide (SplitMix64, Steele et al. 2014)."""
    place = (events.x.astype(np.uint64) << np.uint64(17)) | (
        events.y.astype(np.uint64) << np.uint64(1)
    )
    state = events.t_us.astype(np.uint64) ^ (
        (place | events.p.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
    )
    state += np.uint64((seed + 1) * 0x9E3779B97F4A7C15 % 2**64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor)
    state ^= state >> np.uint64(31)
    return (state >> np.uint64(11)).astype(np.float64) * 2.0**-53
