"""What must hold before a cause is named: a decisive gain, and no rival that explains as much.

Conventions that no motion tells apart are named together, amounts that trade off are not.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep.emvs.check.alternatives import Alternative, amounts_of_one, amounts_of_pair, of_pair
from eventsweep.emvs.check.by_mapping import _is_ambiguous, _may_be_second, _undecided
from eventsweep.emvs.check.trials import Trial

CONVENTION = Alternative("poses inverted", lambda r: r, "invert them")
OTHER = Alternative("rotations inverted", lambda r: r, "invert them")
SWAPPED = of_pair()[0]
AMOUNTS = {one.name: one for one in (*amounts_of_one(paired=True), *amounts_of_pair())}


def trial(alternative, gains=(0.2, 0.2, 0.2)):
    return Trial(alternative, np.array(gains), lambda r: r, 0.04)


@pytest.mark.parametrize(
    ("cause", "gains", "turn", "squint", "decisive"),
    [
        (CONVENTION, (0.11, 0.06, 0.14), 0.0, 0.0, True),
        (CONVENTION, (0.11, 0.06, 0.11), 0.0, 0.0, False),  # 9.3 % on average
        (CONVENTION, (0.6, 0.2, 0.04), 0.0, 0.0, False),  # fits one window by chance
        (CONVENTION, (0.2, 0.2, 0.2), 0.14, 0.0, False),  # any small turn does nearly as much
        (CONVENTION, (0.2, 0.2, 0.2), 0.0, 0.14, False),
        (AMOUNTS["stereo yaw"], (0.2, 0.2, 0.2), 0.0, 0.14, True),  # a turn of that camera
        (AMOUNTS["stereo yaw"], (0.2, 0.2, 0.2), 0.14, 0.0, False),
        (CONVENTION, (0.11,), 0.0, 0.0, True),
    ],
)
def test_only_a_decisive_gain_is_named(cause, gains, turn, squint, decisive):
    free = SimpleNamespace(free_turn_gains=np.array([turn]), free_squint_gains=np.array([squint]))
    assert (_undecided(free, [trial(cause, gains)]) == "") == decisive
    half = trial(cause, np.array(gains) / 2)
    assert (_undecided(free, [half, half]) == "") == decisive


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
        (AMOUNTS["stereo yaw"], AMOUNTS["stereo pitch"], False),  # they trade off
        (AMOUNTS["pose clock"], AMOUNTS["pose clock"], False),
    ],
)
def test_which_two_can_be_wrong_at_once(first, second, possible):
    assert _may_be_second(second, first) == possible
