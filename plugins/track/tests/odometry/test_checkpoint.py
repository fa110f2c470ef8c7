"""States come back from files as they were, and damaged files are refused in one line."""

from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import point_world as world
from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.track.folder import _identity
from eventsweep.plugins.track.odometry.checkpoint import read_state, write_state
from eventsweep.plugins.track.odometry.config import TrackConfig
from line_world import Wrapped
from refusals import refused

PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
ARRAYS = arrays(st.sampled_from(["i8", "f4", "u1", "?"]), array_shapes(min_dims=1, min_side=0))
NAMES = st.text(min_size=1, max_size=4).filter(lambda name: name != "array")
VALUES = st.recursive(
    PLAIN | ARRAYS, lambda each: st.lists(each, max_size=3) | st.dictionaries(NAMES, each)
)


def same(one, other):
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype == "f4")
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


@settings(max_examples=30)
@given(state=st.dictionaries(NAMES, VALUES, max_size=4))
def test_a_state_comes_back_as_it_was(tmp_path_factory, state):
    path = tmp_path_factory.mktemp("state") / "state.npz"
    write_state(path, state)
    assert same(state, read_state(path))


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.integers(0, 255))
def test_a_damaged_file_is_refused_or_read(tmp_path_factory, place, value):
    path = tmp_path_factory.mktemp("state") / "state.npz"
    write_state(path, {"a": np.arange(50), "b": ["x", 1]})
    content = bytearray(path.read_bytes())
    content[place % len(content)] = value
    path.write_bytes(content)
    with suppress(InputError):
        assert set(read_state(path)) == {"a", "b"}


def test_a_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "state.npz"
    np.savez(path, other=np.arange(3))
    refused("no state of a tracker", read_state, path)
    refused("", read_state, tmp_path / "none.npz")


class WithImu(Wrapped):
    """A recording with inertial samples."""

    has_imu = True

    def __init__(self, recording, imu):
        super().__init__(recording)
        self.imu = imu


@pytest.mark.parametrize("changed", ["x", "calibration", "imu", "start", "map"])
def test_a_state_belongs_to_all_that_was_read(changed):
    """Law: of the same name, span and count, but with one value changed, it is another's."""

    def identity(change):
        recording = world.fronto_parallel(2.0)
        first = recording.streams[0]
        x = first.x.copy()
        x[len(x) // 2] += change == "x"
        rig = recording.rig if change != "calibration" else world.stereo_rig(world.pinhole(), 0.11)
        recording = replace(recording, rig=rig, streams=(replace(first, x=x), recording.streams[1]))
        t_us, rates = np.arange(3), np.full((3, 3), float(change == "imu"))
        recording = WithImu(recording, lambda: ImuSamples(t_us, rates, rates))
        start = np.eye(4) * (2 if change == "start" else 1)
        depth_m = np.full((2, 2), 2.0 + (change == "map"))
        depth = SimpleNamespace(
            t_us=0, camera=world.pinhole(), depth_m=depth_m, mask=depth_m > 0, T_world_rv=start
        )
        return _identity(recording, TrackConfig(gyroscope=True), depth, start)

    assert identity("") == identity("")
    assert identity("") != identity(changed)
