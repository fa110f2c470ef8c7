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

import mujoco_scenes as made
from eventsweep.emvs.data.image_stores import FrameReader, FrameWriter, Photo
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.sim.config import FramesConfig, ImuConfig, ShutterConfig, SimConfig
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.sensor.frame_camera import (
    FrameCamera,
    auto_shutter,
    develop,
    exposure_spans_us,
)
from eventsweep.sim.sensor.lens_blur import blurred
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
    sequence, job = Sequence.open(whole), make_job(scene, made.tiny_rig(), CONFIG, 0)
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
                shutter = auto_shutter(light, FRAMES)
                assert photo.gain == shutter.gain
                assert np.array_equal(photo.image, develop(light, shutter))
                other = captured_light(
                    renderer, job.motion(), camera, photo.start_us, CONFIG, shutter.exposure_us
                )
                off = np.abs(photo.image.astype(int) - develop(other, shutter))
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
            assert np.array_equal(photo.image, develop(light, auto_shutter(light, frames)))


def test_pictures_are_taken_through_the_sensors_lens():
    frames = FramesConfig(rate_hz=400, exposure_us=2_500, gain=1.0)
    light = np.random.default_rng(0).random((20, 30), np.float32)
    sharp, blurry = (FrameCamera(frames, 10_000, None, sigma_px) for sigma_px in (0.0, 1.2))
    for camera in (sharp, blurry):
        camera.take(0, (light,))
    (photo,), *_ = blurry.take(10_000, (light,))
    assert np.array_equal(photo.image, develop(blurred(light, 1.2), ShutterConfig()))
    assert np.array_equal(sharp.take(10_000, (light,))[0][0].image, develop(light, ShutterConfig()))


def test_automatic_gain_meets_the_level_and_leaves_the_dark_dark():
    light = np.random.default_rng(1).lognormal(0, 2, (50, 50)).astype(np.float32)
    shutter = auto_shutter(light, FramesConfig(auto_percentile=80, auto_level=0.6))
    assert np.percentile(shutter.gain * light, 80) == pytest.approx(0.6)
    assert auto_shutter(0 * light, FramesConfig(auto_max_gain=50)).gain == pytest.approx(50)
    assert auto_shutter(light, FramesConfig(gain=3)).gain == 3


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
    [Photo(9, 20, 1, IMAGE), Photo(30, 30, 1, IMAGE), Photo(10, 20, 1, IMAGE[:2])],
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


def test_shutters_have_the_same_defaults_either_way():
    frames, shutter = FramesConfig(), ShutterConfig()
    assert (frames.exposure_us, frames.bits) == (shutter.exposure_us, shutter.bits)


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
