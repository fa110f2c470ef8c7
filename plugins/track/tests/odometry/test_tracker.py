"""The tracker on worlds made of formulas: what it finds, and what it says of itself."""

from dataclasses import replace

import numpy as np
import pytest

import line_world
import point_world as world
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.checkpoint import read_state, write_state
from eventsweep.plugins.track.odometry.pose import Status, smoothed
from eventsweep.plugins.track.odometry.recorded import track
from eventsweep.plugins.track.odometry.start import LONGEST_START_US, begin
from eventsweep.plugins.track.odometry.tracker import Tracker
from line_world import CONFIG, Wrapped, tracker_of, worst_m
from refusals import refused

END_US = 450_000


@pytest.fixture(scope="module")
def recording():
    return line_world.swaying(END_US)


@pytest.fixture(scope="module")
def tracked(recording):
    return track(recording, CONFIG)


class Unreadable:
    """Poses that nobody may look at."""

    def __getattr__(self, name):
        raise AssertionError(f"{name} of the recording's poses was read")


class WithoutPoses(Wrapped):
    """A recording with such poses."""

    trajectory = Unreadable()


def run(recording, steps, tracker, changed=lambda camera, events: events):
    """Feeds packets that end at `steps`; returns the status after each."""
    before_us, said = 0, []
    for t_us in steps:
        cameras = range(len(recording.rig))
        packets = [changed(k, recording.events(k, before_us, t_us)) for k in cameras]
        tracker.push(packets, t_us)
        said.append(tracker.status)
        before_us = t_us
    return said


def test_it_finds_the_way_and_begins_at_the_origin(recording, tracked):
    assert worst_m(tracked.trajectory, recording.trajectory) < 0.007
    np.testing.assert_allclose(
        tracked.trajectory.at(tracked.trajectory.t_us[0]), np.eye(4), atol=1e-12
    )
    assert tracked.covered > 0.9
    assert {*tracked.statuses} == {Status.TRACKING}
    assert [change.status for change in tracked.changes] == [Status.STARTING, Status.TRACKING]
    assert tracked.maps >= 2


def test_poses_of_the_recording_are_never_read(recording, tracked):
    again = track(WithoutPoses(recording), CONFIG)
    np.testing.assert_array_equal(again.trajectory.positions_m, tracked.trajectory.positions_m)


@pytest.mark.parametrize("steps", [
    pytest.param(range(7000, END_US, 7000), id="small"),
    pytest.param([1, 333_333], marks=pytest.mark.slow, id="large"),
])  # fmt: skip
def test_packets_of_any_size_give_the_same_poses(recording, tracked, steps):
    tracker, poses = tracker_of(recording)
    run(recording, [*steps, tracked.span_us[1] + 1], tracker)
    tracker.finish()
    expected = tracked.trajectory
    assert len(poses) == len(expected)
    for k, pose in enumerate(smoothed(poses)):
        assert pose.t_us == expected.t_us[k]
        np.testing.assert_array_equal(pose.T_world_body[:3, 3], expected.positions_m[k])


def test_poses_lie_on_the_clock_of_the_events(recording, tracked):
    """Or maps on them would be blurred."""
    tracker, poses = tracker_of(recording)
    run(recording, range(10_000, END_US, 10_000), tracker)
    filtered = [pose for pose in poses if pose.belief is not None]
    assert len(filtered) > 10
    assert all(pose.t_us == pose.belief.t_us for pose in filtered)
    early, at_once, late = (
        score_poses(
            recording.trajectory, tracked.trajectory, TrajectoryConfig(offset_s=offset_s)
        ).values["ate_rmse"]
        for offset_s in (-0.01, 0, 0.01)
    )
    assert at_once < 0.8 * min(early, late)


class Kept:
    """Every state that a run could keep, through files."""

    def __init__(self, folder):
        self.folder, self.states, self.taken = folder, 0, None

    def is_due(self):
        return True

    def save(self, state):
        write_state(self.folder / f"{self.states}.npz", state)
        self.states += 1

    def load(self):
        return None if self.taken is None else read_state(self.folder / f"{self.taken}.npz")


class ReadFrom(Wrapped):
    """A recording whose earlier events may not be read again."""

    def __init__(self, recording, t_us):
        super().__init__(recording)
        self._t_us = t_us

    def events(self, camera, t0_us, t1_us):
        assert t0_us >= self._t_us
        return self._recording.events(camera, t0_us, t1_us)


@pytest.mark.slow
def test_from_any_state_it_goes_on_to_the_same_bits(recording, tracked, tmp_path):
    kept = Kept(tmp_path)
    track(recording, CONFIG, checkpoints=kept)
    assert kept.states >= 3
    for k in range(kept.states):
        kept.taken = k
        until_us = kept.load()["until_us"]
        rest = track(ReadFrom(recording, until_us), CONFIG, checkpoints=kept)
        np.testing.assert_array_equal(rest.trajectory.positions_m, tracked.trajectory.positions_m)
        np.testing.assert_array_equal(rest.trajectory.quats_xyzw, tracked.trajectory.quats_xyzw)
        assert (rest.maps, rest.statuses, rest.changes) == (
            tracked.maps, tracked.statuses, tracked.changes,
        )  # fmt: skip


@pytest.mark.slow
def test_threads_change_no_bit(recording, tracked):
    alone = track(recording, CONFIG.model_copy(update={"threads": 1})).trajectory
    np.testing.assert_array_equal(alone.positions_m, tracked.trajectory.positions_m)


def test_without_events_it_stands_still_and_says_so(recording):
    """For as long as one likes; memory does not grow, and it goes on from there."""
    tracker, poses = tracker_of(recording)
    run(recording, range(50_000, 300_001, 50_000), tracker)
    for t_us in range(350_000, 2_000_000, 50_000):
        tracker.push([Events.empty()] * 2, t_us)
    assert tracker.status is Status.STILL
    assert poses[-1].t_us > 1_900_000
    assert sum(map(len, tracker._arrived.streams)) == 0
    held = [pose.T_world_body for pose in poses if pose.status is Status.STILL]
    np.testing.assert_array_equal(held[0], held[-1])
    assert len(tracker.known()) <= 1024


class DarkFrom(Wrapped):
    """A recording without events from some time on."""

    def __init__(self, recording, t_us):
        super().__init__(recording)
        self._t_us = t_us

    def events(self, camera, t0_us, t1_us):
        return self._recording.events(camera, t0_us, min(t1_us, self._t_us))


def test_the_beginning_is_confirmed_as_soon_as_a_second_map_is_due(recording):
    """Law: what goes wrong right after its events says nothing against the poses before."""
    windows_us, config = [], CONFIG.model_copy(update={"rate_hz": 100})
    track(recording, config, on_map=lambda online: windows_us.append(online.window.t1_us))
    dark = track(DarkFrom(recording, windows_us[0] + 15_000), config)
    before = dark.trajectory.t_us < windows_us[0] - 20_000
    assert before.sum() > 10
    assert {s for s, is_before in zip(dark.statuses, before, strict=True) if is_before} == {
        Status.TRACKING
    }


@pytest.mark.parametrize(("for_us", "judged"), [(50_000, [False]), (200_000, [True])])
def test_once_doubted_for_a_while_it_leaves_out_what_drifts(recording, monkeypatch, for_us, judged):
    """Before, all that is seen may say that the rig turned back at once."""
    tracker, poses = tracker_of(recording)
    run(recording, range(10_000, 300_001, 10_000), tracker)
    asked, nearby = [], tracker._registration.nearby

    def noted(batches, expected, *, judged=False):
        asked.append(judged)
        return nearby(batches, expected, judged=judged)

    monkeypatch.setattr(tracker._registration, "nearby", noted)
    tracker.status, tracker._trust.reason = Status.UNCERTAIN, "the scale is off by 9.0 %"
    tracker.since_us = poses[-1].t_us - for_us
    run(recording, [310_000], tracker, lambda _, events: events.take(events.t_us >= 300_000))
    assert asked[:1] == judged


def test_what_was_seen_before_the_first_map_is_tracked_too(recording, monkeypatch):
    """The first stretch shows too little, as of a rig that hardly moves: it grows."""
    tries = []

    def begin_later(*arguments):
        tries.append(arguments)
        return "nothing to see yet" if len(tries) < 3 else begin(*arguments)

    monkeypatch.setattr("eventsweep.plugins.track.odometry.beginning.begin", begin_later)
    tracker, poses = tracker_of(recording)
    run(recording, [290_000, 310_000], tracker)
    assert len(tries) == 3
    assert poses[0].t_us < 20_000
    assert worst_m(tracker.known(), recording.trajectory) < 0.006


def test_the_first_stereo_sees_every_event_however_few_make_a_map(recording, monkeypatch):
    """Thinned by itself, each camera would keep other pixels' newest events."""
    shown = {}

    def mapped(arrived, config, *, window):
        counts = [len(arrived.events(k, window.t0_us, window.t1_us)) for k in (0, 1)]
        there = [len(stream.between(window.t0_us, window.t1_us)) for stream in arrived.streams]
        shown.setdefault(config.methods[0], (counts, there))
        return map_window(arrived, config, window=window)

    monkeypatch.setattr("eventsweep.plugins.track.odometry.start.map_window", mapped)
    few = CONFIG.model_copy(update={"map_events": 1000})
    run(recording, [250_000], tracker_of(recording, few)[0])
    counts, there = shown["SGM/ts"]
    assert counts == there
    assert min(there) > 1000


def test_until_it_begins_it_holds_a_bounded_stretch(recording, monkeypatch):
    spans_us = []

    def never(_arrived, batches, *_rest):
        spans_us.append(batches[-1].t_us - batches[0].t_us)
        return "nothing to see"

    monkeypatch.setattr("eventsweep.plugins.track.odometry.beginning.begin", never)
    tracker, _ = tracker_of(recording)
    run(recording, range(50_000, END_US + 1, 50_000), tracker)
    assert spans_us[0] < spans_us[1] < max(spans_us) <= LONGEST_START_US
    oldest_us = min(stream.between(0, END_US).t_us[0] for stream in tracker._arrived.streams)
    assert oldest_us >= END_US - LONGEST_START_US - 50_000


@pytest.mark.parametrize(("gap_us", "held"), [
    pytest.param(30_000, False, id="short"),
    pytest.param(60_000, True, marks=pytest.mark.slow, id="longer than a batch"),
])  # fmt: skip
def test_packets_may_be_missing(recording, gap_us, held):
    """All of both cameras for a while, and of each camera a tenth, at its own times."""
    tracker, poses = tracker_of(recording)

    def dropped(k, events):
        some = events.take((events.t_us // 1000 + 5 * k) % 10 != 0)
        return some.take((some.t_us < 310_000) | (some.t_us >= 310_000 + gap_us))

    said = run(recording, range(10_000, END_US + 1, 10_000), tracker, dropped)
    assert Status.LOST not in said
    assert (Status.STILL in said) == held
    assert said[-1] is Status.TRACKING
    assert poses[-1].t_us > END_US - 40_000
    ends_us = tracker.known().t_us[[0, -1]]
    ends = Trajectory.from_matrices(ends_us, tracker.known().at(ends_us))
    assert worst_m(ends, recording.trajectory) < 0.006


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera", [pytest.param(0, id="left is silent"), pytest.param(1, id="right is silent")]
)
def test_one_camera_may_be_silent_for_a_while(recording, camera):
    tracker, _ = tracker_of(recording)

    def silent(k, events):
        quiet = (events.t_us > 220_000) & (events.t_us < 420_000)
        return events.take(~quiet) if k == camera else events

    said = run(recording, range(10_000, END_US + 1, 10_000), tracker, silent)
    assert Status.LOST not in said
    assert said[-1] is Status.TRACKING
    assert worst_m(tracker.known(), recording.trajectory) < 0.012


def noise(rng, packet, rate, camera):
    """A packet with events at random pixels beside its own."""
    if not len(packet):
        return packet
    first_us, last_us = int(packet.t_us[0]), int(packet.t_us[-1]) + 1
    t_us = np.sort(rng.integers(first_us, last_us, rate * (last_us - first_us) // 1000))
    x = rng.integers(0, camera.width_px, len(t_us)).astype(np.uint16)
    y = rng.integers(0, camera.height_px, len(t_us)).astype(np.uint16)
    mixed = Events.concat([packet, Events(x, y, t_us, np.ones(len(t_us), np.uint8))])
    return mixed.take(np.argsort(mixed.t_us, kind="stable"))


@pytest.mark.slow
def test_hot_pixels_and_a_burst_of_noise_do_not_lead_it_astray(recording):
    rng = np.random.default_rng(0)
    tracker, _ = tracker_of(recording)

    def disturbed(k, events):
        burst = len(events) and 300_000 <= events.t_us[0] < 320_000
        noisy = noise(rng, events, 100 if burst else 1, recording.rig.cameras[k])
        hot = Events(
            *(np.repeat(column[::50], 3) for column in (noisy.x, noisy.y, noisy.t_us, noisy.p))
        )
        hot = replace(hot, x=np.full_like(hot.x, 31), y=np.full_like(hot.y, 17))
        mixed = Events.concat([noisy, hot])
        return mixed.take(np.argsort(mixed.t_us, kind="stable"))

    said = run(recording, range(10_000, END_US + 1, 10_000), tracker, disturbed)
    assert said[-1] is Status.TRACKING
    assert worst_m(tracker.known(), recording.trajectory) < 0.015


@pytest.mark.slow
def test_what_the_map_does_not_show_is_lost_with_a_reason_and_the_place_found_again(recording):
    """The world is another one for 0.14 s; then it is the old one again."""
    elsewhere = line_world.recorded(recording.trajectory, seed=7)
    tracker, poses = tracker_of(recording)
    run(recording, range(10_000, 260_001, 10_000), tracker)
    said = {}
    for t_us in range(270_000, END_US + 1, 10_000):
        world_now = elsewhere if t_us <= 400_000 else recording
        tracker.push([world_now.events(k, t_us - 10_000, t_us) for k in (0, 1)], t_us)
        said.setdefault(tracker.status, (t_us, tracker.reason))
    assert said[Status.LOST][0] <= 400_000
    assert "events and map agree to" in said[Status.LOST][1]
    assert tracker.status is Status.UNCERTAIN  # so soon after it was lost
    later = [pose for pose in poses if pose.t_us > 410_000]
    assert later
    assert worst_m(tracker.known(), recording.trajectory) < 0.05
    first, last = poses[0], later[-1]
    G = recording.trajectory.at([first.t_us, last.t_us])
    off = se3.inverse(se3.inverse(G[0]) @ G[1]) @ se3.inverse(first.T_world_body)
    assert np.linalg.norm((off @ last.T_world_body)[:3, 3]) < 0.01


def test_what_it_needs_is_said_in_one_line(recording):
    alone = line_world.recorded(recording.trajectory, cameras=1)
    refused("first_map", Tracker, alone.rig)
    tracker = Tracker(recording.rig)
    refused("no poses yet", tracker.known)
    empty = world.Recorded(
        recording.rig, recording.trajectory, tuple(s.slice(0, 50) for s in recording.streams)
    )
    refused("tracking could not start", track, empty)


def shifted(recording, by_us):
    """The same recording on another clock."""
    path = recording.trajectory
    path = Trajectory(path.t_us + by_us, path.positions_m, path.quats_xyzw)
    streams = tuple(stream.shifted(by_us) for stream in recording.streams)
    return replace(recording, trajectory=path, streams=streams)


@pytest.mark.slow
def test_poses_do_not_depend_on_where_the_clock_begins(recording, tracked):
    far_us = 1_700_000_000_000_000
    there = track(shifted(recording, far_us), CONFIG)
    np.testing.assert_array_equal(there.trajectory.t_us - far_us, tracked.trajectory.t_us)
    np.testing.assert_allclose(
        there.trajectory.positions_m, tracked.trajectory.positions_m, atol=1e-4
    )
    assert there.statuses == tracked.statuses


def scattered(recording, t0_us, t1_us, count, seed):
    """Events anywhere, of every camera."""
    rng, packets = np.random.default_rng(seed), []
    for camera in recording.rig.cameras:
        t_us = np.sort(rng.integers(t0_us, t1_us, count))
        x, y = rng.integers(0, camera.width_px, count), rng.integers(0, camera.height_px, count)
        packets.append(Events(x.astype(np.uint16), y.astype(np.uint16), t_us, (x % 2).astype("u1")))
    return packets


@pytest.mark.parametrize("jump_us", [3_600_000_000, 1_700_000_000_000_000])
def test_a_jump_of_the_clock_is_stepped_over(recording, jump_us):
    """A body that stood still all the time is found where it was; the way over costs nothing."""
    tracker, poses = tracker_of(recording)
    run(recording, [END_US], tracker)
    assert tracker.status is Status.TRACKING
    known = len(poses)
    tracker.push([Events.empty()] * 2, jump_us)
    packets = scattered(recording, jump_us, jump_us + 10_000, 20, 0)
    tracker.push(packets, jump_us + 10_000)
    assert len(poses) - known < 1100  # ten seconds of a body that stands
    assert poses[-1].status is not Status.TRACKING
    assert tracker.push([Events.empty()] * 2, 2 * jump_us) is not None


@pytest.mark.parametrize("packets", [400, pytest.param(3000, marks=pytest.mark.slow)])
def test_silence_noise_and_jumps_take_no_memory_and_are_never_tracking(recording, packets):
    tracker, poses = tracker_of(recording)
    run(recording, [END_US], tracker)
    known, t_us = len(poses), END_US + 100_000
    tracker.push([Events.empty()] * 2, t_us)
    for k in range(packets):
        t_us += 3_600_000_000 if k % 100 == 99 else 0
        sent = scattered(recording, t_us, t_us + 1000, 0 if k // 50 % 3 == 0 else 20, k)
        t_us += 1000
        tracker.push([sent[0], Events.empty() if k // 50 % 3 == 1 else sent[1]], t_us)
    late = [pose.status for pose in poses[known:] if pose.t_us > END_US + 50_000]
    assert Status.TRACKING not in late
    assert sum(map(len, tracker._arrived.streams)) < 10_000
    assert len(tracker._poses) <= 1024
    assert len(tracker._silence.spans) <= 2


@pytest.mark.parametrize("per_10_ms", [300, 3000])
def test_noise_alone_is_never_tracked(recording, per_10_ms):
    """However much of it comes: behind a covered lens nothing is known, and said to be."""
    tracker, poses = tracker_of(recording)
    run(recording, range(10_000, END_US + 1, 10_000), tracker)
    for t_us in range(END_US, END_US + 400_000, 10_000):
        tracker.push(scattered(recording, t_us, t_us + 10_000, per_10_ms, t_us), t_us + 10_000)
    late = {pose.status for pose in poses if pose.t_us > END_US + 40_000}
    assert Status.TRACKING not in late
    assert tracker.status is not Status.TRACKING
    fresh, _ = tracker_of(recording)
    for t_us in range(0, 400_000, 10_000):
        fresh.push(scattered(recording, t_us, t_us + 10_000, per_10_ms, t_us), t_us + 10_000)
    assert fresh.status is Status.STARTING
