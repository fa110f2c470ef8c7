"""Maps online are the batch mapper's, to the bit, and take no more memory than they need."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import point_world as world
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.windows import plan_windows
from eventsweep.plugins.track.odometry import online
from eventsweep.plugins.track.odometry.online import OnlineMapper
from eventsweep.plugins.track.odometry.stream import Stream
from refusals import refused

CONFIG = MapperConfig(
    methods=("Alg1/H",), planes=20, min_depth_m=1.0, max_depth_m=4.0, window_s=0.1, stride_s=0.06
)


@pytest.fixture(scope="module")
def recording():
    return world.fronto_parallel(2.0)


def poses_between(trajectory, t0_us, t1_us):
    chosen = (trajectory.t_us >= t0_us) & (trajectory.t_us < t1_us)
    if not chosen.any():
        return None
    columns = trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw
    return Trajectory(*(column[chosen] for column in columns))


def pushed(recording, config, steps, late_us=0):
    """All maps of a mapper that is fed in packets which end at `steps`; poses come later."""
    mapper, maps, before_us = OnlineMapper(recording.rig, config), [], -1
    for t_us in steps:
        packets = [recording.events(k, before_us, t_us) for k in range(len(recording.rig))]
        poses = poses_between(recording.trajectory, before_us - late_us, t_us - late_us)
        maps += mapper.push(packets, t_us, poses)
        before_us = t_us
    return maps, mapper


@pytest.mark.parametrize("late_us", [0, 30_000])
@pytest.mark.parametrize("seed", [0, 1])
def test_maps_are_those_of_the_batch_mapper_to_the_bit(recording, seed, late_us):
    rng = np.random.default_rng(seed)
    steps = np.unique(np.r_[rng.integers(1, 500_001, 20), 600_000])
    maps, _ = pushed(recording, CONFIG, steps.tolist(), late_us)
    plan = plan_windows(recording, CONFIG)
    assert [made.window for made in maps] == [plan.window(k) for k in range(len(plan))]
    for made in maps:
        assert made.latency_us >= 0
        batch = map_window(recording, CONFIG, window=made.window).depth_maps["Alg1/H"]
        online = made.result.depth_maps["Alg1/H"]
        for name in ("depth_m", "mask", "confidence", "T_world_rv"):
            np.testing.assert_array_equal(getattr(online, name), getattr(batch, name))


def test_a_window_that_cannot_be_mapped_says_why_and_the_next_one_is(recording):
    config = CONFIG.model_copy(update={"stride_s": 0.1})

    def gap(events):
        return events.take((events.t_us < 100_000) | (events.t_us >= 200_000))

    holed = world.Recorded(recording.rig, recording.trajectory, tuple(map(gap, recording.streams)))
    maps, _ = pushed(holed, config, range(50_000, 600_001, 50_000))
    assert [made.result is None for made in maps] == [False, True, False, False]
    assert "events in the window" in maps[1].reason


def test_memory_holds_what_is_not_finished(recording):
    steps = range(10_000, 600_001, 10_000)
    _, mapper = pushed(recording, CONFIG, steps)
    held = sum(map(len, mapper._arrived.streams))
    assert held < 0.5 * sum(map(len, recording.streams))
    assert len(mapper._arrived.trajectory) < len(recording.trajectory)


def fed(mapper, packets, events_per_packet, poses, step_us=10_000, jump_us=0):
    """Pushes noise of both cameras, and poses unless they are silent; a jump half way."""
    rng, t_us = np.random.default_rng(0), 0
    for k in range(packets):
        t_us += jump_us if k == packets // 2 else 0
        at = np.sort(rng.integers(t_us, t_us + step_us, events_per_packet))
        x = rng.integers(0, 60, events_per_packet).astype(np.uint16)
        packet = Events(x, x, at, (x % 2).astype(np.uint8))
        t = np.array([t_us, t_us + step_us // 2])
        path = Trajectory(t, np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1))) if poses else None
        t_us += step_us
        mapper.push([packet, packet], t_us, path)
    return mapper


def test_events_without_poses_and_poses_without_events_take_bounded_memory(recording, monkeypatch):
    monkeypatch.setattr(online, "_MOST_WAITING", 3000)
    lone = fed(OnlineMapper(recording.rig, CONFIG), 400, 100, poses=False)
    assert lone.waits_for == "poses"
    held = [len(stream) for stream in lone._arrived.streams]
    assert held == [400 * 100 - dropped for dropped in lone.dropped_events]
    assert max(held) <= 3000
    silent = fed(OnlineMapper(recording.rig, CONFIG), 400, 0, poses=True)
    assert silent.waits_for == "events"
    assert len(silent._arrived.poses) <= 3
    assert silent.dropped_poses == 800 - len(silent._arrived.poses)


@pytest.mark.parametrize("jump_us", [3_600_000_000, 1_700_000_000_000_000])
def test_windows_in_a_long_silence_are_stepped_over_and_counted(recording, jump_us):
    mapper = fed(OnlineMapper(recording.rig, CONFIG), 40, 50, poses=True, jump_us=jump_us)
    assert mapper.skipped_windows == pytest.approx((jump_us - 10_000_000) / 60_000, abs=5)
    assert mapper._arrived.poses.span_us[0] > jump_us


@given(st.lists(st.tuples(st.integers(0, 50_000), st.integers(0, 70_000)), max_size=12))
def test_a_stream_gives_what_was_pushed_and_not_let_go(steps):
    """Law: however it moves in its memory, its events are those of all packets since the border."""
    stream, times, since_us, until_us, most = Stream(), np.empty(0, np.int64), 0, 0, 0
    for count, dropped in steps:
        t_us = until_us + np.arange(count, dtype=np.int64)
        xy, most = (t_us % 65_521).astype(np.uint16), max(most, len(stream) + count)
        stream.push(Events(xy, xy, t_us, (t_us % 2).astype(np.uint8)))
        until_us, since_us = until_us + count, max(since_us, until_us + count - dropped)
        stream.drop_before(since_us)
        times = np.concatenate([times, t_us])
        times = times[times >= since_us]
        whole, few = stream.between(0, until_us), stream.between(0, until_us, 1000)
        np.testing.assert_array_equal(whole.t_us, times)
        np.testing.assert_array_equal(whole.x, times % 65_521)
        np.testing.assert_array_equal(few.t_us, whole.thinned(1000).t_us)
        newest = stream.time_of_newest(100, until_us)
        assert newest == (times[-100] if len(times) >= 100 else None)
        assert len(stream._columns["t_us"]) <= max(1 << 16, 3 * most)


def test_what_comes_out_of_order_or_needs_a_whole_recording_is_refused(recording):
    mapper = OnlineMapper(recording.rig, CONFIG)
    first, second = recording.events(0, 0, 1000), recording.events(1, 0, 1000)
    refused("1 cameras: needs a packet for each of 2", mapper.push, [first], 1000)
    mapper.push([first, second], 1000)
    refused("push in time order", mapper.push, [first, second], 2000)
    refused("up to 1000 µs, then to 500 µs", mapper.push, [Events.empty()] * 2, 500)
    for setting in ({"hot_pixels": 3.0}, {"window_s": None, "stride_s": None}, {"start_s": 1.0}):
        refused("OnlineMapper", OnlineMapper, recording.rig, CONFIG.model_copy(update=setting))
