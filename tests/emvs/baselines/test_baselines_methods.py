"""The baselines through the mapper: registry, recordings in memory, bad input."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from depth_maps import assert_same_bits, mapper
from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import BaselineEstimator, sgm
from eventsweep.emvs.baselines.sgm import match
from eventsweep.emvs.config import MapperConfig, SemiGlobal
from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import read_depth, read_slices, write_window
from eventsweep.emvs.methods import methods_by_name, overview, register, unregister
from eventsweep.emvs.windows import Window
from made_events import part_of
from point_world import Recorded, edge_stream, fronto_parallel, sideways, stereo_rig, with_cameras
from refusals import refused
from tiers import often

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)
mapped = mapper(CONFIG)
ALWAYS = ("SGM/ts", "SGM/window")


@dataclass(frozen=True, eq=False)
class WithPhotos(Recorded):
    """The same random texture before both cameras, 20 px apart."""

    def photo_times_us(self, camera):
        return np.array([250_000])

    def photo(self, camera, t_us):
        height, width = self.rig.cameras[camera].height_px, self.rig.cameras[camera].width_px
        texture = np.random.default_rng(0).integers(0, 255, (height, width)).astype(np.uint8)
        return Photo(249_000, 251_000, 1.0, np.roll(texture, -20 * camera, axis=1))


# Names


def test_all_stays_the_fusion_methods_and_baselines_are_the_others():
    everything = [method.name for method in methods_by_name(("all", "baselines"), 2)]
    assert not {name.split("/")[0] for name in everything[:9]} & set(baselines.FAMILIES)
    assert tuple(everything[9:]) == baselines.GROUPS["baselines"]
    assert set(ALWAYS) <= set(baselines.GROUPS["baselines"])
    assert "Frames/sgm" not in baselines.GROUPS["baselines"]
    assert methods_by_name(("baselines", "SGM/ts"), 2) == methods_by_name(("baselines",), 2)
    shown = " ".join(overview())
    assert all(baseline.name in shown for baseline in baselines.BASELINES)


def test_a_baseline_of_ones_own():
    def nothing_new(recording, window, view, config):
        return sgm.estimate_time_surfaces(recording, window, view, config)

    register(BaselineEstimator("Own/stereo", "nothing new", nothing_new))
    try:
        own = mapped(fronto_parallel(1.5), "Own/stereo").depth_maps["Own/stereo"]
        assert own.method == "Own/stereo"
        assert overview()["Own/stereo"] == "nothing new"
    finally:
        unregister("Own/stereo")


# Through the mapper


def test_baselines_beside_volumes_change_nothing_and_come_back_from_disk(tmp_path):
    recording = fronto_parallel(1.5, points=3000)
    both = mapped(recording, "SGM/ts", "Alg1/H", "Late/union")
    alone, baseline = mapped(recording, "Alg1/H"), mapped(recording, "SGM/ts")
    assert list(both.depth_maps) == ["Alg1/H", "SGM/ts", "Late/union"]
    for result, name in ((alone, "Alg1/H"), (baseline, "SGM/ts")):
        assert_same_bits(result.depth_maps[name], both.depth_maps[name])
    assert baseline.counts[0].events == alone.counts[0].events
    assert baseline.counts[0].votes.counted == 0
    info = write_window(tmp_path / "w000", both, CONFIG, recording.rig.camera_names, clouds=False)
    assert info.methods == ("Alg1/H", "SGM/ts", "Late/union")
    slices = read_slices(tmp_path / "w000" / "slices.npz", info.methods, 96)
    assert [len(slices.values[name]) for name in info.methods] == [25, 0, 25]
    read = read_depth(tmp_path / "w000" / "SGM-ts" / "depth.npz", "SGM/ts")
    np.testing.assert_array_equal(read.depth_m, both.depth_maps["SGM/ts"].depth_m)


@pytest.mark.parametrize("depth_m", [0.8, 1.3, 2.5])
@pytest.mark.parametrize("name", ALWAYS)
def test_a_fronto_parallel_plane_is_found_to_half_a_pixel_of_disparity(depth_m, name):
    recording = fronto_parallel(depth_m, points=3000)
    found = mapped(recording, name).depth_maps[name]
    disparity_px = 80 * 0.1 / found.depth_m[found.mask]
    assert found.points > 300
    assert np.median(np.abs(disparity_px - 8 / depth_m)) < 0.5


def test_swapping_the_cameras_gives_the_same_plane():
    """Camera 1 to the left: the views turn by 180 degrees, and depth stays."""
    swapped = with_cameras(fronto_parallel(1.3, points=3000), (1, 0))
    found = mapped(swapped, "SGM/ts").depth_maps["SGM/ts"]
    assert found.points > 300
    assert np.median(np.abs(8 / found.depth_m[found.mask] - 8 / 1.3)) < 0.5


def test_scaling_the_world_scales_the_depth():
    small, large = (fronto_parallel(1.3, points=3000, scale=scale) for scale in (1.0, 2.0))
    one = mapped(small, "SGM/ts").depth_maps["SGM/ts"]
    two = mapped(large, "SGM/ts", min_depth_m=1.0, max_depth_m=8.0).depth_maps["SGM/ts"]
    np.testing.assert_array_equal(one.mask, two.mask)
    np.testing.assert_allclose(two.depth_m[two.mask], 2 * one.depth_m[one.mask], rtol=1e-5)


@pytest.mark.parametrize("shift_px", [3, 10, 17])
def test_a_shifted_picture_is_matched_and_its_edges_report_nothing(shift_px):
    texture = np.random.default_rng(0).integers(0, 255, (40, 120)).astype(np.uint8)
    left, right = texture[:, :100], np.roll(texture, -shift_px, axis=1)[:, :100]
    found_px = match(left, right, (2, 18), SemiGlobal(block_px=5))
    known = np.isfinite(found_px)
    assert known[:, shift_px + 8 : -20].mean() > 0.95
    assert np.abs(found_px[:, : 100 - shift_px][known[:, : 100 - shift_px]] - shift_px).max() < 0.1
    assert not known[:, : 2 + 5 // 2].any()


@pytest.mark.parametrize("name", often(["SGM/ts"], ["SGM/ts", "SGM/window", "Frames/sgm"]))
def test_one_thread_and_two_give_the_same_bits(name):
    """Of the kernels and of OpenCV, on pictures that OpenCV shares out among its threads."""
    camera = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
    stream, motion = edge_stream(camera, sideways(), 200_000), sideways()
    recording = WithPhotos(stereo_rig(camera), motion, (stream, stream))
    before, maps = cv2.getNumThreads(), []
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            maps.append(mapped(recording, name, threads=threads).depth_maps[name])
    finally:
        cv2.setNumThreads(before)
    assert maps[0].points > 300
    assert_same_bits(*maps)


def test_one_parameter_of_the_matcher_leaves_the_others_as_they_were():
    given = MapperConfig.model_validate({"frames": {"matcher": {"p1_per_px": 9}}})
    default = MapperConfig().frames.matcher
    assert given.frames.matcher == default.model_copy(update={"p1_per_px": 9})
    assert default.block_px == 7


# Bad input


@pytest.mark.parametrize(("name", "values", "words"), [
    ("SGM/ts", {"min_depth_m": 20.0, "max_depth_m": 40.0}, r"of disparity on a baseline of 0\.1 m"),
    ("SGM/window", {"start_s": 0.1, "duration_s": 0.04}, r"at 20 Hz needs at least 0\.05 s"),
    ("Frames/sgm", {}, "has no frames, which"),
])  # fmt: skip
def test_what_a_recording_does_not_give_is_refused(name, values, words):
    refused(words, mapped, fronto_parallel(1.5), name, **values)


def test_cameras_that_stay_silent_are_named():
    recording = fronto_parallel(1.5)
    left, right = recording.streams
    silent = replace(recording, streams=(left, part_of(right, right.t_us >= 300_000)))
    refused("cam1 has no events from", mapped, silent, "SGM/ts")


def test_poses_need_not_reach_the_end_of_the_window():
    recording = fronto_parallel(1.5, points=3000)
    window = Window(300_001, 500_001, 400_000, (0, 0))
    assert sgm.instants_us(window, 20) == [350_001, 400_001, 450_001, 500_000]
    config = CONFIG.model_copy(update={"methods": ("SGM/window",)})
    found = map_window(recording, config, window=window).depth_maps["SGM/window"]
    assert found.points > 300
