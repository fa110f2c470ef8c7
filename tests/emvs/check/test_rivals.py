"""Rivals: conventions that no motion tells apart are named together, amounts that trade off not."""

import numpy as np
import pytest

from eventsweep.emvs.check.alternatives import Alternative, amounts_of_one, amounts_of_pair, of_pair
from eventsweep.emvs.check.by_mapping import _is_ambiguous, _may_be_second
from eventsweep.emvs.check.trials import Trial

CONVENTION = Alternative("poses inverted", lambda r: r, "invert them")
OTHER = Alternative("rotations inverted", lambda r: r, "invert them")
SWAPPED = of_pair()[0]
AMOUNTS = {one.name: one for one in (*amounts_of_one(paired=True), *amounts_of_pair())}


def trial(alternative):
    return Trial(alternative, np.full(3, 0.2), lambda r: r, 0.04)


@pytest.mark.parametrize(
    ("cause", "rival", "ambiguous"),
    [
        (CONVENTION, OTHER, False),
        (CONVENTION, SWAPPED, True),  # in poses, or between the cameras?
        (CONVENTION, AMOUNTS["pose clock"], True),
        (AMOUNTS["stereo yaw"], AMOUNTS["baseline"], True),
    ],
)
def test_a_rival_leaves_open_what_is_wrong(cause, rival, ambiguous):
    assert not _is_ambiguous([trial(cause)], [])
    assert _is_ambiguous([trial(cause)], [trial(rival)]) == ambiguous
    assert _is_ambiguous([trial(cause), trial(SWAPPED)], [trial(rival)])


@pytest.mark.parametrize(
    ("first", "second", "possible"),
    [
        (CONVENTION, OTHER, False),
        (CONVENTION, AMOUNTS["hand-eye rotation about x"], False),  # fits too much by chance
        (AMOUNTS["hand-eye rotation about x"], CONVENTION, False),
        (CONVENTION, AMOUNTS["pose clock"], True),
        (CONVENTION, SWAPPED, True),
        (AMOUNTS["stereo yaw"], AMOUNTS["stereo pitch"], True),
        (AMOUNTS["pose clock"], AMOUNTS["pose clock"], False),
    ],
)
def test_which_two_can_be_wrong_at_once(first, second, possible):
    assert _may_be_second(second, first) == possible
