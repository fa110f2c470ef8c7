"""The table of track's scores counts failures, keeps finished rows, and names held-out seeds."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import track_scores
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.folder import write_covariances
from track_scores import Row, Twin, at_its_clock, claimed, measured, table, twins_of


def row(seed, percent, lost=0, failure="", ratio=1.05):
    ate_m = None if percent is None else percent / 100
    twin = Twin("rpg-boxes", "davis240", seed, 1.5)
    ratio = None if failure else ratio
    found = 97.0, percent == 0.4, None if failure else 90.0 + lost
    clock = (None, None) if failure else (-2.0, percent / 2)
    return Row(twin, failure, ate_m, percent, 99.0, lost, 9.0, ratio, *found, *clock)


def test_failures_count_and_opened_seeds_do_not():
    failed = row(1002, None, failure="no poses")
    text = table([row(0, 9.0), row(1000, 0.2), row(1001, 0.4, lost=1), failed])
    assert (
        "| 1.5 | 1000, 1001, 1002 | 0.40 | no poses | 2.0 | 0.15 | 97 | 1 | 90.5 | 99.0 | 2 | 1.05 "
        "| 6.0 |" in text
    )
    assert "| 0 (seen) | 9.00 | 9.00 | 2.0 | 4.50 | 97 | 0 | 90.0 | 99.0 | 0 | 1.05 | 6.0 |" in text
    assert "depth errors 1.05 times those on true poses in the median, inf at worst" in text
    assert "on 1; 90.5 % of true poses lie in the 95 % regions of those found." in text
    assert "where most poses" not in text  # as all are
    assert "ATE 0.40 % of the way in the median, no poses at worst, 0.15 % in the median" in text
    assert "3 sequences" in text
    assert "Never lost on 1, silently wrong on 1" in text
    assert "Held-out seeds" not in table([row(0, 1.0)])
    doubted = replace(row(1003, 30.0), claimed_percent=49.0)
    text = table([row(1000, 0.2), doubted])
    assert "30.00 % at worst, 7.55 % in the median by the best clock; depth errors 1.05" in text
    assert "On the 1 where most poses are `tracking`: ATE 0.20 % of the way" in text


def test_a_clock_at_an_end_of_what_is_tried_is_none():
    at_end, inside = (replace(row(1000, 0.2), clock_ms=ms) for ms in (-14.99, -2.0))
    assert "| 0.20 | 0.20 | – | – | 97 |" in table([at_end])
    assert "| 0.20 | 0.20 | 2.0 | 0.10 | 97 |" in table([at_end, inside])


def test_a_clock_that_is_off_is_found():
    rng = np.random.default_rng(1)
    t_us = np.arange(0, 1_000_000, 5000)
    places = np.cumsum(np.cumsum(rng.normal(size=(len(t_us), 3)), axis=0), axis=0) * 1e-4
    truth = Trajectory(t_us, places, np.tile([0, 0, 0, 1.0], (len(t_us), 1)))
    late = Trajectory(t_us + 4300, places, truth.quats_xyzw)
    clock_ms, percent = at_its_clock(truth, late)
    assert clock_ms == pytest.approx(-4.3, abs=0.1)
    assert percent < 0.1


@pytest.mark.parametrize(("factor", "least", "most"), [(1.0, 91, 98), (0.5, 5, 60)])
def test_errors_as_large_as_the_covariance_says_lie_in_its_region_as_often(
    tmp_path, monkeypatch, factor, least, most
):
    """Whatever the world's frame; errors of position and turn are correlated.

    The first pose has no true one: it may be a moment before them.
    """
    rng, count = np.random.default_rng(0), 500
    root = rng.normal(size=(count, 6, 6)) * 1e-3
    off = (root @ rng.normal(size=(count, 6, 1)))[..., 0]
    off[:2] = 0
    xi = np.cumsum(rng.normal(size=(count, 6)), axis=0) * 0.02
    found, true = np.stack([se3.exp(each) for each in xi]), []
    for T, error in zip(found, off, strict=True):
        turned = se3.exp(np.r_[0, 0, 0, error[3:]]) @ T
        turned[:3, 3] = T[:3, 3] + error[:3]
        true.append(se3.exp([1, 2, 3, 0.4, 0.5, 0.6]) @ turned)
    t_us = np.arange(count) * 10_000
    track = Trajectory.from_matrices(t_us, found)
    truth = Trajectory.from_matrices(t_us[1:], np.stack(true[1:]))
    covariances = factor**2 * root @ root.swapaxes(1, 2)
    write_tum(tmp_path / "trajectory.txt", track)
    write_covariances(
        tmp_path / "covariances.txt", SimpleNamespace(trajectory=track, covariances=covariances)
    )
    recording = SimpleNamespace(trajectory=truth)
    monkeypatch.setattr(track_scores.es, "open_recording", lambda _path: recording)
    assert least < track_scores.within(tmp_path, tmp_path) < most


def test_what_is_claimed_follows_from_the_changes_of_status():
    poses = Trajectory(np.array([5, 10, 20, 30]), np.zeros((4, 3)), np.tile([0, 0, 0, 1.0], (4, 1)))
    changes = [
        {"t_us": t_us, "status": status}
        for t_us, status in ((0, "starting"), (5, "tracking"), (20, "uncertain"), (25, "tracking"))
    ]
    assert claimed(poses, changes).tolist() == [True, True, False, True]


def test_twins_of_one_scene_differ_by_sensor_and_rig():
    twins = list(twins_of(["desk", "desk-dark", "desk-rpg=3"], "2"))
    assert [twin.name for twin in twins] == [
        "desk-davis346-2-1.5s", "desk-low-light-2-1.5s", "desk@rpg-davis240-3-1.5s"
    ]  # fmt: skip


def test_a_finished_row_is_kept_and_a_damaged_one_refused(tmp_path, monkeypatch):
    made = []

    def tracked(twin, _recording, _out):
        if made and twin.seed == 3:
            raise KeyboardInterrupt
        made.append(twin.seed)
        return row(twin.seed, 0.1 * twin.seed)

    monkeypatch.setattr(track_scores, "simulated", lambda _twin, folder: folder)
    monkeypatch.setattr(track_scores, "warm_up", lambda _path: None)
    monkeypatch.setattr(track_scores, "_tracked", tracked)
    twins = [row(seed, 1.0).twin for seed in (2, 3)]
    with pytest.raises(KeyboardInterrupt):
        measured(twins, tmp_path)
    made.clear()
    assert [each.twin for each in measured(twins, tmp_path)] == twins
    assert made == [3]
    kept = tmp_path / f"{twins[0].name}.json"
    kept.write_text(json.dumps({"twin": 3}))
    with pytest.raises(InputError, match="remove the file"):
        measured(twins, tmp_path)
