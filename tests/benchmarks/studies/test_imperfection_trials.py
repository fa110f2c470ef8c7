"""Maps extracted afterwards are those that the mapper makes; what is near is counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.scoring.metrics import Pairs
from eventsweep.eval.scoring.pairing import Truth
from fit_imperfection import off
from imperfection_trials import (
    CAPS,
    PAIR,
    Extraction,
    Trial,
    config_of,
    extracted,
    joined,
    pairs_of,
    without_lone,
)
from point_world import fronto_parallel
from published_table import MONO, H

RAW = MapperConfig(min_depth_m=0.5, max_depth_m=4, planes=25, median_px=1, methods=PAIR)


@pytest.fixture(scope="module")
def raw():
    return map_window(fronto_parallel(1.23), RAW).depth_maps


@pytest.mark.parametrize("settings", [
    {"threshold_c": 14, "median_px": 9}, {"threshold_c": 5, "median_px": 5, "max_confidence": 60},
    {"threshold_c": 20, "median_px": 1, "border_px": 20},
])  # fmt: skip
def test_a_map_extracted_afterwards_is_the_mapper_s_own(raw, settings):
    config = RAW.model_copy(update=settings)
    for name, one in map_window(fronto_parallel(1.23), config).depth_maps.items():
        later = extracted(raw[name], config)
        np.testing.assert_array_equal(later.mask, one.mask)
        assert one.points > 50
        np.testing.assert_allclose(later.depth_m[one.mask], one.depth_m[one.mask], rtol=1e-6)


def test_points_that_stay_have_three_others_near_by(raw):
    one = extracted(raw[H.ours], RAW.model_copy(update={"threshold_c": 30.0}))
    kept = without_lone(one, 0.1).mask
    rows, columns = np.nonzero(one.mask)
    camera = one.camera
    bearing = camera.unproject(np.stack([columns, rows], -1).astype(float))
    place = one.depth_m[rows, columns][:, None] * np.c_[bearing, np.ones(len(bearing))]
    near = (np.linalg.norm(place[:, None] - place, axis=-1) < 0.1).sum(1) - 1
    np.testing.assert_array_equal(kept[rows, columns], near >= 3)
    assert 0 < kept.sum() < one.points


def test_errors_are_cut_off_on_both_sides_and_windows_count_by_their_pixels(raw):
    shape = raw[H.ours].depth_m.shape
    truth = Truth(np.full(shape, 1.23), np.ones(shape, bool), 200.0, 0.1)
    wrong = replace(raw[H.ours], depth_m=np.where(np.indices(shape)[1] % 2, 3.0, 0.6))
    found = pairs_of(wrong, truth, RAW, Extraction(most_error_m=0.25))
    np.testing.assert_allclose(found.error_m, 0.25)
    assert {round(float(e), 2) for e in found.estimate_m} == {0.98, 1.48}
    parts = [Pairs(np.full(n, 2.0), np.full(n, 2.0 - e), 9, 22.6) for n, e in ((1, 0.4), (3, 0.8))]
    both = joined(parts)
    assert (both.count, both.truth_count) == (4, 18)
    assert both.error_m.mean() == pytest.approx(0.7)


def test_each_flight_has_its_own_cap_and_only_one_camera_its_own_threshold():
    how = Extraction(cap=CAPS, mono_c=10)
    assert [config_of(how, H.ours, k, 50.0).max_confidence for k in range(4)] == [*CAPS, CAPS[0]]
    assert [config_of(how, name, 0, 50.0).threshold_c for name in PAIR] == [14, 10]
    assert config_of(Extraction(cap=None), H.ours, 0, 50.0).max_confidence == 50


def test_errors_are_drawn_again_only_where_there_are_any():
    wrong = Trial(wrong={"pose_walk_mm": 1})
    jobs = {wrong.job(draw).name for draw in wrong.draws((0, 1), 3)}
    assert len(jobs) == len(wrong.draws((0, 1), 3)) == 12
    assert len(Trial().draws((0, 1), 3)) == 4
    assert (
        wrong.job(wrong.draws((0,))[0]).needs[0].name
        == Trial().job(Trial().draws((0,))[0]).needs[0].name
    )


def test_the_published_numbers_are_off_by_nothing_and_six_are_compared():
    found = {
        one.ours: {
            "points": one.points_m, "mean_error": one.mean_cm / 100,
            "median_error": one.median_cm / 100, "bad_published": one.bad_percent,
        }
        for one in (H, MONO)
    }  # fmt: skip
    assert off(found) == pytest.approx(1)
    found[H.ours]["points"] *= 2
    assert np.log(off(found)) == pytest.approx(np.log(2) / np.sqrt(6))
    found[MONO.ours]["bad_published"] = 0.0
    assert off(found) == float("inf")
