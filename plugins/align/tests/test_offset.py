"""Planted clocks and rotations are found within their intervals; events fall where frames are."""

from dataclasses import replace

import numpy as np
import pytest

import panel_world as world
from eventsweep.plugins.align.carry import aligned_events
from eventsweep.plugins.align.depths import depth_source
from eventsweep.plugins.align.offset import find_offset
from eventsweep.plugins.align.residual import apart, samples
from eventsweep.plugins.align.rig import set_up
from refusals import refused


def setup_of(recording, **names):
    return set_up(recording, depth_source(recording, None), **names)


def found_for(recording):
    setup = setup_of(recording)
    taken = samples(setup, setup.covered(20_000))
    return setup, taken, find_offset(setup, taken)


def misses(recording):
    """By how many of its half-widths each value is off."""
    _, _, found = found_for(recording)
    true = [recording.late_us / 1000, *np.degrees(recording.turn_rad)]
    return [
        abs(each.value - value) / each.half if each.known else 0.0
        for each, value in zip(found.estimates, true, strict=True)
    ]


@pytest.mark.parametrize(("seed", "late_us", "turn_deg"), [
    (0, 3000, (0.3, -0.2, 0.1)), (5, -3000, (-0.1, 0.3, -0.3)),
])  # fmt: skip
def test_planted_offsets_are_found_within_their_intervals(seed, late_us, turn_deg):
    recording = world.PanelRecording(seed, late_us, tuple(np.radians(turn_deg)))
    setup, taken, found = found_for(recording)
    true = [late_us / 1000, *turn_deg]
    for each, value in zip(found.estimates, true, strict=True):
        assert each.known
        assert abs(each.value - value) <= each.half, each
    assert found.estimates[0].half < 1.5
    assert max(each.half for each in found.estimates[1:]) < 0.1
    before, after = apart(setup, taken), apart(setup.corrected(found.correction), taken)
    assert after.table()[0]["median_px"] < 0.5
    assert np.median(np.abs(before.off_px)) > 1.3 * np.median(np.abs(after.off_px))


@pytest.mark.slow
def test_intervals_hold_in_most_of_sixty_draws():
    """Each draw has a motion, a clock and a rotation of its own: 240 values."""
    rng, off = np.random.default_rng(7), []
    for seed in range(60):
        late_us = int(rng.uniform(-3000, 3000))
        turn = tuple(np.radians(rng.uniform(-0.3, 0.3, 3)))
        off += misses(world.PanelRecording(100 + seed, late_us, turn))
    assert 0.9 <= np.mean(np.array(off) <= 1) <= 1.0


def test_without_motion_nothing_is_determined_or_compared():
    still = world.motion(3)
    still = replace(still, positions_m=0 * still.positions_m, quats_xyzw=still.quats_xyzw[:1] + 0
                    * still.quats_xyzw)  # fmt: skip
    recording = world.PanelRecording(trajectory=still)
    setup = setup_of(recording)
    refused("no event with depth within 10 ms of a frame", samples, setup, setup.covered())


def test_events_land_where_the_frame_camera_sees_their_points():
    """Points of the wall and the panel by formula, projected by the lens alone."""
    recording = world.PanelRecording(4)
    setup = setup_of(recording, into="grey")
    count = 0
    for _, some in aligned_events(setup, 100_000, 110_000):
        events = some.events
        T_world_body = recording.trajectory.at(events.t_us)
        for k in range(0, len(events), 37):
            T_world_grey = T_world_body[k] @ world.T_BODY_GREY
            true_m, _, _ = world.hits(world.GREY, T_world_grey, some.xy_px[k].astype(float))
            count += abs(some.depth_m[k] / true_m - 1) < 0.02
        assert (np.abs(np.rint(some.xy_px) - np.stack([events.x, events.y], -1)) == 0).all()
    total = len(recording.events(0, 100_000, 110_000)) - sum(
        map(sum, (s.lost for _, s in aligned_events(setup, 100_000, 110_000)))
    )
    assert total > 2000
    assert count > 0.95 * total / 37  # edges belong to the nearer surface, a pixel wide


def test_cameras_that_are_not_there_are_named():
    recording = world.PanelRecording()
    refused("no camera 'right' here; choose from eye, grey", setup_of, recording, into="right")
    refused("no camera 'eye' here; choose from grey", setup_of, recording, frames="eye")
