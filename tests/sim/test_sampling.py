"""How finely scenes are drawn: by focal length, and not where light cannot be carried."""

from dataclasses import replace

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep import scenes
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.base import finer
from eventsweep.sim.rendering.drawing import MUJOCO, drawing_of
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
from eventsweep.sim.sampling import border_px, with_sampling
from eventsweep.sim.simulate import simulate
from refusals import all_bytes

RANGE_M = (0.7, 3.0)


def rig_of(camera: Camera) -> Rig:
    return Rig("one", (camera,), (np.eye(4),))


@pytest.mark.parametrize(
    ("name", "accurate", "fast", "cheap"),
    [("davis346", 6, 4, 8), ("tumvie", 3, 2, 3), ("dsec", 4, 2, 4), ("mvsec", 6, 4, 8)],
)
def test_samples_go_by_the_angle_of_a_pixel(name, accurate, fast, cheap):
    for sampling, expected in (("accurate", accurate), ("fast", fast), ("linear", 2)):
        filled = with_sampling(SimConfig(sampling=sampling), rig(name))
        assert filled.supersample == expected
        assert filled.max_displacement_px == (0.5 if sampling == "linear" else 12.0)
    assert with_sampling(SimConfig(supersample=5), rig(name), finer=4 / 3).supersample == 5
    assert with_sampling(SimConfig(), rig(name), finer=4 / 3).supersample == cheap


@pytest.mark.parametrize("focal_px", [150, 230, 300, 450, 640, 700, 1100])
def test_rows_of_samples_can_lie_beside_one_another_unless_they_are_the_fewest(focal_px):
    one = rig_of(Camera(40, 30, focal_px, focal_px, 19.5, 14.5))
    eight_bits, floats = (
        with_sampling(SimConfig(), one, floats=floats).supersample for floats in (False, True)
    )
    assert eight_bits % 2 == 0 or eight_bits == 3
    assert floats >= eight_bits
    assert eight_bits >= min(1300 / focal_px, 8)
    plain = with_sampling(SimConfig(), one, "a surface is reflective")
    assert (plain.sampling, plain.supersample) == ("linear", eight_bits)


def lit_by_the_head(spec):
    spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]


def test_light_is_carried_but_where_a_mirror_or_a_lamp_on_the_head_forbids(tmp_path):
    assert MUJOCO.why_plain(made.noise_scene(tmp_path)) == ""
    assert "lamp" in MUJOCO.why_plain(replace(made.noise_scene(tmp_path), edit=lit_by_the_head))
    assert "mirrors" in MUJOCO.why_plain(scenes.load("reflective"))


def test_a_scene_with_a_lamp_on_the_head_is_simulated_with_plain_frames_and_says_so(tmp_path):
    scene = replace(made.noise_scene(tmp_path), edit=lit_by_the_head)
    config, heard = SimConfig(duration_s=0.01, max_displacement_px=4.0), []
    simulate(scene, made.tiny_rig(), config, 0, tmp_path / "asked", notice=heard.append)
    assert heard == ["rendering plain frames half a pixel apart: there is a lamp on the head"]
    times = finer(drawing_of(SimConfig()))
    samples = with_sampling(SimConfig(), made.tiny_rig(), finer=times).supersample
    linear = SimConfig(duration_s=0.01, sampling="linear", supersample=samples)
    simulate(scene, made.tiny_rig(), linear, 0, tmp_path / "linear", notice=heard.append)
    assert len(heard) == 1
    assert all_bytes(tmp_path / "asked") == all_bytes(tmp_path / "linear")


def test_plain_frames_are_pixels_of_fine_ones():
    """The same samples, but for the sharpness of textures: flat colours tell nothing of it."""
    body = np.eye(4)
    with StereoRenderer(made.spec(made.BOXES), made.small_rig(), 4, RANGE_M) as plain:
        expected = plain.frame(0, body)
    with StereoRenderer(made.spec(made.BOXES), made.small_rig(), 4, RANGE_M, border_px=5) as fine:
        found = fine.frame(0, body)
        depth_m = fine.depth(0, body)
    np.testing.assert_allclose(found.intensity, expected.intensity, atol=2e-3)
    assert np.mean(found.nearest_depth_m == expected.nearest_depth_m) > 0.99
    assert found.samples.light.shape == (4 * (120 + 10), 4 * (160 + 10))
    assert depth_m.shape == (120, 160)
    assert expected.samples is None


def test_frames_reach_as_far_beyond_the_sensor_as_light_is_carried():
    assert border_px(SimConfig()) == 14
    assert border_px(SimConfig(max_displacement_px=2.5)) == 5
    assert border_px(SimConfig(sampling="linear")) is None


@pytest.mark.parametrize("preset", ["ideal", "davis346"])
def test_fine_frames_far_apart_show_the_world_that_many_close_ones_do(tmp_path, preset):
    """Many: 8 x 8 samples, 0.1 px apart; plain frames of 2 x 2 samples miss that world by more."""
    scene, found = made.noise_scene(tmp_path), {}
    ways = {
        "many": {"sampling": "linear", "supersample": 8, "max_displacement_px": 0.1},
        "plain": {"sampling": "linear"},
        "fine": {},
    }
    for way, settings in ways.items():
        config = SimConfig(duration_s=0.04, sensor={"preset": preset}, **settings)
        simulate(scene, made.tiny_rig(), config, 0, tmp_path / way)
        found[way] = Sequence.open(tmp_path / way).events(0, 0, 40_001)
    true = len(found["many"])
    off = {way: abs(len(events) - true) / true for way, events in found.items()}
    near = {way: matched(events, found["many"]) for way, events in found.items()}
    assert true > 800
    assert off["fine"] < (0.03 if preset == "ideal" else 0.06)
    assert off["fine"] < off["plain"]
    assert near["fine"] > near["plain"] + 0.1


def test_frame_cameras_see_the_motion_between_fine_frames(tmp_path):
    """Two cameras that move unequally; against plain frames, of so many samples."""
    scene, photos = made.noise_scene(tmp_path), {}
    for sampling in ("accurate", "linear"):
        config = SimConfig(
            duration_s=0.05, sampling=sampling, supersample=6, frames={"rate_hz": 40, "gain": 1.0}
        )
        simulate(scene, made.small_rig(), config, 0, tmp_path / sampling)
        recording = Sequence.open(tmp_path / sampling)
        photos[sampling] = [recording.frame(k, 25_000) for k in (0, 1)]
    for found, expected in zip(*photos.values(), strict=True):
        apart = np.abs(found.astype(int) - expected.astype(int))
        assert np.mean(apart) < 1
        assert np.quantile(apart, 0.99) <= 4


def matched(found: Events, true: Events) -> float:
    """Share of the true events with one of the same pixel and polarity within 1 ms."""
    places = [2 * (48 * events.y.astype(int) + events.x) + events.p for events in (found, true)]
    return float(
        np.mean(
            [
                np.abs(found.t_us[places[0] == place] - t_us).min(initial=10**6) <= 1000
                for place, t_us in zip(places[1], true.t_us, strict=True)
            ]
        )
    )
