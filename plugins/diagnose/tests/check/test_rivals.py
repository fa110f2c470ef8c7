"""What must hold before a cause is named: a decisive gain, and no rival that explains as much.

Conventions that no motion tells apart are named together, amounts that trade off are not.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep.plugins.diagnose.check.alternatives import Alternative, Amount, amounts, of_pair
from eventsweep.plugins.diagnose.check.by_mapping import (
    _is_ambiguous,
    _may_be_second,
    _other_firsts,
    _several,
    _undecided,
)
from eventsweep.plugins.diagnose.check.trials import CameraTrials, Trial

CONVENTION = Alternative("poses inverted", lambda r: r, "invert them")
OTHER = Alternative("rotations inverted", lambda r: r, "invert them")
SWAPPED = of_pair()[0]
AMOUNTS = {
    amount.name: amount
    for amount in amounts("focal", "pose-delay", "hand-eye", "delay", "baseline", "stereo")
}


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


def log_sharpness(coupling):
    """Of windows where the amounts (a, b) should be (2, 0); near 1 or -1 they trade off."""

    def of(change):
        a, b = change((0.0, 0.0))
        return np.array([-0.01 * ((a - 2 + coupling * b) ** 2 + (1 - coupling**2) * b**2)])

    return of


@pytest.mark.parametrize(
    ("coupling", "traded"), [(0.0, False), (-0.9, False), (1.0, True), (-1.0, True)]
)
def test_an_amount_is_traded_where_another_one_makes_up_for_it(coupling, traded):
    """Beside `b` = 4 the best `a` loses 0.16 (1 - coupling^2) of sharpness."""
    a, b = (
        Amount(name, change, "", grid=(-8.0, 0.0, 8.0), hurts=1.0)
        for name, change in (("a", lambda s, x: (s[0] + x, s[1])),
                             ("b", lambda s, x: (s[0], s[1] + x)))
    )  # fmt: skip
    trials = CameraTrials.__new__(CameraTrials)
    trials._leading_gains = trials._coarse_gains = log_sharpness(coupling)
    best = Trial(a, np.full(3, 0.2), lambda s: a.change(s, 2.0), 0.04, amount=2.0)
    assert trials.is_traded(best, b) == traded


def test_what_gains_besides_a_cause_leaves_several():
    clock = AMOUNTS["camera clock"]
    late = Trial(clock, np.full(3, 0.05), lambda r: r, 0.015, amount=20.0)
    assert "more than one thing" in _several(None, [trial(CONVENTION)], late, [clock])
    assert _several(None, [trial(CONVENTION)], None, [clock]) == ""


@pytest.mark.parametrize(("first", "after", "rival"), [(0.2, 0.2, True), (0.2, 0.05, False)])
def test_another_first_cause_with_a_second_one_like_it_is_a_rival(first, after, rival):
    """Mirrored rows and left-handed poses: each needs its own pair mistake to explain as much."""
    best, second = trial(CONVENTION), trial(SWAPPED)
    other, inverted = trial(OTHER, (first,) * 3), of_pair()[1]

    def trials_after(others, most):
        assert most
        assert all(alternative.of_pair for alternative in others)
        return [trial(a, ((after if a.name == inverted.name else 0.0),) * 3) for a in others]

    trials = SimpleNamespace(after=lambda _: SimpleNamespace(trials=trials_after))
    rivals = tuple(_other_firsts(trials, (best, second), [best, other], [OTHER, *of_pair()]))
    assert rivals == ((other,) if rival else ())
