"""What settings leave to the recording: laws of the coarse pass and of the number of planes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.first_pass import MOST_PLANES, settled
from eventsweep.emvs.reference_view import depth_range_m
from point_world import Recorded, fronto_parallel, pinhole, stereo_rig


def _refuse(line):
    raise AssertionError(line)


def _both(near_m, far_m, cameras, scale=1.0):
    """Two planes in one view, the upper half of the image and the lower one."""
    parts = [
        fronto_parallel(z, seed, 400, cameras, scale) for seed, z in enumerate((near_m, far_m))
    ]
    streams = []
    for near, far in zip(*(part.streams for part in parts), strict=True):
        kept = near.take(near.y < 32), far.take(far.y >= 32)
        joined = Events.concat(kept)
        streams.append(joined.take(np.argsort(joined.t_us, kind="stable")))
    return replace(parts[0], streams=tuple(streams))


@pytest.mark.parametrize("cameras", [1, 2])
@given(near_m=st.floats(0.5, 2.0), ratio=st.floats(1.0, 3.0))
@settings(max_examples=4, deadline=None)
def test_the_range_holds_what_is_seen_and_little_more(cameras, near_m, ratio):
    config = settled(_both(near_m, ratio * near_m, cameras), MapperConfig(), _refuse).config
    assert 0.4 * near_m < config.min_depth_m < near_m
    assert ratio * near_m < config.max_depth_m < 3 * ratio * near_m


@pytest.mark.parametrize("cameras", [1, 2])
def test_no_unit_of_length_is_assumed(cameras):
    once, large = (
        settled(_both(0.9, 2.3, cameras, scale), MapperConfig(), _refuse).config
        for scale in (1.0, 1000.0)
    )
    assert large.min_depth_m == pytest.approx(1000 * once.min_depth_m, rel=0.02)
    assert large.max_depth_m == pytest.approx(1000 * once.max_depth_m, rel=0.02)


def test_sliding_windows_get_one_range_and_what_is_set_stays():
    config = MapperConfig(window_s=0.1, max_depth_m=7.0, planes=30)
    once = settled(_both(0.9, 2.3, 2), config, _refuse)
    assert (once.config.max_depth_m, once.config.planes) == (7.0, 30)
    assert 0.4 < once.config.min_depth_m < 0.9
    assert re.fullmatch(r"depth 0\.\d+ to 7 m, from a coarse pass.*", once.found)
    assert settled(_both(0.9, 2.3, 2), once.config, _refuse) == replace(once, found="")


@pytest.mark.parametrize("known", ["recorded", "given"])
def test_a_range_that_is_known_is_not_looked_for(known):
    recording, config = _both(0.9, 2.3, 2), MapperConfig(planes=30)
    if known == "recorded":
        recording = replace(recording, depth_range_m=(1.0, 2.0))
    else:
        config = config.model_copy(update={"min_depth_m": 1.0, "max_depth_m": 2.0})
    assert settled(recording, config, _refuse) == settled(recording, config)
    assert settled(recording, config).config == config
    assert depth_range_m(recording, settled(recording, config).config) == (1.0, 2.0)


@pytest.mark.parametrize("fault", ["events", "way"])
def test_what_cannot_be_seen_is_doubted_and_guessed(fault):
    recording, said = fronto_parallel(1.0, cameras=1), []
    if fault == "events":
        recording = replace(recording, streams=tuple(s.slice(0, 40) for s in recording.streams))
    else:
        poses = recording.trajectory
        still = Trajectory(poses.t_us, 0 * poses.positions_m, poses.quats_xyzw)
        recording = replace(recording, trajectory=still)
    found = settled(recording, MapperConfig(), said.append)
    assert (found.config.min_depth_m, found.config.max_depth_m) == (0.2, 5.0)
    (line,) = said
    assert "0.2 to 5 m is a guess" in line
    assert "set min_depth_m" in line
    assert found.found == ""


def test_planes_lie_a_pixel_of_disparity_apart_where_a_hundred_would_not():
    def planes(focal_px, baseline_m, **more):
        camera = pinhole(f=focal_px)
        recording = fronto_parallel(1.0)
        recording = replace(recording, rig=stereo_rig(camera, baseline_m), depth_range_m=(0.5, 4.0))
        return settled(recording, MapperConfig(**more), _refuse).config.planes

    # (1 / 0.5 - 1 / 4) = 1.75 of inverse depth
    assert planes(800.0, 0.1) == 141
    assert planes(400.0, 0.1) == 100
    assert planes(8000.0, 0.1) == MOST_PLANES
    assert planes(800.0, 0.1, planes=100) == 100
    assert planes(800.0, 0.1, spacing="linear") == 100
    assert planes(800.0, 0.1, compatibility="mcemvs") == 100
    assert planes(800.0, 0.1, view_focal_px=400.0) == 100


def test_disparity_of_one_camera_is_along_its_way():
    recording: Recorded = replace(fronto_parallel(1.0, cameras=1), depth_range_m=(0.2, 4.0))
    # 0.2 m from the middle of the way to its ends, and an event at each
    wanted = 80 * 0.2 * (1 / 0.2 - 1 / 4)
    assert wanted < 100
    assert settled(recording, MapperConfig()).config.planes == 100
    near = replace(recording, depth_range_m=(0.1, 4.0))
    assert settled(near, MapperConfig()).config.planes == pytest.approx(2.05 * wanted + 1, abs=2)
