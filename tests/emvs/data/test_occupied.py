"""Where events are: long silences are found however a recording is read, and stepped over."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.event_store import EventStoreReader, EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import (
    LONGEST_SILENCE_US,
    Silence,
    beginning,
    camera_spans,
    closed_up,
    joined,
    length_of,
    occupied_spans,
    silences,
    spans_of,
    spread,
    steps,
)
from eventsweep.emvs.formats import open_events, write_events

EPOCH_US = 1_700_000_000_000_000
STEPS_US = st.one_of(
    st.integers(0, 100_000), st.integers(0, 3 * LONGEST_SILENCE_US), st.just(LONGEST_SILENCE_US)
)
TIMES = st.lists(STEPS_US, min_size=1, max_size=30).map(lambda steps: np.cumsum(steps))


def events_at(t_us):
    t_us = np.asarray(t_us, np.int64)
    x = np.zeros(len(t_us), np.uint16)
    return Events(x, x, t_us, x.astype(np.uint8))


class InMemory:
    """Events of cameras, asked for by time alone; counts what is asked."""

    def __init__(self, *times):
        self.streams, self.asked = [events_at(t_us) for t_us in times], 0
        self.rig = [None] * len(times)

    def event_span_us(self, camera):
        t_us = self.streams[camera].t_us
        return int(t_us[0]), int(t_us[-1])

    def events(self, camera, t0_us, t1_us):
        self.asked += 1
        return self.streams[camera].between(t0_us, t1_us)


@given(TIMES)
def test_a_recording_that_is_only_asked_has_the_spans_of_its_times(t_us):
    assert list(camera_spans(InMemory(t_us), 0)) == spans_of(t_us)


@given(TIMES, TIMES)
def test_spans_hold_every_event_and_no_long_silence(first, second):
    recording, end_us = InMemory(first, second), max(first[-1], second[-1]) + 1
    spans, both = occupied_spans(recording, 0, end_us), np.sort(np.concatenate([first, second]))
    inside = [np.count_nonzero((both >= a) & (both < b)) for a, b in spans]
    assert sum(inside) == len(both)
    assert all(b - a >= LONGEST_SILENCE_US - 1 for a, b in silences(spans))
    gaps = np.diff(np.concatenate([[0], both, [end_us]]))
    assert length_of(spans) <= end_us
    assert (len(spans) == 1 and length_of(spans) == end_us) == bool(
        (gaps[1:-1] < LONGEST_SILENCE_US).all() and gaps[0] < LONGEST_SILENCE_US
    )


@given(TIMES, st.integers(0, 2**50))
def test_spans_move_with_the_clock(t_us, shift_us):
    moved = [(a + shift_us, b + shift_us) for a, b in spans_of(t_us)]
    assert spans_of(t_us + shift_us) == moved
    ends = [(a, b + 1) for a, b in spans_of(t_us)]
    begins = spread(ends, 1000, 7)
    there = spread([(a + shift_us, b + shift_us) for a, b in ends], 1000, 7)
    np.testing.assert_array_equal(there, begins + shift_us)


@pytest.mark.parametrize("far_us", [3_600_000_000, EPOCH_US])
def test_a_jump_costs_a_few_looks(far_us):
    recording = InMemory(np.array([0, 1000, far_us, far_us + 1000]))
    expected = ((0, 1001), (far_us, far_us + 1001))
    assert occupied_spans(recording, 0, far_us + 1001) == expected
    assert recording.asked < 100
    assert list(steps(expected, 1_000_000)) == list(expected)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, 25_000_000), min_size=1, max_size=12).map(np.cumsum))
def test_files_know_the_spans_of_their_times(tmp_path_factory, t_us):
    folder = tmp_path_factory.mktemp("files")
    with EventStoreWriter(folder / "e.h5", 4, 4) as writer:
        writer.append(events_at(t_us))
    assert EventStoreReader(folder / "e.h5", 4, 4).occupied_us() == spans_of(t_us)
    for kind in ("npz", "tumvie", "aedat4"):
        write_events(folder / kind, kind, 4, 4, {"events": iter([events_at(t_us)])})
        reader = open_events(folder / kind)
        whole = joined(reader.occupied_us(reader.streams[0]), 0, int(t_us[-1]) + 1)
        assert whole == joined(spans_of(t_us), 0, int(t_us[-1]) + 1)


@given(TIMES)
def test_closed_up_times_keep_their_order_and_lose_the_silences(t_us):
    spans = [(a, b + 1) for a, b in spans_of(t_us)]
    closed = closed_up(t_us, spans)
    assert closed[0] == t_us[0]
    assert (np.diff(closed) >= 0).all()
    assert closed[-1] - closed[0] < length_of(spans)
    short = np.diff(t_us) < LONGEST_SILENCE_US
    np.testing.assert_array_equal(np.diff(closed)[short], np.diff(t_us)[short])
    assert length_of(beginning(spans, 1_000)) == min(1_000, length_of(spans))


@given(TIMES, st.integers(1, 4))
def test_silence_is_the_same_however_events_come(t_us, parts):
    at_once, by_parts = Silence(), Silence()
    at_once.push([t_us])
    for part in np.array_split(t_us, parts):
        by_parts.push([part])
    assert at_once.spans == by_parts.spans == spans_of(t_us)
    last_us = int(t_us[-1])
    for now_us in range(0, last_us + 3 * LONGEST_SILENCE_US, LONGEST_SILENCE_US // 3):
        before = t_us[t_us < now_us]
        silent = len(before) > 0 and now_us - before[-1] > LONGEST_SILENCE_US
        end_us = at_once.end_us(now_us, last_us + 10 * LONGEST_SILENCE_US)
        assert (end_us is not None) == silent
        if end_us is not None:
            later = t_us[t_us >= now_us]
            assert end_us == (later[0] + 1 if len(later) else last_us + 10 * LONGEST_SILENCE_US)


def test_another_clock_moves_the_spans():
    known = SimpleNamespace(rig=[None], occupied_us=lambda _camera: [(0, 10), (10**9, 10**9 + 1)])
    altered = AlteredRecording(known, clock_us=[5])
    assert list(altered.occupied_us(0)) == [(5, 15), (10**9 + 5, 10**9 + 6)]
