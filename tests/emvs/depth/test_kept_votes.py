"""Votes in a byte: their precision, what is summed, and patches out of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eventsweep.emvs.depth.kept_votes import LANES, KeptVotes, votes_of_codes

VOTES = st.floats(0, 60_000, width=32)


def kept_of(votes, **values):
    planes, height, width = votes.shape[1:]
    kept = KeptVotes(len(votes) // values.get("polarities", 1), planes, height, width, **values)
    kept.take(0, votes)
    return kept


@given(arrays(np.float32, (1, 2, 3, 5), elements=VOTES))
def test_a_byte_keeps_votes_within_a_thirty_second_part(votes):
    """Law: half a step of the mantissa's four bits, relative to votes + 1."""
    back = votes_of_codes()[kept_of(votes).codes]
    assert np.all(abs(back - votes) <= (votes + 1) / 32 * (1 + 1e-6))


@given(arrays(np.float32, (1, 1, 1, 40), elements=VOTES))
def test_more_votes_never_get_a_smaller_code(votes):
    codes = kept_of(np.sort(votes)).codes.astype(int)
    assert np.all(np.diff(codes) >= 0)


def test_whole_votes_up_to_two_come_back_exactly_and_the_largest_code_saturates():
    votes = np.array([0, 1, 2, 63487, 1e6, 3e38], np.float32).reshape(1, 1, 1, -1)
    back = votes_of_codes()[kept_of(votes).codes].ravel()
    np.testing.assert_array_equal(back, [0, 1, 2, 63487, 63487, 63487])


def test_polarities_and_sub_intervals_of_a_camera_are_summed():
    rng = np.random.default_rng(0)
    votes = rng.integers(0, 2, (2 * 3, 4, 5, 6)).astype(np.float32)  # 2 polarities, 3 cameras
    kept = kept_of(votes, polarities=2)
    back = votes_of_codes()[kept.codes]
    np.testing.assert_array_equal(back, votes[:3] + votes[3:])


def test_planes_come_in_batches():
    votes = np.random.default_rng(1).gamma(2, 3, (2, 7, 5, 6)).astype(np.float32)
    whole, parts = kept_of(votes), KeptVotes(2, 7, 5, 6)
    for first in (0, 3, 6):
        parts.take(first, votes[:, first : first + 3])
    np.testing.assert_array_equal(parts.codes, whole.codes)


@pytest.mark.parametrize("count", [0, 1, LANES, LANES + 3])
def test_patches_hold_the_votes_around_each_pixel(count):
    """Against indexing of the padded volume, pixel by pixel."""
    rng = np.random.default_rng(2)
    kept = kept_of(rng.gamma(2, 3, (2, 9, 14, 15)).astype(np.float32))
    rows, columns = rng.integers(2, 12, count), rng.integers(2, 13, count)
    centres, strides = rng.integers(0, 9, count), rng.integers(1, 4, count)
    out = kept.patches(rows, columns, centres, strides, 5, 5)
    assert out.shape == (2, -(-count // LANES), 5, 5, 5, LANES)
    pad = 6
    votes = np.pad(votes_of_codes()[kept.codes], ((0, 0), (pad, pad), (0, 0), (0, 0)))
    pixels = np.moveaxis(out, -1, 2).reshape(2, -1, 5, 5, 5)
    for m in range(count):
        planes = pad + centres[m] + strides[m] * np.arange(-2, 3)
        y, x = rows[m], columns[m]
        expected = votes[:, planes, y - 2 : y + 3, x - 2 : x + 3]
        np.testing.assert_array_equal(pixels[:, m], expected)
    assert not pixels[:, count:].any()
