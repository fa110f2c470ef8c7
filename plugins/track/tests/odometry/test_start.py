"""The beginning expects a slow body or a fast one: whichever the events agree with more."""

import numpy as np
import pytest

from eventsweep.plugins.track.odometry import start
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.fit import Fit


def fits(near):
    return [Fit(1000, near, 1000, near, 0.75)] * 5


@pytest.mark.parametrize(("fast", "slow", "chosen"), [
    (fits(500), fits(495), "fast"),
    (fits(500), fits(505), "fast"),  # as good: the usual expectation
    (fits(500), fits(530), "slow"),
    ("only 2 of 5 batches fit", fits(300), "slow"),
    (fits(300), "only 2 of 5 batches fit", "fast"),
    ("none fits", "only 2 of 5 batches fit", "only 2 of 5 batches fit"),
])  # fmt: skip
def test_a_slow_body_is_believed_only_where_it_agrees_better(monkeypatch, fast, slow, chosen):
    begun = Motion.unknown(0, np.eye(4), reach=3.0)

    def tracked(_batches, _k_start, _every, motion, *_rest):
        found = fast if motion.reach == begun.reach else slow
        return found if isinstance(found, str) else ([motion] * 5, found)

    monkeypatch.setattr(start, "_tracked", tracked)
    found = start._slow_or_fast([], 0, 1, begun, np.empty((0, 3)), None, None)
    if isinstance(found, str):
        assert found == chosen
    else:
        motions, agreement = found
        assert agreement == {"fast": fast, "slow": slow}[chosen]
        assert (motions[0].covariance[6, 6] < begun.covariance[6, 6]) == (chosen == "slow")
