"""What NumPy pickled is read without running anything: the same plain values, and nothing else."""

import contextlib
import io
import os
import pickle
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.datasets.evimo2 import object_values
from eventsweep.emvs.errors import InputError
from refusals import refused

LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.floats(allow_nan=False),
    st.text(max_size=8), st.binary(max_size=300),
)  # fmt: skip
KEYS = st.one_of(st.text(max_size=6), st.integers(-(2**60), 2**60))
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.tuples(inner, inner, inner, inner),
        st.dictionaries(
            st.one_of(st.text(max_size=6), st.integers(-(2**60), 2**60)), inner, max_size=4
        ),
    ),
    max_leaves=12,
)


def pickled(value, protocol):
    """As `numpy.save` does it."""
    array = np.empty((), object)
    array[()] = value
    return pickle.dumps(array, protocol=protocol)


@given(value=VALUES, protocol=st.sampled_from([3, 4]))
def test_the_values_are_those_that_were_pickled(value, protocol):
    """By the protocols that `numpy.save` takes today."""
    assert object_values(pickled(value, protocol), "f") == value


def test_what_numpy_saves_is_read():
    buffer = io.BytesIO()
    value = {"frames": [{"ts": 0.5, "id": 2**64 - 1}], "meta": {"fx": 1.5}}
    np.save(buffer, value, allow_pickle=True)
    data = buffer.getvalue()
    assert object_values(data[data.index(b"\n") + 1 :], "f") == value
    assert object_values(pickled(value, 2), "f") == value  # as NumPy before 1.17 did


class Hostile:
    def __reduce__(self):
        return os.system, ("touch /tmp/eventsweep-was-here",)


@pytest.mark.parametrize("protocol", range(5))
@pytest.mark.parametrize("value", [Hostile(), [np.float64(1)], {"a": complex(1, 2)}, os.getcwd])
def test_anything_else_is_refused_and_nothing_is_run(protocol, value):
    said = refused("plain values", object_values, pickled(value, protocol), "file, array meta")
    assert said.startswith("file, array meta: ")
    assert said.isprintable()


@pytest.mark.parametrize("data", [
    b"", b".", b"N.", b"\x80\x04" + b"r\xff\xff\xff\xff", b"\x80\x04" + b"\x8d" + b"\xff" * 8,
    b"(" * 1000, b"]" * 10 + b".", b"2" * 5, b"\x8b\xff\xff\xff\x7f", b"h\x05.", b"e.", b"a.",
    pickle.dumps([1, 2]), pickle.dumps(np.arange(3)),
    pickled(1, 4)[:-1], pickled({"a": [1, 2]}, 4)[:40],
    b"\x8a\x11" + b"\x01" * 17 + b".", b"I" + b"9" * 10_000 + b"\n.",
    b"\x80\x04Nr\xff\xff\xff\xff.", b"\x80\x05\x96" + b"\xff" * 5 + b"\0\0\0.",
    b"\x80\x02\x82\x01.",
    pickled({(1, 2): 3}, 4), pickled({3}, 4), b"cnumpy\nndarray\n)R}U\x04nameNsb.",
])  # fmt: skip
def test_damage_ends_in_one_line(data):
    said = refused("", object_values, data, "f")
    assert said.isprintable()
    assert len(said) < 500


def test_every_byte_may_be_damaged():
    data = pickled({"frames": [{"ts": 0.5, "cam": {"pos": [1, 2.5]}}] * 3, "n": None}, 4)
    rng = np.random.default_rng(1)
    harmless = set()
    for k in range(len(data)):
        for value in (0, 255, *rng.integers(0, 256, 6).tolist()):
            with contextlib.suppress(InputError):
                object_values(data[:k] + bytes([value]) + data[k + 1 :], "f")
                harmless.add(k)
    assert 0 < len(harmless) < len(data)


def test_keys_that_hash_alike_take_no_time():
    """Of 60,000 such keys each would be compared with all before it."""
    data = pickled({k * sys.hash_info.modulus: None for k in range(1, 4)}, 4)
    refused("a mapping with a key beyond", object_values, data, "f")
