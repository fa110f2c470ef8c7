"""Pooling window by window: as if all windows' pixels were one window's, in bounded memory."""

import gc
import re
import tracemalloc
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.eval.scoring.method_scores import ALL_METRICS, score_method, score_pairs
from eventsweep.eval.scoring.metrics import Pairs
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import MethodPairs
from eventsweep.eval.scoring.pooling import CasePool, NumberStore, Pool
from eventsweep.eval.scoring.score import case_rows
from naive_metrics import pooled, pooled_methods
from refusals import line_of

BASELINE_FOCAL = 22.6


def made(seed, count, *, cells=True, confidence=True, levels=7, baseline_focal=BASELINE_FOCAL):
    """Pairs with errors of all sizes, and many of one confidence."""
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.5, 6.0, count)
    estimate_m = truth_m * rng.choice([1.0, 1.01, 1.3, 0.8], count) + rng.integers(0, 9, count) / 64
    return Pairs(
        estimate_m, truth_m, count + int(rng.integers(0, 50)), baseline_focal,
        rng.integers(0, 9, count) / 2 if cells else None,
        rng.integers(0, levels, count) / 4 if confidence else None,
    )  # fmt: skip


def values(scores):
    return {score.metric: score.value for score in scores}


def pool_of(windows, most_bytes=1 << 20):
    with NumberStore(most_bytes) as store:
        pool = Pool(ALL_METRICS, store)
        for window in windows:
            pool.add(window, values(score_pairs(window)))
        return pool.values()


lists = st.lists(st.tuples(st.integers(0, 99), st.integers(0, 40)), min_size=1, max_size=6)


@given(lists, st.integers(0, 900), st.booleans(), st.booleans(), st.sampled_from([1, 3, 1000]))
def test_pooled_values_are_those_of_one_large_window(
    windows, most_bytes, cells, confidence, levels
):
    parts = [
        made(seed, count, cells=cells, confidence=confidence, levels=levels)
        for seed, count in windows
    ]
    got = pool_of(parts, most_bytes)
    assert repr(got) == repr(pool_of(parts))  # to the last digit, in memory or in a file
    whole = values(score_pairs(pooled(parts)))
    assert list(got) == list(ALL_METRICS)
    for name, value in got.items():
        assert value == pytest.approx(whole[name], rel=1e-11, abs=1e-11, nan_ok=True), name


@pytest.mark.parametrize("lacking", ["cells", "confidence"])
def test_a_window_without_a_column_leaves_the_pool_without(lacking):
    parts = [made(1, 20), made(2, 20, **{lacking: False}), made(3, 20)]
    got = pool_of(parts)
    lost = {"cells": ("mean_cells", "median_cells", "bad_1cell")}.get(lacking, ("aurc", "ause"))
    assert np.isnan([got[name] for name in lost]).all()
    assert got["mean_error"] == pytest.approx(values(score_pairs(pooled(parts)))["mean_error"])


def test_one_camera_pools_and_two_rigs_do_not():
    alone = made(1, 5, baseline_focal=float("nan"))
    got = pool_of([alone, alone])
    assert got["points"] == 10
    assert np.isnan(got["bad_1px"])
    assert "22.6 and 124" in line_of(pool_of, [made(1, 5), made(2, 5, baseline_focal=124.0)])


def regional(seed, names):
    own, common = made(seed, 30), made(seed + 1, 10)
    causes = dict.fromkeys(CAUSES, seed)
    return MethodPairs(own, common, {name: made(seed + 2, 8) for name in names}, causes)


@pytest.mark.parametrize("causes", [True, False])
def test_a_case_is_pooled_by_method_region_and_cause(causes):
    parts = [regional(k, ["edges", "moving"] if k else ["edges", "static"]) for k in range(3)]
    if not causes:
        parts[1] = MethodPairs(parts[1].own, parts[1].common, parts[1].regions)
    with NumberStore(700) as store:
        pool = CasePool(store)
        for part in parts:
            pool.add({"Alg1/H": part}, {"Alg1/H": score_method(part)})
        got = pool.scores()["Alg1/H"]
    want = score_method(pooled_methods(parts))
    assert [(s.metric, s.unit, s.direction, s.region, s.support) for s in got] == [
        (s.metric, s.unit, s.direction, s.region, s.support) for s in want
    ]
    np.testing.assert_allclose([s.value for s in got], [s.value for s in want], rtol=1e-11)


def test_rows_of_windows_that_come_one_by_one_are_those_of_all_at_once():
    windows = {f"w{k:03d}": {"Alg1/H": regional(k, ["edges"])} for k in range(3)}
    rows = case_rows("desk", windows)
    assert case_rows("desk", iter(windows.items())).equals(rows)
    assert case_rows("desk", {}).empty


def traced_mib(windows):
    """Largest allocation while so many windows of 10 000 pixels are added."""
    gc.collect()
    tracemalloc.start()
    with NumberStore(100_000) as store:
        pool = CasePool(store)
        for k in range(windows):
            own = Pairs(*np.random.default_rng(k).uniform(1, 6, (2, 10_000)), 20_000, 22.6,
                        *np.random.default_rng(k).uniform(0, 9, (2, 10_000)))  # fmt: skip
            part = MethodPairs(own, own)
            pool.add({"Alg1/H": part}, {"Alg1/H": score_method(part)})
            del own, part
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def test_memory_does_not_grow_with_windows_beyond_what_is_kept_in_it():
    assert traced_mib(24) < 1.2 * traced_mib(4)


def test_what_is_kept_is_given_back_with_its_type_or_one_line_says_why_not(monkeypatch):
    with NumberStore(20) as store:
        arrays = [np.arange(k, dtype=dtype) for k in (2, 5, 0, 7) for dtype in (float, "float32")]
        kept = [store.keep(one) for one in arrays]
        for one, back in zip(arrays, kept, strict=True):
            np.testing.assert_array_equal(back(), one, strict=True)
    full = mock.Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr("tempfile.TemporaryFile", full)
    said = line_of(NumberStore(0).keep, np.ones(3))
    assert re.search("No space left on device.*TMPDIR", said)


def test_nothing_is_left_behind(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("eventsweep.eval.scoring.score.NumberStore", lambda: NumberStore(0))
    case_rows("desk", {"w000": {"Alg1/H": regional(1, ["edges"])}})
    windows = iter([("w000", {"Alg1/H": regional(1, [])}), ("w001", {})])
    with pytest.raises(KeyError):
        case_rows("desk", windows)
    assert not list(tmp_path.iterdir())
