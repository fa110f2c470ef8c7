"""The page of a tracked recording: marks that a slider moves lie on what the figure draws."""

import json
import re

import numpy as np

from eventsweep.emvs.depth.point_cloud import PointCloud
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Change, Tracked
from eventsweep.plugins.track.page import track_page
from report_data import WellFormed


def tracked(count=50, first_us=1_700_000_000_000_000):
    """A straight way to the right and ahead, of a recording with a clock's times."""
    t_us = first_us + 10_000 * np.arange(count)
    share = np.linspace(0, 1, count)
    positions_m = np.column_stack([share, np.zeros(count), 2 * share])
    trajectory = Trajectory(t_us, positions_m, np.tile([0.0, 0, 0, 1], (count, 1)))
    changes = (
        Change(first_us, Status.STARTING, "no events yet"),
        Change(first_us + 10_000, Status.TRACKING, ""),
    )
    span_us = first_us, int(t_us[-1]) + 10_000
    return Tracked(
        trajectory, (Status.TRACKING,) * count, changes, span_us, 3, np.zeros((count, 6, 6))
    )


def test_marks_go_straight_on_every_panel_in_as_many_steps_as_a_slider_needs():
    cloud = PointCloud(np.random.default_rng(0).random((40, 3)), np.zeros((40, 3), np.uint8))
    page = track_page("way", tracked(), cloud)
    WellFormed(page)
    assert (page.count('class="now dot"'), page.count('class="now line"')) == (2, 1)
    moving = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    assert (len(moving["names"]), moving["names"][0]) == (50, "0.00 s, tracking")
    above, side, line = (np.array(mark) for mark in moving["marks"])
    for mark in (above, side, line):
        assert ((mark >= 0) & (mark <= 1)).all()
        steps = np.diff(mark[:, 0])
        assert (steps > 0).all()  # to the right, ahead, later
        assert np.ptp(steps) < 3e-4
    assert above[-1, 1] < above[0, 1]  # ahead is up
    assert np.ptp(side[:, 1]) < 1e-3  # on one level
    assert above[:, 0].max() < side[:, 0].min()  # each on its own panel
    assert ">1700000" not in page  # what people read; columns are sorted by the whole number
    page = track_page("way", tracked(5000), PointCloud(np.ones((1, 3)), np.zeros((1, 3), np.uint8)))
    moving = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    assert len(moving["names"]) == len(moving["marks"][0]) == 200
