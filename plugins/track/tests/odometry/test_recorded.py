"""What is noted of a tracker's status: what waited is sure once it is confirmed, and no more."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep.plugins.track.odometry.pose import Pose, Status
from eventsweep.plugins.track.odometry.recorded import Change, _Done
from eventsweep.plugins.track.odometry.registration.fit import Fit
from eventsweep.plugins.track.odometry.trust import SHORT, UNCONFIRMED

STARTING, TRACKING, UNCERTAIN, STILL = (
    Status.STARTING, Status.TRACKING, Status.UNCERTAIN, Status.STILL
)  # fmt: skip
OFF = "the scale is off by 5.0 %, the cameras say"
UNMEASURED = "the scale is known to 3.2 % only"


def noted(*changes):
    """The changes that are kept, and the status of a pose at each time, of changes 10 µs apart."""
    done = _Done()
    done.changes = [Change(0, STARTING, "no events yet")]
    for k, (status, _) in enumerate(changes):
        pose = Pose(10 * (k + 1), np.eye(4), np.zeros(6), status, Fit(), np.eye(6))
        done.add(pose)
        done.add(replace(pose, t_us=pose.t_us + 5))
    tracker = SimpleNamespace(changes=[(10 * (k + 1), *each) for k, each in enumerate(changes)])
    done.note(tracker)
    kept = [(c.t_us, c.status) for c in done.changes[1:]]
    return kept, [pose.status for pose in done.poses[::2]], [p.status for p in done.poses[1::2]]


@pytest.mark.parametrize(("changes", "kept", "statuses"), [
    ([(UNCERTAIN, UNCONFIRMED), (TRACKING, "")], [(10, TRACKING)], [TRACKING] * 2),
    ([(UNCERTAIN, UNCONFIRMED), (UNCERTAIN, SHORT), (TRACKING, "")],
     [(10, TRACKING)], [TRACKING] * 3),
    ([(UNCERTAIN, SHORT), (UNCERTAIN, UNMEASURED), (UNCERTAIN, SHORT), (TRACKING, "")],
     [(10, TRACKING), (20, UNCERTAIN), (30, TRACKING)], [TRACKING, UNCERTAIN, TRACKING, TRACKING]),
    ([(UNCERTAIN, SHORT), (UNCERTAIN, OFF), (UNCERTAIN, SHORT), (TRACKING, "")],
     [(10, UNCERTAIN), (20, UNCERTAIN), (30, TRACKING)],
     [UNCERTAIN, UNCERTAIN, TRACKING, TRACKING]),
    ([(UNCERTAIN, SHORT), (STILL, ""), (UNCERTAIN, SHORT), (TRACKING, "")],
     [(10, UNCERTAIN), (20, STILL), (30, TRACKING)], [UNCERTAIN, STILL, TRACKING, TRACKING]),
    ([(TRACKING, ""), (UNCERTAIN, SHORT), (TRACKING, "")], [(10, TRACKING)], [TRACKING] * 3),
    ([(UNCERTAIN, UNMEASURED), (TRACKING, "")],
     [(10, UNCERTAIN), (20, TRACKING)], [UNCERTAIN, TRACKING]),
    ([(UNCERTAIN, UNCONFIRMED), (UNCERTAIN, SHORT)],
     [(10, UNCERTAIN), (20, UNCERTAIN)], [UNCERTAIN] * 2),
])  # fmt: skip
def test_what_waited_is_sure_once_confirmed_back_to_where_something_spoke_against_it(
    changes, kept, statuses
):
    found, first, second = noted(*changes)
    assert found == kept
    assert first == second == statuses
