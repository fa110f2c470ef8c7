"""Planted clocks and rotations are found within their intervals; events fall where frames are."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import panel_world as world
from eventsweep.plugins.align import offset, residual
from eventsweep.plugins.align.carry import aligned_events, event_rho
from eventsweep.plugins.align.depths import depth_source
from eventsweep.plugins.align.edges import find_edges, match
from eventsweep.plugins.align.equations import Rows
from eventsweep.plugins.align.folder import align
from eventsweep.plugins.align.offset import covariance, find_offset
from eventsweep.plugins.align.residual import apart, samples
from eventsweep.plugins.align.rig import set_up
from eventsweep.plugins.align.views import View
from refusals import refused


def setup_of(recording, **names):
    return set_up(recording, depth_source(recording, None), **names)


def found_for(recording):
    setup = setup_of(recording)
    taken = samples(setup, setup.covered(20_000))
    return setup, taken, find_offset(setup, taken)


def planted(recording, found):
    """True values in the order of the estimates."""
    values = [recording.late_us, *recording.turn_rad, *recording.shift_px]
    moved_px = found.mean_move_px[:, 1:] @ values[1:]
    return [recording.late_us / 1000, *np.degrees(recording.turn_rad), *values[4:], *moved_px]


@pytest.mark.parametrize(("seed", "late_us", "turn_deg", "shift_px"), [
    (0, 3000, (0.3, -0.2, 0.1), (1.2, -1.6)), (5, -3000, (-0.1, 0.3, -0.3), (-2.0, 0.0)),
])  # fmt: skip
def test_planted_offsets_are_found_within_their_intervals(seed, late_us, turn_deg, shift_px):
    turn_rad = tuple(np.radians(turn_deg))
    recording = world.PanelRecording(seed, late_us, turn_rad, shift_px=shift_px)
    setup, taken, found = found_for(recording)
    assert not found.note
    off = [
        abs(each.value - value) / each.half
        for each, value in zip(found.estimates, planted(recording, found), strict=True)
    ]
    assert all(each.known for each in found.estimates)
    assert np.sum(np.array(off) > 1) <= 1  # of 95 % intervals one may miss
    assert max(off) < 2.5
    assert found.estimates[0].half < 3
    assert max(each.half for each in found.estimates[6:]) < 0.2
    before, after = apart(setup, taken), apart(setup.corrected(found.correction), taken)
    assert after.table()[0]["median_px"] < 0.5
    assert after.table()[0]["p95_px"] < 0.7 * before.table()[0]["p95_px"]


def test_intervals_of_the_clock_allow_for_a_photoreceptors_delay(monkeypatch):
    """Its events come late as if frames were early; the allowance is about what it does."""
    (_, _, quick), (_, _, slow) = (
        found_for(world.PanelRecording(0, 3000, cutoff_hz=hz)) for hz in (np.inf, 300.0)
    )  # fmt: skip
    moved_ms = slow.estimates[0].value - quick.estimates[0].value
    monkeypatch.setattr(offset, "DELAY_US", 0.0)
    _, _, random = found_for(world.PanelRecording(0, 3000, cutoff_hz=300.0))
    allowed_ms = np.sqrt(slow.estimates[0].half ** 2 - random.estimates[0].half ** 2)
    assert moved_ms > 0.6
    assert 0.5 * allowed_ms < moved_ms < allowed_ms
    assert abs(slow.estimates[0].value - 3) <= slow.estimates[0].half
    for one, other in zip(slow.estimates[1:], random.estimates[1:], strict=True):
        assert one.half == pytest.approx(other.half, rel=0.3)  # of a rotation it is little


def shift_by_baseline_px(monkeypatch, events):
    """How much further edges are along the baseline than with the frame camera opposite.

    Whatever else shifts the picture, lags or where edges are, is the same on both sides.
    """
    T_body_grey, shifts_px = world.T_BODY_GREY, []
    for side in (1, -1):
        placed = T_body_grey.copy()
        placed[:3, 3] *= side
        with monkeypatch.context() as only:
            only.setattr(world, "T_BODY_GREY", placed)
            recording = world.PanelRecording(1)
            recording._events = events
            _, _, found = found_for(recording)
        shifts_px.append([each.value for each in found.estimates[6:]])
    along = T_body_grey[:2, 3] / np.linalg.norm(T_body_grey[:2, 3])
    return np.subtract(*shifts_px) / 2 @ along


def test_what_the_frame_camera_sees_beside_silhouettes_does_not_shift_edges(monkeypatch):
    """It does where events of unsure depth count."""
    trajectory = world.motion(1)
    events = world.crossings(trajectory, 0.2, np.inf)
    assert abs(shift_by_baseline_px(monkeypatch, events)) < 0.004
    monkeypatch.setattr(residual, "_AMBIGUOUS_PX", np.inf)
    assert shift_by_baseline_px(monkeypatch, events) > 0.01


def test_events_on_both_sides_of_a_silhouette_are_left_out_and_no_others(monkeypatch):
    """Those of which the formula's two surfaces lie apart in the frame, within a pixel."""
    recording = world.PanelRecording(4)
    setup = setup_of(recording)
    (kept,) = samples(setup, [2])
    monkeypatch.setattr(residual, "_AMBIGUOUS_PX", np.inf)
    (every,) = samples(setup, [2])
    remain = {tuple(point) for point in kept.points}
    left_out = np.array([tuple(point) not in remain for point in every.points])
    T_world_eye = recording.trajectory.at(setup.frame_time_us(2))
    seen_px, _ = View(world.EYE, T_world_eye).seen(every.points, every.rho)
    around_px = seen_px[:, None] + np.array([(x, y) for x in (-2, 0, 2) for y in (-2, 0, 2)])
    on = world.hits(world.EYE, T_world_eye, around_px)[2]
    near_rim = on.any(-1) & ~on.all(-1)
    assert near_rim[left_out].mean() > 0.9
    assert left_out[near_rim].mean() > 0.4
    assert left_out[~near_rim].mean() < 0.02
    on_panel = on[:, 4]
    assert 0.25 < on_panel[left_out].mean() < 0.75


@pytest.mark.parametrize("mirrored", [(-1, 1), (1, -1)])
def test_a_mirrored_picture_has_mirrored_edges(mirrored):
    """No side is preferred, not even where a pixel's centre lies between two edges."""
    rng = np.random.default_rng(2)
    size = np.array([90, 70])
    image = np.kron(rng.uniform(20, 230, (14, 18)), np.ones((5, 5))).astype(np.float32)
    uv_px = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), -1).reshape(-1, 2) * 1.0
    moving_px, brighter = rng.normal(size=uv_px.shape), rng.random(len(uv_px)) < 0.5
    there = match(find_edges(image), uv_px, moving_px, brighter, 3.0)
    right, down = mirrored
    other = find_edges(np.ascontiguousarray(image[::down, ::right]))
    away_px = np.where(np.array(mirrored) < 0, size - 1 - uv_px, uv_px)
    back = match(other, away_px, moving_px * mirrored, brighter, 3.0)
    assert len(there.points) > 1000
    off_px = np.full((2, len(uv_px)), np.nan)
    off_px[0, there.points], off_px[1, back.points] = there.off_px, back.off_px
    assert np.isclose(*off_px, atol=1e-6, equal_nan=True).mean() > 0.99
    assert abs(np.nanmean(off_px[0] - off_px[1])) < 1e-3


def test_steps_end_when_small_beside_the_intervals_or_it_is_said(monkeypatch):
    recording = world.PanelRecording(0, 3000, shift_px=(1.0, 0.0))
    setup, taken, found = found_for(recording)
    monkeypatch.setattr(offset, "_SETTLED", 0.0)
    longer = find_offset(setup, taken)
    assert not found.note
    for one, other in zip(found.estimates, longer.estimates, strict=True):
        assert abs(one.value - other.value) < 0.15 * one.half
    monkeypatch.setattr(offset, "_MOST_STEPS", 1)
    assert "did not settle: step 1 still moved it by" in find_offset(setup, taken).note


def rows_of(view_deg):
    """Equations of a lens of that view, exact but for noise that comes in tiles."""
    rng = np.random.default_rng(0)
    f_px = 120 / np.tan(np.radians(view_deg / 2))
    x, y = rng.uniform(-120, 120, (2, 4000)) / f_px
    zero, one = np.zeros_like(x), np.ones_like(x)
    moves_px = np.array([
        [0.1 * rng.uniform(0.5, 1.5, 4000), -f_px * x * y, f_px * (1 + x**2), -f_px * y, one, zero],
        [0.1 * rng.normal(size=4000), -f_px * (1 + y**2), f_px * x * y, f_px * x, zero, one],
    ]).transpose(2, 0, 1)  # fmt: skip
    angle = rng.uniform(0, 2 * np.pi, 4000)
    normal = np.stack([np.cos(angle), np.sin(angle)], -1)
    lags = np.stack([rng.choice((-1, 1), 4000), rng.normal(size=4000), one], -1)
    J = np.concatenate([np.einsum("nj,njk->nk", normal, moves_px), lags], -1)
    tile = (np.floor((x * f_px + 120) / 48) * 1000 + np.floor((y * f_px + 120) / 48)).astype(int)
    off_px = 0.1 * rng.normal(size=5000)[tile] + 0.1 * rng.normal(size=4000)
    kind = (angle // (np.pi / 4)).astype(int) * 2 + rng.integers(0, 2, 4000)
    return Rows(J, off_px, one, moves_px, np.zeros(4000), tile, kind)


def test_the_narrower_the_view_the_less_a_turn_is_told_from_a_principal_point():
    """Both move edges by as much to the third power of the angle; their sum stays known."""
    single, both = [], []
    for view_deg in (80, 40, 20):
        near = rows_of(view_deg)
        spread = covariance(near, np.zeros(9))
        move_px = near.mean_move_px
        single.append(np.sqrt(np.diag(spread)[4:6]))
        both.append(np.sqrt(np.diag(move_px @ spread @ move_px.T)))
    for wide, narrow in pairwise(single):
        assert (narrow > 2.5 * wide).all()
    assert np.max(both) < 0.05


def test_what_cannot_be_told_apart_is_said_and_corrected_by_a_rotation(monkeypatch):
    """Where less than any half-width would be needed."""
    monkeypatch.setattr(offset, "_APART_DEG", 1e-6)
    recording = world.PanelRecording(0, 3000, (0.0, 0.003, 0.0), shift_px=(2.0, 0.0))
    setup, taken, found = found_for(recording)
    assert "move these edges alike" in found.note
    words = {each.name: each.words for each in found.estimates}
    assert words["rotation about y"] == words["principal point right"] == "not determined"
    assert found.correction.shift_px == (0.0, 0.0)
    right = found.estimates[6]
    assert right.known
    assert abs(right.value - planted(recording, found)[6]) <= right.half
    after = apart(setup.corrected(found.correction), taken)
    assert after.table()[0]["median_px"] < 0.5


def test_beyond_the_reach_of_the_search_nothing_is_determined_or_applied(tmp_path):
    """Of a picture that is shifted by 9 px other edges are found, or the right ones by luck."""
    setup, _, found = found_for(world.PanelRecording(0, shift_px=(9.0, 0.0)))
    assert "further than the 6 px within which they were searched for" in found.note
    assert {each.words for each in found.estimates} == {"not determined"}
    refused("nothing to apply: the estimate would move", align, setup, tmp_path / "o", apply=True)
    assert not (tmp_path / "o").exists()


def test_without_motion_nothing_is_determined_or_compared():
    still = world.motion(3)
    still = replace(still, positions_m=0 * still.positions_m, quats_xyzw=still.quats_xyzw[:1] + 0
                    * still.quats_xyzw)  # fmt: skip
    recording = world.PanelRecording(trajectory=still)
    setup = setup_of(recording)
    line = "no event that is surely of one depth within 10 ms of a frame"
    refused(line, samples, setup, setup.covered())


@pytest.mark.parametrize(("many", "cure"), [
    (100, "check that both use one clock"), (10**6, "take frames with more edges"),
])  # fmt: skip
def test_a_clock_beyond_reach_is_not_blamed_on_clocks_where_edges_are_few(monkeypatch, many, cure):
    monkeypatch.setattr(offset, "MARGIN_US", 1)
    monkeypatch.setattr(offset, "_MANY", many)
    words = r"brings the [\d,]+ events that lie beside edges of frames to these: "
    refused(words + cure, found_for, world.PanelRecording(0, 3000))


def test_events_land_where_the_frame_camera_sees_their_points():
    """Points of the wall and the panel by formula, projected by the lens alone."""
    recording = world.PanelRecording(4)
    setup = setup_of(recording, into="grey")
    count = 0
    for _, some in aligned_events(setup, 100_000, 110_000):
        events = some.events
        T_world_body = recording.trajectory.at(events.t_us)
        assert some.unsure.shape == events.t_us.shape
        assert 0 < some.unsure.mean() < 0.1
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


def test_beside_a_silhouette_events_are_unsure_and_a_third_are_the_walls():
    """Whether the panel's rim passed an event's pixel around its time, by formula."""
    recording = world.PanelRecording(4)
    rim, wall, panel, count = 0, 0, 0, 0
    for t0_us, t1_us, depths in setup_of(recording).slices(100_000, 120_000):
        events = recording.events(0, t0_us, t1_us)
        _, unsure, _ = event_rho(events, depths)
        count += len(events)
        for k in np.flatnonzero(unsure)[::3]:
            uv_px = np.array([events.x[k], events.y[k]], float)
            poses = recording.trajectory.at(events.t_us[k] + np.array([-500, 0, 500]))
            on = {bool(world.hits(world.EYE, T_world_eye, uv_px)[2]) for T_world_eye in poses}
            rim, wall, panel = rim + (len(on) > 1), wall + (on == {False}), panel + (on == {True})
    total = rim + wall + panel
    assert 0.03 < 3 * total / count < 0.06
    assert rim / total > 0.55
    assert 0.2 < wall / total < 0.4
    assert panel / total < 0.05


def test_cameras_that_are_not_there_are_named():
    recording = world.PanelRecording()
    refused("no camera 'right' here; choose from eye, grey", setup_of, recording, into="right")
    refused("no camera 'eye' here; choose from grey", setup_of, recording, frames="eye")
