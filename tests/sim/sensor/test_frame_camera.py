"""Pictures of ordinary cameras in a sequence: the light of the events, whole, and once."""

import hashlib
import os
from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from scipy.special import erf

import mujoco_scenes as made
from eventsweep.emvs.data.image_stores import FrameReader, FrameWriter, Photo
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.sim.config import FramesConfig, ImuConfig, SimConfig
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.rendering.drawing import drawing_of
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.sensor.frame_camera import (
    Exposure,
    FrameCamera,
    blurred,
    develop,
    exposure_spans_us,
    gain_for,
)
from eventsweep.sim.simulate import make_job, simulate
from mujoco_scenes import Killed, stop_at
from refusals import all_bytes, refused
from sensor_runs import captured_light, mean_light

# The shutter is open across chunks, parts and truth times.
FRAMES = FramesConfig(rate_hz=100, exposure_us=9_000)
CONFIG = SimConfig(truth_interval_s=0.007, frames=FRAMES)


@pytest.fixture(scope="module")
def whole(folder, scene):
    return simulate(scene, made.tiny_rig(), CONFIG, 0, folder / "whole")


def test_a_stored_picture_is_the_light_of_the_frames_that_made_the_events(scene, whole):
    """Bit by bit; and what frames at other times give, to a grey level."""
    sequence, job = (
        Sequence.open(whole),
        make_job(scene, made.tiny_rig(), CONFIG, 0, drawing_of(CONFIG)),
    )
    assert sequence.photo_times_us(1).tolist() == [10_000, 20_000, 30_000, 40_000]
    with job.renderer() as renderer:
        taken = []
        for k in range(job.chunks):
            stops_us = list(job.bounds_us[k : k + 2])
            taken += list(adaptive_frames(renderer, job.motion(), stops_us, CONFIG))[k > 0 :]
        for camera in range(2):
            frames = [(e.t_us, e.frames[camera].intensity) for e in taken]
            for t_us in (10_000, 30_000):
                photo = sequence.photo(camera, t_us)
                assert (photo.start_us, photo.end_us) == (t_us - 4_500, t_us + 4_500)
                light = mean_light(frames, photo.start_us, photo.end_us)
                assert photo.gain == gain_for(light, FRAMES)
                assert np.array_equal(photo.image, develop(light, photo.gain))
                other = captured_light(
                    renderer, job.motion(), camera, photo.start_us, CONFIG, FRAMES.exposure_us
                )
                off = np.abs(photo.image.astype(int) - develop(other, photo.gain))
                assert np.mean(off) < 0.5
                assert np.mean(off > 1) < 0.02


def test_events_and_truth_do_not_depend_on_the_pictures(folder, scene, whole):
    without = CONFIG.model_copy(update={"frames": FramesConfig(rate_hz=0)})
    other = all_bytes(simulate(scene, made.tiny_rig(), without, 0, folder / "without"))
    with_them = all_bytes(whole)
    photos = {f"cam{k}/frames.h5" for k in range(2)}
    assert with_them.keys() - other.keys() == photos
    differ = {name for name in other if other[name] != with_them[name]}
    assert differ == {"manifest.json"}


@pytest.mark.parametrize(
    ("t_us", "workers"), [pytest.param(7_500, 2, marks=pytest.mark.slow), (15_000, 1), (31_000, 1)]
)
def test_a_stopped_run_goes_on_with_the_shutter_open(folder, scene, whole, t_us, workers):
    """Two workers take the same pictures, from the first on: the shutter opens at 5.5 ms."""
    out = folder / f"stopped{t_us}"
    with pytest.raises(Killed):
        simulate(scene, made.tiny_rig(), CONFIG, 0, out, commit_s=0, progress=stop_at(t_us))
    simulate(scene, made.tiny_rig(), CONFIG, 0, out, workers=workers)
    assert all_bytes(out) == all_bytes(whole)


@given(st.floats(1, 2_000), st.integers(1, 3_000), st.integers(2, 200_000))
def test_exposures_are_whole_apart_and_centred_on_the_interval(rate_hz, exposure_us, duration_us):
    frames = FramesConfig(rate_hz=rate_hz, exposure_us=exposure_us)
    if exposure_us > 1e6 / rate_hz:
        refused("expose for less", exposure_spans_us, frames, duration_us)
        return
    spans = exposure_spans_us(frames, duration_us)
    flat = [t for span in spans for t in span]
    assert all(end - start == exposure_us for start, end in spans)
    assert all(0 <= t <= duration_us for t in flat)
    assert all(before[1] <= after[0] for before, after in pairwise(spans))
    for start, _ in spans:
        middle = (start + exposure_us // 2) * rate_hz / 1e6
        assert abs(middle - round(middle)) <= rate_hz / 1e6


@given(st.lists(st.integers(1, 4_000), min_size=1, max_size=40), st.integers(1, 10_000))
def test_streamed_pictures_are_those_of_the_whole_light(steps_us, cut):
    """Whatever the frames' times are, and wherever the camera is taken out and put back."""
    frames = FramesConfig(rate_hz=400, exposure_us=2_500)  # one ends where the next begins
    times_us = [0, *np.cumsum(steps_us).tolist()]
    rng = np.random.default_rng(cut)
    lights = [(t, rng.random((2, 3), np.float32)) for t in times_us]
    taken, camera = [], FrameCamera(frames, times_us[-1], None)
    for index, (t_us, light) in enumerate(lights):
        taken += camera.take(t_us, (light, 2 * light))
        if index == cut % len(lights):
            camera = FrameCamera(frames, times_us[-1], {**camera.state()})
    spans = exposure_spans_us(frames, times_us[-1])
    assert [(p.start_us, p.end_us) for p, _ in taken] == spans
    for photos in taken:
        for photo, factor in zip(photos, (1, 2), strict=True):
            scaled = [(t, factor * light) for t, light in lights]
            light = mean_light(scaled, photo.start_us, photo.end_us)
            assert np.array_equal(photo.image, develop(light, gain_for(light, frames)))


def test_pictures_are_taken_through_the_sensors_lens():
    frames = FramesConfig(rate_hz=400, exposure_us=2_500, gain=1.0)
    light = np.random.default_rng(0).random((20, 30), np.float32)
    sharp, blurry = (FrameCamera(frames, 10_000, None, sigma_px) for sigma_px in (0.0, 1.2))
    for camera in (sharp, blurry):
        camera.take(0, (light,))
    (photo,), *_ = blurry.take(10_000, (light,))
    assert np.array_equal(photo.image, develop(blurred(light, 1.2)))
    assert np.array_equal(sharp.take(10_000, (light,))[0][0].image, develop(light))


def test_automatic_gain_meets_the_level_and_leaves_the_dark_dark():
    light = np.random.default_rng(1).lognormal(0, 2, (50, 50)).astype(np.float32)
    gain = gain_for(light, FramesConfig(auto_percentile=80, auto_level=0.6))
    assert np.percentile(gain * light, 80) == pytest.approx(0.6)
    assert gain_for(0 * light, FramesConfig(auto_max_gain=50)) == pytest.approx(50)
    assert gain_for(light, FramesConfig(gain=3)) == 3


def test_a_scene_says_whether_there_are_pictures_and_its_user_has_the_last_word(scene):
    lit = replace(scene, frames_rate_hz=40)
    assert scene.configured(SimConfig()).frames.rate_hz == 0
    assert lit.configured(SimConfig()).frames.rate_hz == 40
    assert lit.configured(SimConfig(frames=FramesConfig(rate_hz=0))).frames.rate_hz == 0


def test_a_sequence_without_pictures_or_imu_says_how_to_get_them(folder, scene):
    config = SimConfig(duration_s=0.002, imu=ImuConfig(rate_hz=0))
    sequence = Sequence.open(simulate(scene, made.tiny_rig(), config, 0, folder / "none"))
    assert sequence.photo_times_us(0).tolist() == []
    refused(r"frames\.rate_hz", sequence.photo, 0, 0)
    assert not sequence.has_imu
    refused(r"imu\.rate_hz", sequence.imu)


IMAGE = np.arange(12, dtype=np.uint8).reshape(3, 4) * 23


def test_pictures_read_back(tmp_path):
    with FrameWriter(tmp_path / "f.h5", 4, 3) as writer:
        writer.append(Photo(0, 10, 0.5, IMAGE))
        writer.append(Photo(10, 21, 2.0, 255 - IMAGE))
    reader = FrameReader(tmp_path / "f.h5")
    assert len(reader) == 2
    assert reader.t_us.tolist() == [5, 15]
    second = reader.photo(1)
    assert second[:3] == (10, 21, 2.0)
    assert np.array_equal(second.image, 255 - IMAGE)
    assert (reader.photo(0).black, second.white) == (1 / 12, 1 / 12)


@pytest.mark.parametrize(
    "photo",
    [Photo(9, 20, 1, IMAGE), Photo(30, 29, 1, IMAGE), Photo(10, 20, 1, IMAGE[:2])],
)
def test_pictures_that_do_not_fit_are_refused(tmp_path, photo):
    with FrameWriter(tmp_path / "f.h5", 4, 3) as writer:
        writer.append(Photo(0, 10, 1.0, IMAGE))
        refused("", writer.append, photo)


def of_another_layout(path):
    with h5py.File(path, "w") as file:
        file["image"] = IMAGE


DAMAGES = {
    "missing": lambda path: path.unlink(), "empty": lambda path: path.write_bytes(b""),
    "truncated": lambda path: os.truncate(path, path.stat().st_size // 2),
    "other": of_another_layout,
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_are_refused(tmp_path, damage):
    path = tmp_path / "f.h5"
    with FrameWriter(path, 4, 3) as writer:
        writer.append(Photo(0, 10, 1.0, IMAGE))
    DAMAGES[damage](path)
    refused("", FrameReader, path)


def test_the_imu_rides_on_the_same_motion(scene, whole):
    sequence = Sequence.open(whole)
    sequence.verify()
    samples = sequence.imu()
    assert samples.t_us.tolist() == list(range(0, 50_001, 5_000))
    assert "imu.csv" in sequence.manifest.files
    digest = hashlib.sha256((whole / "imu.csv").read_bytes()).hexdigest()
    assert sequence.manifest.files["imu.csv"].sha256 == digest
    poses = sequence.trajectory.at(samples.t_us[1:-1])
    later = sequence.trajectory.at(samples.t_us[1:-1] + 1_000)
    turned = np.swapaxes(poses[:, :3, :3], 1, 2) @ later[:, :3, :3]
    rate = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / 1e-3
    np.testing.assert_allclose(samples.gyro_rad_s[1:-1], rate, atol=0.03)


def taken_at(times_us):
    rng = np.random.default_rng(0)
    return [(t_us, rng.random((4, 5), np.float32)) for t_us in times_us]


def test_mean_light_is_the_integral_of_what_is_linear_between_frames():
    taken = taken_at([0, 30, 100, 170, 171, 400])
    fine = np.arange(50, 350) + 0.5
    values = [[np.interp(fine, [t for t, _ in taken], [f[i, j] for _, f in taken]).mean()
               for j in range(5)] for i in range(4)]  # fmt: skip
    np.testing.assert_allclose(mean_light(taken, 50, 350), values, atol=1e-4)


def test_exposures_add_up():
    taken = taken_at([0, 37, 90, 200])
    whole, first, second = (mean_light(taken, *span) for span in [(5, 180), (5, 60), (60, 180)])
    np.testing.assert_allclose(175 * whole, 55 * first + 120 * second, rtol=1e-5)


def test_steady_light_stays_what_it_is():
    refused("must close later", Exposure, 5, 5)
    steady = np.float32([[0, 0.25, 3e4]])
    assert np.array_equal(mean_light([(0, steady), (7, steady), (20, steady)], 3, 19), steady)


def test_development_quantises_and_saturates():
    light = np.float32([[0, 0.001, 0.5, 0.999, 1.0, 40.0]])
    assert develop(light).tolist() == [[0, 0, 128, 255, 255, 255]]
    assert develop(light, gain=100).tolist() == [[0, 26, 255, 255, 255, 255]]
    assert set(develop(light, bits=1).ravel()) == {0, 255}


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


@pytest.mark.parametrize("sigma_px", [0.4, 0.8, 2.5])
def test_light_is_kept_and_the_twin_agrees(sigma_px):
    light = np.random.default_rng(2).random((23, 31), np.float32)
    assert blurred(light, 0.0) is light
    out = blurred(light, sigma_px)
    assert out.dtype == np.float32
    assert out.sum() == pytest.approx(light.sum(), rel=1e-5)
    twin = gaussian_filter(light.astype(float), sigma_px, mode="reflect", truncate=4)
    np.testing.assert_allclose(out, twin, atol=2e-3)


def test_an_edge_becomes_the_integral_of_the_point_spread_function():
    sigma_px, x = 2.0, np.arange(40)
    edge = np.repeat((x >= 20).astype(np.float32)[None], 5, 0)
    expected = 0.5 * (1 + erf((x - 19.5) / (sigma_px * np.sqrt(2))))
    np.testing.assert_allclose(blurred(edge, sigma_px)[2], expected, atol=5e-3)
