"""The page of a tracked recording: marks that a slider moves lie on what the figure draws."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

import point_world as world
from eventsweep.emvs.data.recording import no_poses
from eventsweep.emvs.depth.point_cloud import PointCloud
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.scoring.trajectories.sources import Source
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Change, Tracked
from eventsweep.plugins.track.odometry.trust import UNCONFIRMED
from eventsweep.plugins.track.page import _COLOURS, _by_status, maps_words, track_page
from eventsweep.plugins.track.scored import judged, true_poses
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
    cloud = PointCloud(9 * np.random.default_rng(0).random((40, 3)), np.zeros((40, 3), np.uint8))
    page = track_page("way", tracked(), cloud)
    WellFormed(page)
    assert (page.count('class="now dot"'), page.count('class="now line"')) == (3, 1)
    moving = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    assert (len(moving["names"]), moving["names"][0]) == (50, "0.00 s, tracking")
    alone, above, side, line = (np.array(mark) for mark in moving["marks"])
    for mark in (alone, above, side, line):
        assert ((mark >= 0) & (mark <= 1)).all()
        steps = np.diff(mark[:, 0])
        assert (steps > 0).all()  # to the right, ahead, later
        assert np.ptp(steps) < 3e-4
    assert above[-1, 1] < above[0, 1]  # ahead is up
    assert np.ptp(alone[:, 1]) > 1.2 * np.ptp(above[:, 1])  # alone it is larger than with the map
    assert alone[:, 0].max() < above[:, 0].min()
    assert np.ptp(side[:, 1]) < 1e-3  # on one level
    assert above[:, 0].max() < side[:, 0].min()  # each on its own panel
    assert ">1700000" not in page  # what people read; columns are sorted by the whole number
    page = track_page("way", tracked(5000), PointCloud(np.ones((1, 3)), np.zeros((1, 3), np.uint8)))
    moving = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    assert len(moving["names"]) == len(moving["marks"][0]) == 200


NO_CLOUD = PointCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


def page_of(own=None, **changes):
    """The page of a way that was tracked as it says, beside its own poses, if any."""
    track = replace(tracked(), **changes)
    truth = None if own is None else Source("way", Path("way"), own.trajectory)
    page = track_page("way", track, NO_CLOUD, truth and judged(track.trajectory, truth))
    WellFormed(page)
    return page


class Posed:
    """A recording that knows its poses, those of `tracked` seen from elsewhere and a bit off."""

    def __init__(self, shift_us=0):
        true = tracked().trajectory
        off_m = 0.02 * np.sin(np.arange(len(true)))[:, None] * [0, 1, 0]
        places = true.positions_m + off_m + [3.0, 0, 0]
        self.trajectory = Trajectory(true.t_us + shift_us, places, true.quats_xyzw)


def lead_of(page):
    return re.search(r'<p class="lead">(.*?)</p>', page)[1], re.findall(
        r'class="badge (\w+)"', page
    )


def test_the_page_says_first_how_much_was_tracked_and_how_surely():
    assert lead_of(page_of()) == ("98.0 % of 0.50 s tracked, never lost.", ["good"])
    begin, track = tracked().changes
    lost = Change(track.t_us + 100_000, Status.LOST, "fog")
    page = page_of(changes=(begin, track, lost))
    assert lead_of(page) == ("98.0 % of 0.50 s tracked, lost 1 time.", ["wrong"])
    assert "What to do: use the poses of the stretches that are tracking" in page
    again = replace(track, t_us=lost.t_us + 1000)
    assert lead_of(page_of(changes=(begin, track, lost, again)))[1] == ["doubtful"]
    unsure = (Status.TRACKING,) * 30 + (Status.UNCERTAIN,) * 20
    page = page_of(statuses=unsure, changes=(begin, replace(track, status=Status.UNCERTAIN)))
    assert lead_of(page)[0].endswith("never lost, 20 of 50 poses uncertain.")
    early = replace(track, status=Status.UNCERTAIN, reason=UNCONFIRMED)
    page = page_of(statuses=unsure, changes=(begin, early))
    assert "Too short: a second map confirms the beginning" in page
    assert "What to do" not in page_of()


def test_a_short_track_is_not_said_to_have_no_map():
    """It has the map that it began with, which is not among those counted."""
    assert [maps_words(replace(tracked(), maps=n)) for n in (0, 1, 2)] == [
        "no map beside the first", "1 map", "2 maps"
    ]  # fmt: skip
    assert "0 maps" not in page_of(maps=0)


def test_true_poses_are_compared_where_there_are_any():
    page = page_of(Posed())
    found = re.search(r"which the tracker did not see: ATE ([\d.]+) cm, or ([\d.]+) %", page)
    assert float(found[1]) == pytest.approx(2 / np.sqrt(2), rel=0.05)
    assert "true poses" not in page_of()
    late = page_of(Posed(shift_us=60_000_000))
    assert "Not scored: " in late


class Poseless:
    """A recording that says how to have poses: by tracking it."""

    name = "way"

    @property
    def trajectory(self):
        raise no_poses("way", "no poses.txt", world.stereo_rig(world.pinhole(), 0.1, 2))


def test_a_track_is_not_to_be_compared_with_itself():
    with pytest.raises(InputError, match="eventsweep track"):
        _ = Poseless().trajectory
    said = true_poses(Poseless(), Path("way"), None)
    assert said == "no true poses (the recording has none)"


def test_the_path_has_the_colour_of_its_status_and_gaps_are_open():
    """A stretch of another status, and 0.2 s without poses."""
    track = tracked()
    t_us = track.trajectory.t_us.copy()
    t_us[40:] += 200_000
    moved = Trajectory(t_us, track.trajectory.positions_m, track.trajectory.quats_xyzw)
    statuses = (Status.TRACKING,) * 30 + (Status.COASTING,) * 20
    lines = _by_status(replace(track, trajectory=moved, statuses=statuses),
                       moved.positions_m[:, [0, 2]])  # fmt: skip
    colours = [to_hex(colour) for colour in lines.get_colors()]
    assert len(lines.get_segments()) == 48
    assert colours == 29 * [_COLOURS[Status.TRACKING]] + 19 * [_COLOURS[Status.COASTING]]
    ends = [line[0].tolist() for line in lines.get_segments()]
    assert moved.positions_m[39, [0, 2]].tolist() not in ends


def test_the_scale_bar_is_a_round_length_within_the_path():
    page = page_of()
    assert re.search(r">(50 cm|80 cm|60 cm)<", page)
    assert ">start<" in page
    assert ">end<" in page
