"""Truth from a map that is off lies where geometry says; errors are weighed as described."""

import numpy as np
import pytest

from eventsweep.eval.perturbations import Perturbation
from fit_imperfection import AXES, Candidate, _anywhere, _neighbour
from imperfection_trials import EXACT, TruthError, misplaced
from point_world import pinhole
from published_table import MONO, SGM, H


def wall_in(error, seed):
    """Distance, m, and normal of a wall 2 m ahead in the misplaced truth."""
    view = pinhole()
    wall_m = np.full((view.height_px, view.width_px), 2.0, np.float32)
    depth_m = misplaced(wall_m, view, error, seed)
    rows, columns = np.nonzero(np.isfinite(depth_m))
    bearing = view.unproject(np.stack([columns, rows], axis=-1).astype(float))
    terms = np.column_stack([bearing, np.ones(len(bearing))])
    n_over_d = np.linalg.lstsq(terms, 1 / depth_m[rows, columns].astype(float), rcond=None)[0]
    return 1 / np.linalg.norm(n_over_d), n_over_d / np.linalg.norm(n_over_d)


def test_a_third_of_an_offset_s_square_moves_a_wall_and_two_thirds_of_a_turn_s_tilt_it():
    moved_m = [wall_in(TruthError(truth_mm=30), seed)[0] - 2 for seed in range(150)]
    assert np.abs(moved_m).max() < 0.0305
    assert np.sqrt(np.mean(np.square(moved_m))) == pytest.approx(0.03 / np.sqrt(3), rel=0.15)
    normals = np.array([wall_in(TruthError(truth_deg=2), seed)[1] for seed in range(150)])
    tilts_deg = np.degrees(np.arccos(normals[:, 2]))
    assert tilts_deg.max() < 2.05
    assert np.sqrt(np.mean(tilts_deg**2)) == pytest.approx(2 * np.sqrt(2 / 3), rel=0.1)


def as_published(**more):
    """What comes out where all is as published."""
    numbers = {
        one.ours: {
            "points": 1000 * one.points_m, "mean_error": one.mean_cm / 100,
            "median_error": one.median_cm / 100, "bad_published": one.bad_percent,
        }
        for one in (H, MONO, SGM)
    }  # fmt: skip
    return Candidate(Perturbation(), EXACT, numbers | more)


def test_the_published_numbers_are_off_by_nothing_and_seven_are_compared():
    found = as_published()
    assert found.off == pytest.approx(1)
    assert len(found.factors) == 7
    half = {**found.numbers[H.ours], "points": found.numbers[H.ours]["points"] / 2}
    fewer = as_published(**{H.ours: half})  # beside one camera and beside SGM
    assert np.log(fewer.off) == pytest.approx(np.log(2) * np.sqrt(2 / 7))


def test_sizes_that_are_tried_lie_within_their_limits_and_a_neighbour_is_near():
    rng = np.random.default_rng(0)
    for _ in range(200):
        sizes = _anywhere(rng).model_dump(exclude_defaults=True)
        assert all(AXES[k].least * 0.95 <= abs(v) <= AXES[k].most * 1.05 for k, v in sizes.items())
    start = Perturbation(pose_walk_mm=20)
    walks = [_neighbour(rng, [start]).pose_walk_mm for _ in range(200)]
    kept = [one for one in walks if one]
    assert 0.75 * len(walks) < len(kept) < 0.95 * len(walks)
    assert np.std(np.log(kept)) == pytest.approx(0.3, rel=0.2)
