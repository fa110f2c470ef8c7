"""Calibration of reliability: laws of the tables, and what they say of points not seen before."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import calibrate_confidence
from calibrate_confidence import left_out, reliability_diagram, spread
from eventsweep.emvs.depth import precision
from eventsweep.plugins.learned.training import confidence
from eventsweep.plugins.learned.training.confidence import Scored
from refusals import line_of


def points(seed, count, steepness=1.0):
    """Points whose error has a scale that falls with the score."""
    rng = np.random.default_rng(seed)
    score = rng.gamma(2, 1, count)
    return score, rng.exponential(1 / (0.1 + steepness * score))


def fit(score, error_px, most_step_px=1.0):
    return confidence.fit(Scored(score, error_px, most_step_px))


@given(st.integers(0, 1000), st.integers(40, 3000))
def test_errors_never_rise_and_precision_never_falls(seed, count):
    table = fit(*points(seed, count))
    assert np.all(np.diff(table.score) > 0)
    assert np.all(np.diff(table.error_px) <= 0)
    assert np.all(np.diff(table.precision) >= 0)
    assert np.all((table.precision >= 0) & (table.precision <= 1))


def test_stated_bands_hold_their_share_of_other_points():
    table = fit(*points(0, 40_000))
    score, error_px = points(1, 40_000)
    diagram = reliability_diagram(table, Scored(score, error_px, 1.0))
    assert len(diagram) == 10
    for line in diagram:
        assert abs(line["within"] - precision.BAND) < 0.05
        assert line["stated_px"] == pytest.approx(line["found_px"], rel=0.2)


def scattered(seed, count, noise):
    """Points as sharp by their score, in a scene whose surfaces scatter as `noise` says."""
    score, error = points(seed, count)
    return Scored(score, noise * error, 1.0, np.full(count, noise - precision.LEAST_SCATTER_PX))


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
def test_errors_by_scatter_hold_in_calm_scenes_and_in_noisy_ones(noise):
    """Law: what all depths of a scene are noisier by, bands are wider by."""
    parts = [scattered(k, 20_000, size) for k, size in enumerate((0.03, 0.3))]
    table, other = confidence.fit(confidence.joined(parts)), scattered(9, 20_000, noise)
    assert table.by_scatter
    for line in reliability_diagram(table, other, bins=5):
        assert abs(line["within"] - precision.BAND) < 0.05
    plain = confidence.fit(Scored(*(np.concatenate([getattr(p, n) for p in parts])
                                    for n in ("score", "error_px")), 1.0))  # fmt: skip
    held = [line["within"] for line in reliability_diagram(plain, replace(other, scatter_px=None))]
    assert abs(np.mean(held) - precision.BAND) > 0.05


def test_a_table_by_scatter_needs_it_of_every_point():
    table = confidence.fit(scattered(0, 1000, 0.1))
    with pytest.raises(ValueError, match="needs scatter_px"):
        table.error_at(np.ones(3, np.float32))
    mixed = confidence.joined([scattered(0, 1000, 0.1), Scored(*points(1, 1000), 1.0)])
    assert not confidence.fit(mixed).by_scatter


@pytest.mark.parametrize("wanted", [0.8, 0.85, 0.9])
def test_a_threshold_reaches_its_precision_on_other_points(wanted):
    table = fit(*points(0, 40_000))
    score, error_px = points(1, 40_000)
    kept = score >= table.least_score(wanted, "Mine/a")
    assert (error_px[kept] <= 1).mean() == pytest.approx(wanted, abs=0.02)


def test_a_score_that_says_nothing_and_steps_beyond_calibration_state_nothing():
    rng = np.random.default_rng(0)
    table = fit(rng.uniform(size=5000), rng.exponential(1.0, 5000))
    assert table.error_px[0] / table.error_px[-1] < 2
    said = line_of(table.least_score, 0.99, "Mine/a")
    assert re.search(r"Mine/a reached at most 0\.\d+ on the calibration", said)
    assert "3 points: calibration needs" in line_of(fit, np.ones(3), np.ones(3))
    rng = np.random.default_rng(0)
    telling = fit(*points(0, 40_000), most_step_px=0.8)
    assert telling.states_errors(0.8)
    assert not telling.states_errors(0.81)
    says_nothing = fit(rng.uniform(size=5000), rng.exponential(1.0, 5000))
    assert not says_nothing.states_errors(0.1)


ONE = {"error_px": [1], "precision": [1], "most_step_px": 1}
BROKEN = (
    {"score": [1], **ONE, "most_step_px": 0}, {"score": [1], **ONE, "most_step_px": float("nan")},
    {}, {"score": [1], "error_px": [1]}, {"score": [], "error_px": [], "precision": []},
    {"score": [1, 2], **ONE}, {"score": ["a"], **ONE}, {"score": [float("nan")], **ONE},
)  # fmt: skip


def test_tables_are_numbers_in_files_and_those_that_ship_cover_their_methods():
    table = fit(*points(0, 500))
    again = precision.Precision.from_json(table.to_json())
    assert not again.by_scatter
    assert precision.Precision.from_json({**table.to_json(), "by_scatter": True}).by_scatter
    np.testing.assert_allclose(again.error_px, table.error_px, rtol=1e-4)
    fusions = {f"Alg1/{name}" for name in ("min", "H", "G", "A", "RMS", "max")}
    assert set(precision.tables()) == fusions | {"EMVS/cam", "Focus/H", "Focus/cam"}
    for table in precision.tables().values():
        assert table.error_px[0] > 2 * table.error_px[-1]
        assert table.precision[-1] > 0.6
    assert precision.table_name("EMVS/cam1") == precision.table_name("EMVS/cam0") == "EMVS/cam"
    assert precision.table_name("Alg1/H") == "Alg1/H"


@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_table_is_refused(broken):
    assert "invalid precision table" in line_of(precision.Precision.from_json, broken)


def test_a_sequence_is_asked_of_a_table_of_the_others(monkeypatch):
    """Law: where errors are as elsewhere the band holds its share; where they are larger, less."""
    scales = {"a": 1.0, "b": 1.0, "c": 4.0}

    def collect(_folder, wanted, methods):
        score, error_px = points(ord(wanted[0]), 4000)
        return {methods[0]: Scored(score, scales[wanted[0]] * error_px, 1.0)}

    monkeypatch.setattr(confidence, "collect", collect)
    monkeypatch.setattr(calibrate_confidence, "_simulated", lambda _folder, scenes: scenes)
    held = left_out(None, list("abc"), ["Focus/H"])["Focus/H"]
    # Errors are exponential: four times as large, the band holds 1 - tail ** (1 / 4).
    tail = 1 - precision.BAND
    assert held[2] == pytest.approx(1 - tail**0.25, abs=0.05)
    assert min(held[:2]) > precision.BAND
    assert spread({"Focus/H": [0.5, 0.6, 0.8]}).endswith("| `Focus/H` | 60 | 50 | 80 |\n")
