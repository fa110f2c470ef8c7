"""From a scene to a sequence on disk."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.sim.config import FramesConfig, SimConfig
from eventsweep.sim.rendering.base import finer
from eventsweep.sim.rendering.drawing import decided, default_renderer, drawing_of
from eventsweep.sim.rigs import RIGS, rig
from eventsweep.sim.sampling import with_sampling
from eventsweep.sim.simulate import simulate
from programs import NARROW, python
from refusals import all_bytes, refused

CONFIG = SimConfig(truth_interval_s=0.01)


@pytest.fixture(scope="module")
def scene(folder):
    return made.noise_scene(folder)


@pytest.fixture(scope="module")
def sequence(folder, scene):
    return Sequence.open(simulate(scene, made.tiny_rig(), CONFIG, 0, folder / "first"))


def everything(sequence, camera):
    return sequence.events(camera, 0, sequence.trajectory.span_us[1] + 1)


def test_the_same_arguments_give_the_same_bytes(folder, scene, sequence):
    again = simulate(scene, made.tiny_rig(), CONFIG, 0, folder / "again")
    assert all_bytes(again) == all_bytes(sequence.path)
    sequence.verify()


@pytest.mark.slow
@pytest.mark.parametrize("processor", NARROW)
def test_a_processor_that_can_do_less_gives_the_same_bytes(processor, tmp_path):
    older = NARROW[processor] | {
        "OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    }  # fmt: skip
    for name, settings in (("own", {}), ("older", older)):
        env = {**settings, "EVENTSWEEP_CACHE": str(tmp_path / f"{name} textures")}
        asked = "--rig", "davis346", "--seconds", "0.01", "--seed", "0", "--out", tmp_path / name
        python("-m", "eventsweep", "simulate", "desk", *asked, env=env, check=True)
    own, other = (Sequence.open(tmp_path / name) for name in ("own", "older"))
    assert min(own.event_count(0), own.event_count(1)) > 4000
    assert other.manifest.digest() == own.manifest.digest()


def test_another_seed_is_another_motion(folder, scene, sequence):
    other = Sequence.open(simulate(scene, made.tiny_rig(), CONFIG, 1, folder / "seed1"))
    assert other.manifest.seed == 1
    assert not np.allclose(other.trajectory.positions_m, sequence.trajectory.positions_m)


def test_cameras_see_different_streams(sequence):
    left, right = everything(sequence, 0), everything(sequence, 1)
    assert min(len(left), len(right)) > 1000
    shared = min(len(left), len(right))
    assert not np.array_equal(left.t_us[:shared], right.t_us[:shared])
    assert not np.array_equal(left.x[:shared], right.x[:shared])


def test_events_lie_on_the_sensor_and_within_the_poses(sequence):
    first_us, last_us = sequence.trajectory.span_us
    assert (first_us, last_us) == (0, 50_000)
    for k, camera in enumerate(sequence.rig.cameras):
        events = everything(sequence, k).checked(camera.width_px, camera.height_px)
        assert len(events) == sequence.event_count(k)
        assert first_us < events.t_us[0]
        assert events.t_us[-1] <= last_us


def test_events_integrate_to_the_stored_frames(sequence):
    """Rounding to 8 bits costs half a grey level at each end."""
    for k, camera in enumerate(sequence.rig.cameras):
        first, last = (sequence.truth_intensity(k, t) / 255 for t in (0, 50_000))
        low, high = np.log(first + CONFIG.log_eps), np.log(last + CONFIG.log_eps)
        rounding = 0.5 / 255 * (1 / (first + CONFIG.log_eps) + 1 / (last + CONFIG.log_eps))
        events = everything(sequence, k)
        total = np.zeros((camera.height_px, camera.width_px))
        np.add.at(total, (events.y, events.x), np.where(events.p == 1, 0.2, -0.2))
        assert (np.abs(high - low - total) <= 0.2 + 1.2 * rounding).all()


def test_truth_holds_the_start_the_middle_the_end_and_the_right_depth(sequence):
    assert [t / 1000 for t in sequence.truth_times_us(0)] == [0, 10, 20, 25, 30, 40, 50]
    wall_m = 2.4
    for k, camera in enumerate(sequence.rig.cameras):
        T_world_cam = sequence.trajectory.at(25_000) @ sequence.rig.T_body_cam[k]
        depth_m = sequence.truth_depth_m(k, 25_000)
        rays = np.dstack([camera.bearing_table(), np.ones(depth_m.shape)]) @ T_world_cam[:3, :3].T
        reached = T_world_cam[:3, 3] + rays * depth_m[..., None]
        on_wall = np.abs(reached[..., 0] - wall_m) < 1e-5
        in_box = (np.abs(reached - (1, 0.1, 1)) < 0.1 + 1e-5).all(-1)
        assert (on_wall | in_box).all()
        assert on_wall.any()
        assert in_box.any()


def test_the_manifest_says_how_it_was_made(scene, sequence):
    manifest = sequence.manifest
    assert manifest.name == "noise"
    drawn = decided(scene.configured(CONFIG))
    assert SimConfig(**manifest.configuration) == with_sampling(
        drawn, sequence.rig, finer=finer(drawing_of(drawn))
    )
    assert manifest.renderer.startswith(f"{default_renderer()}, mujoco 4".removeprefix("mujoco, "))
    assert manifest.depth_range_m == (0.7, 3.0)


def test_progress_ends_at_the_end(folder, scene):
    calls = []
    simulate(
        scene, made.tiny_rig(), CONFIG.model_copy(update={"duration_s": 0.01}), 0,
        folder / "progress", progress=lambda *call: calls.append(call),
    )  # fmt: skip
    stages, done, total = zip(*calls, strict=True)
    assert (set(stages), done[0], done[-1], set(total)) == ({"simulate"}, 0, 10_000, {10_000})
    assert list(done) == sorted(set(done))


def test_an_existing_folder_is_kept_without_force(folder, scene, sequence):
    before = all_bytes(sequence.path)
    refused("first", simulate, scene, made.tiny_rig(), CONFIG, 1, sequence.path)
    assert all_bytes(sequence.path) == before


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_interrupted_run_leaves_nothing(folder, scene, error):
    out = folder / "interrupted"
    before = set(folder.iterdir())

    def stop(_stage, done_us, _total_us):
        if done_us > 10_000:
            raise error

    with pytest.raises(error):
        simulate(scene, made.tiny_rig(), CONFIG, 0, out, progress=stop)
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize(("config", "seed", "words"), [
    (CONFIG, -1, "seed -1"), (SimConfig(duration_s=1e-7), 0, "duration_s"),
    (SimConfig(max_displacement_px=0.5, min_frame_interval_us=9_000), 0, "slow the motion"),
    (SimConfig(frames=FramesConfig(rate_hz=200, exposure_us=5_001)), 0, "lower the rate"),
    (SimConfig(truth_times_s=(0.06,)), 0, r"0.06 s, but the sequence lasts 0.05 s"),
])  # fmt: skip
def test_what_cannot_be_simulated_leaves_nothing(folder, scene, config, seed, words):
    before = set(folder.iterdir())
    refused(words, simulate, scene, made.tiny_rig(), config, seed, folder / "bad")
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize(("change", "words"), [
    ({"textures": lambda: {"stone": np.zeros((4, 4, 3), np.uint8)}}, "it has: noise"),
    ({"textures": lambda: {"noise": np.zeros((4, 4), np.uint8)}}, "needs uint8"),
    ({"mjcf": Path("none.xml")}, "has no file"),
])  # fmt: skip
def test_textures_must_fit_the_mjcf(scene, change, words):
    refused(words, replace(scene, **change).spec)


def test_named_rigs_are_what_their_names_say():
    refused(r"davis346, .*tumvie", rig, "davis")
    assert (rig("davis346").cameras[0].width_px, rig("davis346").cameras[0].height_px) == (346, 260)
    assert rig("davis346").baseline_m() == pytest.approx(0.10)
    assert (rig("tumvie").cameras[1].width_px, rig("tumvie").cameras[1].height_px) == (1280, 720)
    assert rig("tumvie").baseline_m() == pytest.approx(0.1184)
    for known in RIGS.values():
        centres = {(camera.cx_px, camera.cy_px) for camera in known.cameras}
        assert len(centres) == len(known) >= 2
        assert np.array_equal(known.T_body_cam[0], np.eye(4))
