"""Metrics: against their slow twin, against a hand calculation, and by law."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import naive_metrics
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.curves import COVERAGE_METRICS, CURVE_METRICS, THRESHOLDS_CM
from eventsweep.eval.scoring.method_scores import ALL_METRICS, score_method, score_pairs
from eventsweep.eval.scoring.metrics import CELL_METRICS, METRICS, Pairs
from eventsweep.eval.scoring.pairing import Estimate, Truth, pair, pair_methods, surest
from eventsweep.eval.scoring.score import case_rows, score_depth
from refusals import line_of

METRE_METRICS = ("mean_error", "median_error", "rmse")
RELATIVE_METRICS = (
    "abs_rel", "aerr_r", "silog", "log_rmse", "delta_1", "delta_2", "delta_3", "outlier_share",
)  # fmt: skip
DISPARITY_METRICS = ("bad_1px", "bad_2px", "bad_3px", "bad_5px", "bad_published", "bias_px")

depths = st.floats(0.25, 100.0)


@st.composite
def pair_lists(draw, baseline_focal_px_m=22.6):
    n = draw(st.integers(1, 30))
    estimate_m = draw(hnp.arrays(np.float64, n, elements=depths))
    truth_m = draw(hnp.arrays(np.float64, n, elements=depths))
    return Pairs(estimate_m, truth_m, n + draw(st.integers(0, 30)), baseline_focal_px_m)


def values(pairs):
    return {score.metric: score.value for score in score_pairs(pairs)}


def of_depth(*arguments, **settings):
    return {score.metric: score.value for score in score_depth(*arguments, **settings)}


def of_methods(methods):
    return {
        name: {score.metric: score.value for score in score_method(pairs)}
        for name, pairs in methods.items()
    }


def scene(seed, shape=(13, 17)):
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.5, 6.0, shape)
    depth_m = truth_m * np.exp(rng.normal(0, 0.1, shape))
    return depth_m, rng.random(shape) < 0.6, truth_m, rng.random(shape) < 0.8


@pytest.mark.parametrize("seed", range(5))
def test_every_metric_equals_its_slow_twin(seed):
    depth_m, mask, truth_m, valid = scene(seed)
    # Few values of confidence, so that many pixels share one.
    confidence = np.random.default_rng(seed).integers(0, 20, mask.shape) / 4
    rho = np.linspace(1 / 5.0, 1 / 0.6, 25)[:: 1 if seed % 2 else -1]
    truth = Truth(truth_m, valid, 226.0, 0.1)
    got = values(pair(depth_m, mask, truth, confidence=confidence, rho=rho))
    expected = naive_metrics.all_metrics(depth_m, mask, truth_m, valid, 22.6, confidence, rho)
    assert set(expected) == set(ALL_METRICS)
    for name, value in expected.items():
        assert got[name] == pytest.approx(value, rel=1e-9, abs=1e-9, nan_ok=True), name


def test_hand_computed_three_by_three():
    truth_m = np.array([[1.0, 2.0, 4.0], [1.0, 2.0, 4.0], [1.0, 2.0, 4.0]])
    valid = np.array([[1, 1, 1], [1, 1, 1], [0, 1, 1]], bool)
    depth_m = np.array([[1.0, 2.5, 9.0], [1.25, 2.0, 8.0], [3.0, 1.0, 4.0]])
    mask = np.array([[1, 1, 0], [1, 1, 1], [1, 0, 0]], bool)
    # Pairs (e, g): (1, 1), (2.5, 2), (1.25, 1), (2, 2), (8, 4); errors 0, 0.5, 0.25, 0, 4 m.
    got = of_depth(depth_m, mask, truth_m, valid, focal_px=100.0, baseline_m=0.1)
    log2, log125 = np.log(2), np.log(1.25)
    mean_square = (2 * log125**2 + log2**2) / 5
    expected = {
        "points": 5, "truth_points": 8, "baseline_focal": 10, "completeness": 62.5,
        "mean_error": 0.95, "median_error": 0.25, "rmse": np.sqrt((0.25 + 0.0625 + 16) / 5),
        "abs_rel": 100 * (0.25 + 0.25 + 1) / 5, "aerr_r": 100 * (0.2 + 0.2 + 0.5) / 5,
        # Ratios 1.25 are not below 1.25; 2 is not below 1.25³ = 1.953.
        "delta_1": 40, "delta_2": 80, "delta_3": 80,
        # Disparity errors: 0, 1, 2, 0, 1.25 px; a threshold is exceeded, not met.
        "bad_1px": 40, "bad_2px": 0, "bad_5px": 0, "bad_published": 0, "outlier_share": 60,
        "precision_1cm": 40, "recall_15cm": 25, "log_rmse": 100 * np.sqrt(mean_square),
        "silog": 100 * (mean_square - ((2 * log125 + log2) / 5) ** 2),
    }  # fmt: skip
    assert {name: got[name] for name in expected} == pytest.approx(expected)


def test_published_rule_needs_both_conditions():
    # 5 px at b f = 100 px·m is 0.05 1/m: 1.25 m at 5 m, and 2.6 mm at 0.23 m.
    far_off = Pairs(np.array([10.0]), np.array([5.0]), 1, 100.0)
    near = Pairs(np.array([0.2]), np.array([0.2021]), 1, 100.0)
    assert values(far_off)["bad_published"] == 100
    assert values(near)["bad_5px"] == 100
    assert values(near)["bad_published"] == 0


@pytest.mark.filterwarnings("error")
def test_empty_prediction_is_undefined_but_not_an_error():
    _, mask, truth_m, valid = scene(0)
    got = of_depth(truth_m, np.zeros_like(mask), truth_m, valid, 226.0, 0.1)
    assert got["points"] == got["completeness"] == got["recall_5cm"] == got["f1_5cm"] == 0
    undefined = {*METRE_METRICS, *RELATIVE_METRICS, *DISPARITY_METRICS, "precision_5cm"}
    assert all(np.isnan(got[name]) for name in undefined)


@pytest.mark.filterwarnings("error")
def test_no_truth_at_all_is_undefined():
    got = values(Pairs(np.empty(0), np.empty(0), 0, 22.6))
    assert got.pop("points") == got.pop("truth_points") == 0
    assert got.pop("baseline_focal") == 22.6
    assert all(np.isnan(value) for value in got.values())


def test_a_perfect_prediction_is_perfect_and_one_camera_has_no_disparity_metric():
    _, _, truth_m, valid = scene(1)
    truth = Truth(truth_m, valid, 226.0, 0.1)
    pairs = pair(truth_m, valid, truth, confidence=truth_m, rho=np.linspace(0.2, 1.0, 9))
    got = {s.metric: s for s in score_pairs(pairs)}
    for name in ALL_METRICS:
        if name != "points":
            assert got[name].value == (100 if got[name].direction == "higher" else 0), name
    assert got["points"].value == np.count_nonzero(valid)
    got = of_depth(*scene(3), 226.0, None)
    assert {name for name, value in got.items() if np.isnan(value)} == {
        "baseline_focal", *DISPARITY_METRICS,
        *(metric.name for metric in (*CELL_METRICS, *COVERAGE_METRICS)),
    }  # fmt: skip


def scaled(pairs, scale):
    lengths = (one * scale for one in (pairs.estimate_m, pairs.truth_m))
    return Pairs(*lengths, pairs.truth_count, pairs.baseline_focal_px_m * scale)


@given(pair_lists(), st.floats(0.125, 8.0))
def test_scaling_the_world_scales_metres_and_nothing_else(pairs, scale):
    before, after = values(pairs), values(scaled(pairs, scale))
    for name in METRE_METRICS:
        assert after[name] == pytest.approx(scale * before[name], rel=1e-9)
    for name in ("abs_rel", "aerr_r", "silog", "log_rmse", "completeness"):
        assert after[name] == pytest.approx(before[name], rel=1e-6, abs=1e-9)


@given(pair_lists(), st.sampled_from([0.25, 0.5, 2.0, 8.0]))
def test_scaling_by_a_power_of_two_keeps_every_threshold_decision(pairs, scale):
    before, after = values(pairs), values(scaled(pairs, scale))
    for name in ("delta_1", "delta_2", "delta_3", "outlier_share", *DISPARITY_METRICS):
        assert after[name] == before[name], name


@given(pair_lists())
def test_symmetric_metrics_do_not_care_which_one_is_the_truth(pairs):
    swapped = Pairs(pairs.truth_m, pairs.estimate_m, pairs.truth_count, pairs.baseline_focal_px_m)
    before, after = values(pairs), values(swapped)
    assert [before[f"delta_{k}"] for k in (1, 2, 3)] == [after[f"delta_{k}"] for k in (1, 2, 3)]
    assert before["silog"] == pytest.approx(after["silog"])
    assert before["abs_rel"] == pytest.approx(after["aerr_r"])


@given(pair_lists())
def test_shares_grow_with_their_threshold_and_means_are_ordered(pairs):
    got = values(pairs)
    assert got["delta_1"] <= got["delta_2"] <= got["delta_3"]
    assert got["bad_1px"] >= got["bad_2px"] >= got["bad_3px"] >= got["bad_5px"]
    assert got["bad_5px"] >= got["bad_published"]
    precision, recall, f1 = (
        np.array([got[f"{name}_{cm}cm"] for cm in THRESHOLDS_CM])
        for name in ("precision", "recall", "f1")
    )
    for share in (precision, recall, f1):
        assert (np.diff(share) >= 0).all()
        assert ((share >= 0) & (share <= 100)).all()
    assert (recall <= precision).all()
    assert got["mean_error"] <= got["rmse"] * (1 + 1e-12)
    assert got["silog"] <= (got["log_rmse"] / 10) ** 2 + 1e-9


def test_truth_must_be_finite_positive_and_within_the_limits():
    truth_m = np.array([[np.nan, np.inf, 0.0, -1.0, 0.5, 1.0, 4.0, 5.0]])
    truth = Truth(truth_m, np.ones_like(truth_m, bool), 100.0, 0.1, limits_m=(1.0, 4.0))
    np.testing.assert_array_equal(truth.scored, [[0, 0, 0, 0, 0, 1, 1, 0]])
    got = pair(np.full_like(truth_m, 2.0), np.ones_like(truth_m, bool), truth)
    np.testing.assert_array_equal(got.truth_m, [1.0, 4.0])


@pytest.mark.parametrize(("change", "message"), [
    ({"mask": np.ones((2, 3), bool)}, "shapes"), ({"focal_px": 0.0}, "focal length 0"),
    ({"depth_m": np.full((2, 2), np.nan)}, "4 of 4 reported depths"),
    ({"depth_m": np.zeros((2, 2))}, "4 of 4 reported depths"),
    ({"baseline_m": np.nan}, "baseline nan"),
])  # fmt: skip
def test_unusable_input_is_named_in_one_line(change, message):
    ones, all_ = np.ones((2, 2)), np.ones((2, 2), bool)
    sound = {
        "depth_m": ones, "mask": all_, "truth_depth_m": ones, "truth_valid": all_,
        "focal_px": 100.0, "baseline_m": 0.1,
    }  # fmt: skip
    assert message in line_of(score_depth, **{**sound, **change})


TRUTH = Truth(np.ones((1, 4)), np.ones((1, 4), bool), 100.0, 0.1)


def estimate(depth_m, *mask):
    return np.full((1, 4), 1.0) * depth_m, np.array([mask], bool)


def test_common_support_is_shared_by_all_methods_that_report_anything():
    depth_m = np.array([[1.5, 1.0, 1.25, 9.0]])
    masks = {"a": (1, 1, 1, 0), "b": (0, 1, 1, 1), "silent": (0, 0, 0, 0)}
    methods = {name: estimate(depth_m, *mask) for name, mask in masks.items()}
    got = of_methods(pair_methods(methods, TRUTH))
    assert got["a"]["common_points"] == got["b"]["common_points"] == 2
    assert got["a"]["common_mean_error"] == got["b"]["common_mean_error"] == 0.125
    assert (got["a"]["mean_error"], got["silent"]["common_points"]) == (0.25, 0)


def test_two_methods_are_compared_on_the_pixels_of_both():
    """By hand: three pixels of H, three of b, of which two are both's."""
    estimates = {
        "Alg1/H": estimate([[9.0, 1.5, 1.25, 1]], 1, 1, 1, 0),
        "b": estimate([[1, 1.0, 1.125, 7.0]], 0, 1, 1, 1), "far": estimate(2.0, 0, 0, 0, 1),
    }  # fmt: skip
    got = of_methods(pair_methods(estimates, TRUTH, reference="Alg1/H"))
    assert (got["b"]["shared_points"], got["far"]["shared_points"]) == (2, 0)
    assert (got["b"]["shared_mean_error"], got["b"]["harmonic_mean_error"]) == (0.0625, 0.375)
    # 10 px·m: |1/e - 1| 10 > 5 px where e < 2/3 or e > 2.
    assert (got["b"]["shared_bad_published"], got["b"]["harmonic_bad_published"]) == (0, 0)
    assert np.isnan(got["far"]["shared_mean_error"])
    assert not [name for name in got["Alg1/H"] if name.startswith(("shared_", "harmonic_"))]
    alone = of_methods(pair_methods(estimates, TRUTH))
    assert not [name for name in alone["b"] if name.startswith("shared")]


def test_maps_that_are_not_compared_leave_the_common_support_alone():
    ours = {"a": estimate(1.5, 1, 1, 1, 0), "b": estimate(2.0, 0, 1, 1, 1)}
    alone = of_methods(pair_methods(ours, TRUTH))
    theirs = {"a track": estimate(1.0, 1, 0, 0, 0)}
    both = of_methods(pair_methods({**ours, **theirs}, TRUTH, compared=ours))
    assert alone["a"]["common_points"] == 2
    for name in ours:
        np.testing.assert_equal(both[name], alone[name])
    assert not [name for name in both["a track"] if name.startswith(("common", "equal"))]


def sure(depth_m, mask, *confidence):
    return Estimate(*estimate(depth_m, *mask), np.array([confidence]))


def test_at_equal_points_each_method_keeps_its_surest_as_many_as_the_fewest():
    """By hand: b has two points, so a keeps its two surest; c does not say which those are."""
    methods = {
        "a": sure([[3.0, 2.0, 1.5, 1.25]], (1, 1, 1, 1), 1, 2, 4, 3),
        "b": estimate(2.0, 0, 1, 1, 0),
        "c": estimate(1.0, 1, 1, 1, 0), "silent": estimate(1.0, 0, 0, 0, 0),
    }  # fmt: skip
    got = of_methods(pair_methods(methods, TRUTH))
    assert (got["a"]["equal_points"], got["a"]["equal_mean_error"]) == (2, 0.375)
    assert (got["b"]["equal_points"], got["b"]["equal_mean_error"]) == (2, 1.0)
    assert not [name for name in got["c"] if name.startswith("equal")]
    assert got["silent"]["equal_points"] == 0


@given(st.integers(0, 50), st.integers(1, 60))
def test_the_surest_are_never_less_sure_than_the_rest(seed, count):
    """And a confidence that says nothing draws pixels of everywhere, not the first rows."""
    rng = np.random.default_rng(seed)
    estimate_m, confidence = rng.uniform(1, 2, 60), rng.integers(0, 5, 60).astype(float)
    pairs = Pairs(estimate_m, np.ones(60), 60, 10.0, confidence=confidence)
    kept = surest(pairs, count)
    assert kept.count == count
    whole = np.sort(confidence)[::-1]
    np.testing.assert_array_equal(np.sort(kept.confidence)[::-1], whole[:count])
    assert set(zip(kept.estimate_m, kept.confidence, strict=True)) <= set(
        zip(estimate_m, confidence, strict=True)
    )
    flat = surest(replace(pairs, truth_m=np.arange(1.0, 61), confidence=np.ones(60)), 20)
    assert 20 < flat.truth_m.mean() < 41


def test_case_rows_hold_every_window_and_their_pool_as_one_large_window():
    def windows(seed):
        depth_m, mask, truth_m, valid = scene(seed)
        other = np.random.default_rng(seed).random(mask.shape) < 0.5
        truth = Truth(truth_m, valid, 226.0, 0.1)
        found = {"Alg1/H": (depth_m, mask), "b": (1.1 * depth_m, mask & other)}
        return pair_methods(found, truth, compared=["Alg1/H"], reference="Alg1/H")

    parts = {f"w{seed:03d}": windows(seed) for seed in (0, 1)}
    rows = each(case_rows("desk", parts))
    got = {row.metric: row.value for row in rows if row.window == "all" and row.method == "b"}
    whole = naive_metrics.pooled_methods([part["b"] for part in parts.values()])
    for score in score_method(whole):
        if score.region in ("shared", "harmonic"):
            assert got[score.metric] == pytest.approx(score.value)
    assert got["shared_points"] > 0
    assert not [name for name in got if name.startswith("common")]
    windows = {}
    for seed in (0, 1):
        depth_m, mask, truth_m, valid = scene(seed)
        truth = Truth(truth_m, valid, 226.0, 0.1)
        windows[f"w{seed:03d}"] = pair_methods({"Alg1/H": (depth_m, mask)}, truth)
    rows = list(each(case_rows("desk", windows)))
    points = {row.window: row.value for row in rows if row.metric == "points"}
    assert (points["mean"], points["all"]) == (points["all"] / 2, points["w000"] + points["w001"])
    assert {row.case for row in rows} == {"desk"}
    assert len({(row.window, row.method, row.metric) for row in rows}) == len(rows)


def test_every_metric_says_what_it_is():
    for metric in ALL_METRICS.values():
        assert metric.title
        assert metric.formula
        assert metric.unit
        assert (metric.direction == "none") == metric.name.startswith("bias")
    registries = (METRICS, CELL_METRICS, CURVE_METRICS, COVERAGE_METRICS)
    assert len(ALL_METRICS) == sum(map(len, registries))


@pytest.mark.parametrize(("values", "words"), [
    ({"min_truth_depth_m": 4, "max_truth_depth_m": 1}, "below"),
    ({"ranking": "rmse"}, "unknown key ranking; did you mean ranking_metric"),
])  # fmt: skip
def test_configuration_refuses_reversed_limits_and_unknown_keys(values, words):
    assert EvalConfig(min_truth_depth_m=0.5).truth_limits_m == (0.5, float("inf"))
    assert words in line_of(EvalConfig, **values)
