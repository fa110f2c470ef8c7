import sys
from dataclasses import replace

import numpy as np
import pytest

from depth_maps import steps_off
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.emvs.utils import runtime
from made_events import assert_same_events, part_of
from point_world import fronto_parallel
from refusals import refused
from volumes import FUSIONS, dsi, event_rays

RANGE = {"min_depth_m": 0.5, "max_depth_m": 4.0}
CONFIG = MapperConfig(**RANGE, planes=25, threshold_c=20)
ALL = ("Alg1/min", "Alg1/H", "Alg1/G", "Alg1/A", "Alg1/RMS", "Alg1/max", "EMVS/cam0", "EMVS/cam1")


def at_half_time(recording, config):
    first_us = min(recording.event_span_us(c)[0] for c in range(len(recording.rig)))
    return config.model_copy(update={"reference_s": (250_000 - first_us) * 1e-6})


@pytest.mark.parametrize("depth_m", [0.8, 1.23, 1.7, 2.1, 2.9])
@pytest.mark.parametrize(("on_pixels", "planes"), [(False, 25), (True, 50)])
def test_a_fronto_parallel_plane_is_recovered(depth_m, on_pixels, planes):
    """Law: within a quarter of a plane step with interpolation, and half a step without.

    Points between pixels shift a pixel's maximum by a fraction of a pixel's disparity, which is why
    the finer planes are held against points on pixels.
    """
    recording = fronto_parallel(depth_m, on_pixels=on_pixels)
    for interpolate, limit in ((True, 0.25), (False, 0.5)):
        config = CONFIG.model_copy(update={"planes": planes, "interpolate": interpolate})
        result = map_window(recording, at_half_time(recording, config))
        for method in ("Alg1/H", "Alg1/G", "Alg1/A", "EMVS/cam0"):
            assert result.depth_maps[method].points > 200
            assert steps_off(result, method, depth_m) <= limit, method


@pytest.mark.parametrize("scale", [0.25, 8.0])
def test_scaling_the_world_scales_the_depth(scale):
    near, far = CONFIG.min_depth_m, CONFIG.max_depth_m
    scaled = CONFIG.model_copy(update={"min_depth_m": near * scale, "max_depth_m": far * scale})
    one = map_window(fronto_parallel(1.23), CONFIG)
    other = map_window(fronto_parallel(1.23, scale=scale), scaled)
    # a power of two: every float scales exactly, only the times are rounded alike
    for method in ALL:
        a, b = one.depth_maps[method], other.depth_maps[method]
        assert (a.mask == b.mask).mean() > 0.999
        both = a.mask & b.mask
        ratio = b.depth_m[both] / a.depth_m[both]
        assert np.mean(np.abs(ratio / scale - 1) < 1e-3) > 0.99


def test_polarity_is_not_used():
    recording = fronto_parallel(1.5)
    flipped = replace(recording, streams=tuple(replace(s, p=1 - s.p) for s in recording.streams))
    one, other = map_window(recording, CONFIG), map_window(flipped, CONFIG)
    for method in ALL:
        np.testing.assert_array_equal(
            one.depth_maps[method].depth_m, other.depth_maps[method].depth_m
        )
    np.testing.assert_array_equal(one.event_image, other.event_image[::-1])


def test_streaming_equals_whole_volumes():
    """The fold, plane by plane, gives what fusing whole volumes gives; so do slices and files."""
    recording = fronto_parallel(1.5)
    result = map_window(recording, CONFIG)
    rho = inverse_depth_planes(0.5, 4.0, 25)
    camera = recording.rig.cameras[0]
    volumes = []
    for k, stream in enumerate(recording.streams):
        events = stream.between(result.window.t0_us, result.window.t1_us)
        rays = event_rays(events, camera, recording.rig.T_body_cam[k], recording.trajectory,
                          result.view.T_world_rv, camera)  # fmt: skip
        volumes.append(dsi(rays, rho, camera.width_px, camera.height_px)[0])
    stacked = np.stack(volumes)
    expected = {f"Alg1/{name}": fuse(stacked) for name, fuse in FUSIONS.items()}
    expected |= {"EMVS/cam0": volumes[0], "EMVS/cam1": volumes[1]}
    assert list(result.depth_maps) == [*ALL, "Focus/H"]
    for method, volume in expected.items():
        depth = result.depth_maps[method]
        np.testing.assert_array_equal(depth.argmax, volume.argmax(axis=0))
        np.testing.assert_array_equal(depth.confidence, volume.max(axis=0))
        np.testing.assert_array_equal(result.slices.values[method], volume[:, result.slices.row_px])


def test_a_stopped_run_leaves_no_volume(tmp_path):
    def stop(stage, done, _total):
        if stage == "sweep" and done > 10:
            raise KeyboardInterrupt

    config = CONFIG.model_copy(update={"save_dsi": True})
    with pytest.raises(KeyboardInterrupt):
        map_window(fronto_parallel(1.5), config, stop, dsi_dir=tmp_path / "dsi")
    assert list(tmp_path.iterdir()) == []


def test_the_reference_view_is_camera_0_at_the_middle():
    recording = fronto_parallel(1.5)
    result = map_window(recording, CONFIG)
    t_ref_us = (result.window.t0_us + result.window.t1_us) // 2
    assert result.view.t_us == t_ref_us
    np.testing.assert_allclose(
        result.view.T_world_rv, recording.trajectory.at(t_ref_us) @ recording.rig.T_body_cam[0]
    )
    assert result.view.camera == recording.rig.cameras[0].undistorted()


def test_one_camera_alone():
    result = map_window(fronto_parallel(1.23, cameras=1), CONFIG)
    assert (list(result.depth_maps), len(result.counts)) == (["EMVS/cam0", "Focus/cam0"], 1)
    assert steps_off(result, "EMVS/cam0", 1.23) < 0.5


def test_the_compatibility_setting_counts_its_tail_and_never_interpolates():
    recording = fronto_parallel(1.5)
    result = map_window(recording, CONFIG.model_copy(update={"compatibility": "mcemvs"}))
    for counts in result.counts:
        assert counts.events.dropped == (counts.events.events - 1) % 1024 + 1
    assert np.all(np.diff(result.view.rho) > 0)
    depth = result.depth_maps["Alg1/H"]
    nearest = np.abs(1 / depth.depth_m[..., None] - result.view.rho).min(axis=-1)
    assert nearest.max() < 1e-5


def with_two_poses(recording):
    """The recording with poses from 0.1 to 0.4 s."""
    t_us = np.array([100_000, 400_000])
    positions = np.stack([recording.trajectory.at(t)[:3, 3] for t in t_us])
    return replace(recording, trajectory=Trajectory(t_us, positions, np.eye(4)[[3, 3]]))


def test_events_without_poses_are_left_out_and_counted():
    recording = fronto_parallel(1.5)
    result = map_window(with_two_poses(recording), CONFIG)
    for stream, counts in zip(recording.streams, result.counts, strict=True):
        covered = int(((stream.t_us >= 100_000) & (stream.t_us <= 400_000)).sum())
        assert counts.events.rays == covered
        assert counts.events.without_pose == len(stream) - covered > 0


@pytest.mark.parametrize(("values", "words"), [
    ({"start_s": 0.9}, "begins 0.4.* s after the last of the events"),
    ({"start_s": 0.1, "duration_s": 0.9}, "ends 0.5.* s after the last of the events"),
    ({"reference_s": 0.9}, "reference_s 0.9 lies 0.4.* s outside the poses"),
    ({"slice_row": 64}, r"rows 0\.\.63"),
    ({"methods": ("Alg1/h",)}, "unknown method 'Alg1/h'.*Alg1/H"),
    ({"min_depth_m": 4.5, "max_depth_m": None}, "depth range 4.5"),
    ({"save_dsi": True}, "save_dsi is set: needs an output folder"),
])  # fmt: skip
def test_bad_requests_get_one_clear_line(values, words):
    recording = replace(fronto_parallel(1.5), depth_range_m=(0.5, 4.0))
    refused(words, map_window, recording, CONFIG.model_copy(update=values))


def on_another_clock(recording):
    poses = recording.trajectory
    return replace(recording, trajectory=replace(poses, t_us=poses.t_us + 10**9))


def with_a_late_camera(recording):
    left, right = recording.streams
    return replace(recording, streams=(left, right.between(450_000, 500_000)))


@pytest.mark.parametrize(("change", "start_s", "words"), [
    (on_another_clock, 0.0, "do not overlap"), (with_a_late_camera, 0.0, "cam1 has 0 events"),
    (with_two_poses, 0.05, "begins 0.0.* before the first of the poses"),
    (with_two_poses, 0.25, "ends 0.0.* s after the last of the poses"),
])  # fmt: skip
def test_events_without_poses_and_poses_without_events_are_refused(change, start_s, words):
    config = CONFIG.model_copy(update={"start_s": start_s, "duration_s": 0.2})
    refused(words, map_window, change(fronto_parallel(1.5)), config)


def test_an_explicit_window_takes_its_events_only():
    recording = fronto_parallel(1.5)
    config = CONFIG.model_copy(update={"start_s": 0.1, "duration_s": 0.2})
    result = map_window(recording, config)
    first_us = min(recording.event_span_us(c)[0] for c in (0, 1))
    assert (result.window.t0_us, result.window.t1_us) == (first_us + 100_000, first_us + 300_000)
    for stream, counts in zip(recording.streams, result.counts, strict=True):
        assert counts.events.events == len(stream.between(first_us + 100_000, first_us + 300_000))


def test_a_camera_that_looks_away_is_refused_and_one_that_looks_elsewhere_is_not():
    recording = fronto_parallel(1.5, cameras=1)
    away = np.diag([-1.0, 1, -1, 1])
    rig = Rig("away", recording.rig.cameras * 2, (np.eye(4), away))
    both = replace(recording, rig=rig, streams=recording.streams * 2)
    refused("none of which can vote", map_window, both, CONFIG)


def test_progress_reaches_the_end_of_every_stage():
    told = []
    map_window(fronto_parallel(1.5), CONFIG, lambda *report: told.append(report))
    assert {("rays", 2, 2), ("sweep", 25, 25)} <= set(told)


def test_events_in_memory_are_not_changed():
    recording = fronto_parallel(1.5)
    copies = [part_of(stream, np.arange(len(stream))) for stream in recording.streams]
    map_window(recording, CONFIG)
    for stream, copy in zip(recording.streams, copies, strict=True):
        assert_same_events(stream, copy)


def test_without_openmp_it_says_what_to_install(monkeypatch):
    recording = fronto_parallel(1.5)
    monkeypatch.setitem(sys.modules, "numba.np.ufunc.omppool", None)
    runtime.check_openmp.cache_clear()
    refused("apt-get install libgomp1", map_window, recording, MapperConfig(planes=5))
    runtime.check_openmp.cache_clear()
