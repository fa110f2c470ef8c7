"""How sharp DSIs are: the kernel against its slow twin; the highest is where all is true."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose import sharpness_kernels
from eventsweep.plugins.diagnose.parameters import with_second
from eventsweep.plugins.diagnose.sharpness import Hypothesis, Level, Sharpness, WindowEvents
from naive_sharpness import naive_ray_maxima
from point_world import fronto_parallel, stereo_rig
from refusals import refused

T0_US, T1_US = 100_000, 300_000


@pytest.fixture(scope="module")
def recording():
    return fronto_parallel(1.2, points=200)


def sharpness(recording, planes=24, **changed):
    said = Hypothesis(recording.rig, recording.trajectory, **changed)
    return Sharpness((0.5, 4.0), Level(1, planes))([window_of(recording)], [said]).item()


@pytest.mark.parametrize("cameras", [1, 2, 3])
def test_the_kernel_does_what_its_slow_twin_does(cameras):
    rng = np.random.default_rng(cameras)
    width, height, rho = 24, 16, np.linspace(1.5, 0.2, 5).astype(np.float32)
    rays = [
        [(rng.uniform(-2, 25, 300)), rng.normal(0, 2, 300), rng.uniform(-2, 17, 300),
         rng.normal(0, 2, 300), rng.uniform(-1, 1.5, 300)]
        for _ in range(2 * cameras)
    ]  # fmt: skip
    rays = [[column.astype(np.float32) for column in columns] for columns in rays]
    best = np.empty((2, width * height), np.float32)
    sharpness_kernels.ray_maxima(
        *map(np.concatenate, zip(*rays, strict=True)),
        300 * (cameras * np.arange(2)[:, None] + np.arange(cameras + 1)), rho, width, height,
        np.empty((2, cameras, width * height), np.float32), best,
    )  # fmt: skip
    for window in range(2):
        of_window = rays[cameras * window : cameras * (window + 1)]
        expected = naive_ray_maxima(of_window, rho, width, height)
        assert np.allclose(best[window].reshape(height, width), expected, atol=1e-4)
        assert best[window].max() > 0


def window_of(recording):
    events = tuple(recording.events(k, T0_US, T1_US) for k in range(len(recording.rig)))
    return WindowEvents(T0_US, T1_US, events)


def test_it_is_the_mean_of_the_largest_ray_maxima(recording):
    window, hypothesis = window_of(recording), Hypothesis(recording.rig, recording.trajectory)
    measure = Sharpness((0.5, 4.0), Level(1, 24))
    best = np.sort(measure.ray_maxima([window], [hypothesis]).ravel())
    assert measure([window], [hypothesis]) == pytest.approx(best[-round(0.01 * best.size) :].mean())


@pytest.mark.parametrize("late_us", [-20_000, 20_000])
def test_a_late_camera_makes_the_fused_volume_less_sharp(recording, late_us):
    assert sharpness(recording, clock_us=(0, late_us)) < 0.9 * sharpness(recording)
    late = AlteredRecording(recording, clock_us=(0, late_us))
    held = [recording.events(0, T0_US, T1_US), late.events(1, T0_US + late_us, T1_US + late_us)]
    window = WindowEvents(T0_US - 50_000, T1_US + 50_000, tuple(held))
    changed = Hypothesis(recording.rig, recording.trajectory)
    assert Sharpness((0.5, 4.0), Level(1, 24))([window], [changed]).item() == sharpness(
        recording, clock_us=(0, late_us)
    )


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_a_wrong_baseline_makes_the_fused_volume_less_sharp(recording, share):
    changed = AlteredRecording(recording, rig=stereo_rig(recording.rig.cameras[0], 0.1 * share))
    assert sharpness(changed) < 0.9 * sharpness(recording)


def turned_away(recording, angle_deg):
    """The second camera turned about its vertical."""
    turn = se3.from_rotation(Rotation.from_euler("y", angle_deg, degrees=True), np.zeros(3))
    return with_second(recording, lambda T: T @ turn)


@pytest.mark.parametrize("depth_m", [0.5, 4.0])
def test_what_lies_at_an_end_of_the_depth_range_falls_off_alike_to_both_sides(depth_m):
    """A yaw that moves it beyond the last plane is no worse than one that moves it nearer."""
    world = fronto_parallel(depth_m, points=400)
    truth = sharpness(world, planes=96)
    left, right = (sharpness(turned_away(world, a), planes=96) / truth for a in (-0.3, 0.3))
    assert left < 0.96
    assert left == pytest.approx(right, abs=0.02)


def test_one_camera_is_its_own_volume(recording):
    rig = replace(recording.rig, cameras=recording.rig.cameras[:1], camera_names=("cam0",),
                  T_body_cam=recording.rig.T_body_cam[:1])  # fmt: skip
    alone = replace(recording, rig=rig, streams=recording.streams[:1])
    twice = replace(recording, rig=replace(recording.rig, T_body_cam=rig.T_body_cam * 2),
                    streams=recording.streams[:1] * 2)  # fmt: skip
    assert sharpness(alone) == pytest.approx(sharpness(twice), rel=1e-5)


def test_a_window_without_poses_is_refused(recording):
    poses = recording.trajectory
    later = Trajectory(poses.t_us + 10_000_000, poses.positions_m, poses.quats_xyzw)
    refused("poses", sharpness, replace(recording, trajectory=later))
