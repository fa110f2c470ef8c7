"""Depth cells, error against coverage, areas under curves, regions in rows: by hand and by law."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.eval.report.ranking import column, findings
from eventsweep.eval.results.results import Results, read_results, write_results
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.curves import coverage_curve
from eventsweep.eval.scoring.method_scores import REGION_NAMES, score_method, score_pairs
from eventsweep.eval.scoring.metrics import Pairs, cell_offset
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import COMPARED, Estimate, MethodPairs, Truth, pair_methods
from eventsweep.eval.scoring.regions import REGIONS
from eventsweep.eval.scoring.score import case_rows, mean_rows
from score_rows import score_row, texts


def values(pairs):
    return {score.metric: score.value for score in score_pairs(pairs)}


def curve_of(pairs):
    return coverage_curve(pairs.error_m, pairs.confidence, pairs.truth_count)


def by_hand():
    """Errors 0.5, 0, 0.2, 0.1 m on 1 m; confidence 9, 5, 5, 1; eight pixels of truth."""
    truth_m = np.ones(4)
    estimate_m = np.array([1.5, 1.0, 1.2, 1.1])
    return Pairs(estimate_m, truth_m, 8, 10.0, confidence=np.array([9.0, 5.0, 5.0, 1.0]))


def test_coverage_by_hand():
    found = curve_of(by_hand())
    np.testing.assert_array_equal(found.points, [1, 3, 4])
    np.testing.assert_allclose(found.coverage, [12.5, 37.5, 50])
    np.testing.assert_allclose(found.mean_error_m, [0.5, 0.7 / 3, 0.2])
    np.testing.assert_allclose(found.best_error_m, [0, 0.1, 0.2])
    got, expected = values(by_hand()), {
        "aurc": (1 * 0.5 + 2 * 0.7 / 3 + 1 * 0.2) / 4,
        "ause": (1 * 0.5 + 2 * (0.7 / 3 - 0.1) + 0) / 4,
        "mean_error_top_10pct": 0.5, "mean_error_top_20pct": 0.7 / 3,
        # To 15 cm: the pixels without error, and with 10 cm for the last third, count 1 + 1/3.
        "auc_precision": 100 * (4 / 3) / 4, "auc_recall": 100 * (4 / 3) / 8,
        "auc_f1": 200 * (4 / 3) / 12,
        # To 20 %: no error, and 10 %, count 1 + 1/2; 20 % itself counts nothing.
        "auc_precision_relative": 100 * 1.5 / 4,
    }  # fmt: skip
    assert {name: got[name] for name in expected} == pytest.approx(expected)


def test_cells_by_hand():
    rho = np.array([1.0, 0.5, 0.25])  # 1 m, 2 m, 4 m: cells of 0.5 and 0.25 1/m
    got = cell_offset(np.array([1.0, 2.0, 4.0, 1 / 0.75, 8.0]), np.full(5, 2.0), rho)
    np.testing.assert_allclose(got, [1, 0, -1, 0.5, -1.5])


@given(st.integers(2, 60), st.data())
def test_on_equal_steps_cells_are_inverse_depth(count, data):
    rho = inverse_depth_planes(0.5, 6.0, count)
    depths = hnp.arrays(np.float64, 5, elements=st.floats(0.3, 9))
    e, g = data.draw(depths), data.draw(depths)
    step = (float(rho[0]) - float(rho[-1])) / (count - 1)
    expected = (1 / e - 1 / g) / step
    np.testing.assert_allclose(cell_offset(e, g, rho), expected, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(cell_offset(e, g, rho), cell_offset(e, g, rho[::-1]))
    np.testing.assert_array_equal(cell_offset(e, g, rho), -cell_offset(g, e, rho))


@st.composite
def confident_pairs(draw):
    n = draw(st.integers(1, 25))
    depths = hnp.arrays(np.float64, n, elements=st.floats(0.25, 50))
    sure = draw(hnp.arrays(np.float64, n, elements=st.sampled_from([0.0, 1.0, 2.5, 7.0])))
    return Pairs(draw(depths), draw(depths), n + draw(st.integers(0, 9)), 22.6, confidence=sure)


@given(confident_pairs())
def test_coverage_ends_at_all_pixels_and_no_order_beats_the_best(pairs):
    found, got = curve_of(pairs), values(pairs)
    assert found.mean_error_m[-1] == pytest.approx(got["mean_error"])
    assert found.coverage[-1] == pytest.approx(got["completeness"])
    assert (found.best_error_m <= found.mean_error_m * (1 + 1e-12)).all()
    assert 0 <= got["ause"] <= got["aurc"] * (1 + 1e-12) + 1e-12
    perfect = Pairs(pairs.estimate_m, pairs.truth_m, pairs.truth_count, 22.6,
                    confidence=-pairs.error_m)  # fmt: skip
    assert values(perfect)["ause"] == pytest.approx(0, abs=1e-12)


@given(confident_pairs(), st.randoms())
def test_coverage_does_not_depend_on_the_order_of_pixels_or_on_the_scale(pairs, random):
    order = list(range(pairs.count))
    random.shuffle(order)
    turned = Pairs(pairs.estimate_m[order], pairs.truth_m[order], pairs.truth_count, 22.6,
                   confidence=pairs.confidence[order] * 8 + 3)  # fmt: skip
    for name in ("aurc", "ause", "mean_error_top_5pct"):
        assert values(turned)[name] == pytest.approx(values(pairs)[name], abs=1e-9, nan_ok=True)


@given(confident_pairs())
def test_areas_lie_between_the_ends_of_their_curves(pairs):
    got = values(pairs)
    assert 0 <= got["auc_precision"] <= got["precision_15cm"] + 1e-9
    assert 0 <= got["auc_recall_relative"] <= got["recall_20pct"] + 1e-9
    assert got["auc_recall"] <= got["auc_precision"] + 1e-9
    shares = [got[f"precision_{percent}pct"] for percent in (1, 2, 5, 10, 20)]
    assert (np.diff(shares) >= 0).all()
    cells = [got[f"bad_{cells}cell"] for cells in (1, 2, 5)]
    assert np.isnan(cells).all()


def regional_pairs(shift=0.0):
    truth_m = np.array([[1.0, 2.0, 4.0], [1.0, 2.0, 4.0], [1.0, 2.0, 4.0]])
    left = np.zeros((3, 3), bool)
    left[:, 0] = True
    truth = Truth(truth_m, np.ones((3, 3), bool), 100.0, 0.1,
                  regions={"boundary": left, "interior": ~left})  # fmt: skip
    found = Estimate(truth_m + np.array([[0.5, 0, 0.25]]) + shift, np.eye(3, dtype=bool))
    silent = Estimate(truth_m, np.zeros((3, 3), bool))
    return pair_methods({"Alg1/H": found, "silent": silent}, truth)


def test_regions_by_hand_and_of_an_empty_prediction():
    got = {s.metric: s for s in score_method(regional_pairs()["Alg1/H"])}
    expected = {
        "boundary_points": 1, "boundary_completeness": 100 / 3, "boundary_mean_error": 0.5,
        "interior_mean_error": 0.125, "interior_completeness": 100 * 2 / 6,
    }  # fmt: skip
    assert {name: got[name].value for name in expected} == pytest.approx(expected)
    assert got["interior_mean_error"].region == "interior"
    assert got["common_points"].region == "common"
    assert (got["mean_error"].support, got["interior_mean_error"].support) == (3, 2)
    got = {s.metric: s.value for s in score_method(regional_pairs()["silent"])}
    for region in ("boundary", "interior"):
        assert got[f"{region}_completeness"] == got[f"{region}_points"] == 0
        assert math.isnan(got[f"{region}_mean_error"])
    assert math.isnan(got["aurc"])
    assert got["auc_recall"] == 0


def test_shares_of_causes_add_up_and_every_row_has_a_heading_with_its_region():
    causes = dict(zip(CAUSES, (1, 0, 4, 0, 0, 2, 0, 1), strict=True))
    pairs = regional_pairs()["Alg1/H"]
    got = score_method(MethodPairs(pairs.own, pairs.common, causes=causes))
    shares = {s.metric: s for s in got if s.metric.startswith("cause_")}
    assert set(shares) == {f"cause_{cause}" for cause in CAUSES}
    assert sum(s.value for s in shares.values()) == pytest.approx(100)
    assert shares["cause_occlusion"].value == 50
    assert {s.support for s in shares.values()} == {8}
    causes = dict.fromkeys(CAUSES, 1)
    pairs = regional_pairs()["Alg1/H"]
    for score in score_method(MethodPairs(pairs.own, pairs.common, pairs.regions, causes)):
        found = column(score.metric)
        assert (found.name, found.direction) == (score.metric, score.direction)
        regions = REGIONS | COMPARED
        assert score.region == "all" or regions[score.region] in found.formula
    assert len(REGION_NAMES) == len(set(REGION_NAMES))


def test_findings_name_the_causes_of_outliers_from_the_most_frequent_on():
    causes = dict(zip(CAUSES, (1, 0, 5, 0, 2, 0, 0, 0), strict=True))
    pairs = regional_pairs()["Alg1/H"]
    windows = {"w000": {"Alg1/H": MethodPairs(pairs.own, pairs.common, causes=causes)}}
    rows = case_rows("desk", windows)
    rows = rows[rows["window"] == "all"]
    assert findings(rows, "mean_error")[-1].endswith(
        "8 px of Alg1/H are off by more than a tenth: "
        "occlusion 62 %, few events 25 %, out of range 12 %."
    )
    without = {"w000": {"Alg1/H": MethodPairs(pairs.own, pairs.common)}}
    assert not any("tenth" in line for line in findings(case_rows("desk", without), "mean_error"))


def test_the_mean_weighs_windows_and_is_none_where_one_lacks_the_number():
    """They are of one seed, and say nothing of how another would do."""
    windows = {f"w{k:03d}": regional_pairs(0.1 * k) for k in range(4)}
    rows = [row for row in each(case_rows("desk", windows)) if row.method == "Alg1/H"]
    errors = [row for row in rows if row.metric == "median_error"]
    single = [row.value for row in errors if row.window.startswith("w")]
    (mean,) = [row for row in errors if row.window == "mean"]
    assert (mean.value, mean.support) == (pytest.approx(np.mean(single)), 12)
    assert all(math.isnan(row.low) and math.isnan(row.high) for row in errors)
    again = [row for row in each(case_rows("desk", windows)) if row.method == "Alg1/H"]
    assert repr(again) == repr(rows)
    one = score_row("desk", "w000", "Alg1/H", "mean_error", 1.0, "m", "lower", support=3)
    other = score_row("desk", "w001", "Alg1/H", "rmse", 2.0, "m", "lower", support=3)
    rows = mean_rows([one, {**other, "window": "w000"}, {**one, "window": "w001"}])
    assert (rows[0]["metric"], rows[0]["value"], rows[0]["support"]) == ("mean_error", 1.0, 6)
    assert math.isnan(rows[1]["value"])
    assert rows[1]["support"] is None
    assert mean_rows([]) == []


def test_regions_and_intervals_travel_to_disk(tmp_path):
    row = score_row("desk", "mean", "Alg1/H", "interior_mean_error", 0.5, "m", "lower",
                    "interior", 12, 0.25, 0.75)  # fmt: skip
    write_results(tmp_path, Results((row,)))
    assert texts(read_results(tmp_path).rows) == texts([row])
    assert (tmp_path / "results.csv").read_text().splitlines()[1] == (
        "desk,,mean,Alg1/H,interior_mean_error,0.5,m,lower,interior,12,0.25,0.75"
    )
