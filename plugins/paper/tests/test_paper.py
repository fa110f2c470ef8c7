"""Statements, evidence and figures of the paper's page, on made numbers and maps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import pmean

from eventsweep.eval.results.results import Results
from eventsweep.eval.suite.definition import load
from eventsweep.plugins.paper import edges, heading
from eventsweep.plugins.paper.evidence import Evidence, Missing, Value, View
from eventsweep.plugins.paper.means import FUNCTIONS, order_of
from eventsweep.plugins.paper.page import CHAPTERS
from eventsweep.plugins.paper.statements import Finding, Statement, Verdict
from eventsweep.plugins.paper.verb import SUITE

POWERS = {"min": -np.inf, "H": -1, "G": 0, "A": 1, "RMS": 2, "max": np.inf}


class _Views:
    """Where maps would be."""

    suite = load(str(SUITE))[0]


def _evidence(values: dict[tuple[str, int, str, str], float]) -> Evidence:
    rows = [
        {"case": case, "seed": seed, "window": "all", "method": method, "metric": metric,
         "value": value, "unit": "%", "direction": "lower"}
        for (case, seed, method, metric), value in values.items()
    ]  # fmt: skip
    return Evidence(Results(pd.DataFrame(rows)), _Views())  # type: ignore[arg-type]


def _view(depth_m, truth_m, confidence=None, texture=None) -> View:  # type: ignore[no-untyped-def]
    from types import SimpleNamespace as Bag

    depth, truth = np.asarray(depth_m, float), np.asarray(truth_m, float)
    mask = np.isfinite(depth)
    sure = np.ones_like(depth) if confidence is None else np.asarray(confidence, float)
    one = Bag(depth_m=np.where(mask, depth, 1.0), mask=mask, confidence=sure)
    marks = np.ones(truth.shape, bool) if texture is None else np.asarray(texture, bool)
    scored = Bag(depth_m=truth, scored=np.isfinite(truth), regions={"edges": marks})
    return View(Bag(), scored, {"Alg1/H": one}, Bag())  # type: ignore[arg-type]


@given(st.lists(st.tuples(*[st.floats(1 / 64, 1024, width=32)] * 2), min_size=1, max_size=40))
def test_generalized_means_are_in_order_and_exchanged_ones_are_not(pairs) -> None:
    votes = np.array(pairs)
    means = []
    for name in FUNCTIONS:
        power = POWERS[name]
        ends = {-np.inf: votes.min(axis=1), np.inf: votes.max(axis=1)}
        mean = ends[power] if np.isinf(power) else pmean(votes, power, axis=1)
        means.append(mean.astype(np.float32))
    assert order_of(means).broken == 0
    unequal = np.abs(votes[:, 0] - votes[:, 1]) > 0.01 * votes.max(axis=1)
    assert order_of(means[::-1]).broken >= np.count_nonzero(unequal)


def test_empty_voxels_are_in_order_and_not_of_both_cameras() -> None:
    zeros = np.zeros((2, 3), np.float32)
    assert order_of([zeros] * 6) == (6, 0, 0)


def test_numbers_are_means_over_cases_of_means_over_seeds() -> None:
    values = {("boxes", 0): 1.0, ("boxes", 1): 3.0, ("desk", 0): 4.0, ("desk", 1): 8.0}
    evidence = _evidence({(c, s, "Alg1/H functions", "abs_rel"): v for (c, s), v in values.items()})
    found = evidence.number(("boxes", "desk"), "Alg1/H", "abs_rel")
    assert found.mean == 4.0
    assert found.low < 4.0 < found.high
    assert str(Value(2.5, unit="%")) == "2.50 %"


def test_a_ratio_is_geometric_over_pairs_of_the_same_seed() -> None:
    evidence = _evidence({
        ("boxes", 0, "Alg1/H functions", "abs_rel"): 1.0,
        ("boxes", 1, "Alg1/H functions", "abs_rel"): 8.0,
        ("boxes", 0, "EMVS/cam0 functions", "abs_rel"): 2.0,
        ("boxes", 1, "EMVS/cam0 functions", "abs_rel"): 4.0,
    })  # fmt: skip
    assert evidence.ratio("boxes", "abs_rel", "Alg1/H", "EMVS/cam0").mean == pytest.approx(1.0)


def test_what_was_not_run_is_not_measured() -> None:
    evidence = _evidence({("room-vio10", 0, "Alg1/H pair", "abs_rel"): 1.0})
    with pytest.raises(Missing, match="abs_rel of EMVS/cam0 pair in room-vio10 was not measured"):
        evidence.number("room-vio10", "EMVS/cam0", "abs_rel")
    found = [f for chapter in CHAPTERS for _, f in chapter.rows(evidence)]
    assert {finding.verdict for finding in found} == {Verdict.NOT_MEASURED}


def test_a_point_beside_a_contour_is_right_for_a_pixel_beside_it() -> None:
    truth = np.full((5, 6), 4.0)
    truth[:, :3] = 1.0
    depth = np.full((5, 6), np.nan)
    depth[2, 3], depth[2, 5] = 1.0, 1.0  # one pixel off the contour, and two off it
    view = _view(depth, truth)
    assert sorted(edges.relative_errors(view, "Alg1/H")) == [0.75, 0.75]
    assert sorted(edges.tolerant_errors(view, "Alg1/H")) == [0.0, 0.75]
    assert edges.outliers(edges.tolerant_errors(view, "Alg1/H")) == 50.0


def test_tolerant_errors_are_the_least_over_the_neighbours() -> None:
    rng = np.random.default_rng(3)
    truth = rng.uniform(1, 5, (7, 9))
    truth[rng.random(truth.shape) < 0.2] = np.nan
    depth = np.where(rng.random(truth.shape) < 0.5, rng.uniform(1, 5, truth.shape), np.nan)
    expected = []
    for y, x in zip(*np.nonzero(np.isfinite(depth) & np.isfinite(truth)), strict=True):
        around = truth[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
        around = around[np.isfinite(around)]
        expected.append(np.min(np.abs(depth[y, x] - around) / around))
    np.testing.assert_allclose(edges.tolerant_errors(_view(depth, truth), "Alg1/H"), expected)


def test_the_surest_points_come_first() -> None:
    view = _view([[1.0, 2.0, 4.0]], [[1.0, 1.0, 1.0]], [[5, 9, 7]], [[1, 1, 0]])
    found = heading.surest(view)
    assert list(found.errors) == [1.0, 3.0, 0.0]
    assert found.edges == 2
    assert found.of(1) == 100.0


def test_the_order_decides_before_the_size() -> None:
    assert Verdict.of(False, True) is Verdict.DISAGREES
    assert Verdict.of(True, False) is Verdict.IN_ORDER
    assert Verdict.of(True) is Verdict.AGREES


def test_an_error_in_a_measure_is_no_missing_number() -> None:
    def wrong(_: Evidence) -> Finding:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Statement("Sec. 0", "nothing", wrong).found(_evidence({("boxes", 0, "a", "b"): 1.0}))


def test_every_case_of_the_suite_is_known_and_frozen() -> None:
    suite = _Views.suite
    assert suite.leaves_out("6dof", 1)
    assert not suite.leaves_out("6dof", 0)
    assert not suite.leaves_out("6dof", 7)
    assert not suite.leaves_out("boxes", 2)
