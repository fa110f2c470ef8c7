"""Events and their store: laws of slicing, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.data.event_store import EventStoreReader, EventStoreWriter
from eventsweep.emvs.data.events import Events
from made_events import assert_same_events, events_at
from refusals import refused


def make_events(t_us: list[int]) -> Events:
    return events_at(np.random.default_rng(0), sorted(t_us), 40, 30)


def store(path: Path, parts: list[Events]) -> EventStoreReader:
    with EventStoreWriter(path, 40, 30) as writer:
        for part in parts:
            writer.append(part)
    return EventStoreReader(path, 40, 30)


times = st.lists(st.integers(-5_000, 60_000), max_size=80)


@given(
    times, st.sampled_from([0, 1_468_939_993_067_123]), st.integers(-10_000, 70_000),
    st.integers(-10_000, 70_000), st.integers(0, 80),
)  # fmt: skip
def test_store_gives_back_every_slice(tmp_path, t_us, late_us, t0_us, t1_us, cut):
    events = make_events(t_us).shifted(late_us)
    reader = store(tmp_path / "e.h5", [events.slice(0, cut), events.slice(cut, len(events))])
    assert reader.count == len(events)
    assert reader.ends_us() == ((events.t_us[0], events.t_us[-1]) if len(events) else None)
    part = reader.read(t0_us + late_us, t1_us + late_us)
    assert_same_events(part, events.between(t0_us + late_us, max(t0_us, t1_us) + late_us))


@given(times, st.integers(-6_000, 61_000))
def test_two_slices_make_a_whole(t_us, cut):
    events = make_events(t_us)
    parts = [events.between(-(10**9), cut), events.between(cut, 10**9)]
    assert_same_events(Events.concat(parts), events)


def test_index_is_the_published_one(tmp_path):
    """t[ms_to_idx[m]] >= 1000 m, and the event before is earlier (DSEC's definition)."""
    events = make_events(list(np.random.default_rng(3).integers(7_000, 90_000, 500)))
    reader = store(tmp_path / "e.h5", [events])
    with h5py.File(reader.path) as file:
        t, index = file["events/t"][:], file["ms_to_idx"][:].astype(int)
    for m, k in enumerate(index):
        assert t[k] >= 1000 * m
        assert k == 0 or t[k - 1] < 1000 * m


def one_event(x: int, y: int) -> Events:
    return Events(*(np.array([v], k) for v, k in ((x, "u2"), (y, "u2"), (5, "i8"), (1, "u1"))))


BACKWARDS = Events(np.zeros(2, "u2"), np.zeros(2, "u2"), np.array([5, 4]), np.zeros(2, "u1"))
UNEVEN = Events(np.zeros(2, "u2"), np.zeros(1, "u2"), np.array([5]), np.zeros(1, "u1"))


@pytest.mark.parametrize(("events", "words"), [
    (BACKWARDS, "sort"), (one_event(40, 0), "outside"), (one_event(0, 30), "outside"),
    (UNEVEN, "lengths"), (make_events([19]), "time order"),
])  # fmt: skip
def test_impossible_events_are_refused(tmp_path, events, words):
    with EventStoreWriter(tmp_path / "e.h5", 40, 30) as writer:
        if words == "time order":
            writer.append(make_events([10, 20]))
        refused(words, writer.append, events)


@pytest.mark.parametrize("keep", [0, 10, 500, 2000])
def test_truncated_file_is_refused(tmp_path, keep):
    reader = store(tmp_path / "e.h5", [make_events(list(range(1000)))])
    reader.path.write_bytes(reader.path.read_bytes()[:keep])
    refused(r"e\.h5", EventStoreReader, reader.path, 40, 30)


def test_file_of_another_layout_is_refused(tmp_path):
    with h5py.File(tmp_path / "e.h5", "w") as file:
        file["something"] = 1
    refused("layout", EventStoreReader, tmp_path / "e.h5", 40, 30)


@pytest.mark.slow
def test_a_slice_of_a_hundred_million_events_needs_little_memory(tmp_path):
    """Writing and reading 100 M events stays below 300 MB of growth (they would fill 1.3 GB)."""
    import resource

    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    packet = 1_000_000
    with EventStoreWriter(tmp_path / "e.h5", 1280, 720) as writer:
        for k in range(100):
            rng = np.random.default_rng(k)
            writer.append(events_at(rng, np.arange(packet) // 20 + k * 50_000, 1280, 720))
    reader = EventStoreReader(tmp_path / "e.h5", 1280, 720)
    counts = [len(reader.read(t0, t0 + 10_000)) for t0 in range(0, 5_000_000, 10_000)]
    assert sum(counts) == 100 * packet
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000


@given(st.integers(1, 60), st.integers(1, 80))
def test_thinned_events_are_spread_evenly(count, most):
    events = make_events(list(range(count)))
    thinned = events.thinned(most)
    assert len(thinned) == min(count, most)
    steps = np.diff(thinned.t_us)
    assert steps.size == 0 or steps.max() - steps.min() <= 1
    assert thinned.t_us[0] == 0
    assert_same_events(events.thinned(count), events)
