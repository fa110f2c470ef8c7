"""A frame camera's pictures: integrals of light, saturation, quantisation, blur."""

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.sim.config import ShutterConfig, SimConfig
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.sensor.frame_camera import Exposure, develop
from refusals import refused
from sensor_runs import captured_light, mean_light


def frames(times_us):
    rng = np.random.default_rng(0)
    return [(t_us, rng.random((4, 5), np.float32)) for t_us in times_us]


def test_mean_light_is_the_integral_of_what_is_linear_between_frames():
    taken = frames([0, 30, 100, 170, 171, 400])
    fine = np.arange(50, 350) + 0.5
    values = [[np.interp(fine, [t for t, _ in taken], [f[i, j] for _, f in taken]).mean()
               for j in range(5)] for i in range(4)]  # fmt: skip
    np.testing.assert_allclose(mean_light(taken, 50, 350), values, atol=1e-4)


def test_exposures_add_up():
    taken = frames([0, 37, 90, 200])
    whole, first, second = (mean_light(taken, *span) for span in [(5, 180), (5, 60), (60, 180)])
    np.testing.assert_allclose(175 * whole, 55 * first + 120 * second, rtol=1e-5)


def test_steady_light_stays_what_it_is():
    steady = np.float32([[0, 0.25, 3e4]])
    assert np.array_equal(mean_light([(0, steady), (7, steady), (20, steady)], 3, 19), steady)


def test_development_quantises_and_saturates():
    light = np.float32([[0, 0.001, 0.5, 0.999, 1.0, 40.0]])
    assert develop(light, ShutterConfig()).tolist() == [[0, 0, 128, 255, 255, 255]]
    assert develop(light, ShutterConfig(gain=100)).tolist() == [[0, 26, 255, 255, 255, 255]]
    assert set(develop(light, ShutterConfig(bits=1)).ravel()) == {0, 255}


def test_a_shutter_that_closes_before_it_opens_is_refused():
    refused("must close later", Exposure, 5, 5)


def test_a_moving_edge_is_smeared_over_the_distance_it_moves(tmp_path):
    """A bright card under sideways motion: the edge's ramp is as wide as the motion, in pixels."""
    card = np.array([[2, -1, z] for z in (0.0, 2.0)] + [[2, 1.0, z] for z in (2.0, 0.0)])
    level = look_at((0, 0, 1), (2, 0, 1))
    rig = made.tiny_rig()
    moving = HeadSway(level, (), (1.0, 0.0, 0.0))
    config = SimConfig(max_displacement_px=0.25)
    with StereoRenderer(made.card_spec(card), rig, 4, (0.5, 8)) as renderer:
        lights = [captured_light(renderer, moving, 0, 0, config, t) for t in (300_000, 1_000)]
    moved_px = 0.3 / 2 * rig.cameras[0].fx_px
    row = [light[18].astype(float) for light in lights]
    ramp_px = [1 / np.abs(np.diff(r)).max() for r in row]
    assert ramp_px[0] == pytest.approx(moved_px, rel=0.05)
    assert ramp_px[1] < 2.5
