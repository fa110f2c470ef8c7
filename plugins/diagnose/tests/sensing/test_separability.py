"""Laws of the number that says how real events look."""

import json
from functools import cache

import numpy as np
import pytest

from eventsweep.emvs.data.events import Events
from eventsweep.plugins.diagnose.sensing.folder import write_realism
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.plugins.diagnose.sensing.realism import (
    area_under_curve,
    compared,
    portrait,
    separability,
)
from refusals import line_of

WINDOW = np.repeat(np.arange(40), 6)


def rows(seed, shift=0.0):
    return np.random.default_rng(seed).standard_normal((240, 5)) + shift


def test_area_is_the_share_of_pairs_in_order():
    rng = np.random.default_rng(1)
    a, b = rng.integers(0, 9, 30).astype(float), rng.integers(2, 12, 20).astype(float)
    pairs = [(x < y) + 0.5 * (x == y) for x in a for y in b]
    assert area_under_curve(a, b) == pytest.approx(np.mean(pairs))


def test_the_further_rows_are_shifted_the_more_surely_they_are_told_apart_in_any_unit():
    assert separability(rows(0), rows(0), (WINDOW, WINDOW)) == pytest.approx(0.5, abs=1e-9)
    areas = [separability(rows(1), rows(2, d), (WINDOW, WINDOW)) for d in (0.2, 0.5, 3.0)]
    assert areas == sorted(areas)
    assert areas[0] > 0.55
    assert areas[2] > 0.99
    a, b, scale = rows(3), rows(4, 0.3), np.array([1, 1e3, 1e-3, 7, 0.1])
    plain = separability(a, b, (WINDOW, WINDOW))
    scaled = separability(a * scale + 5, b * scale + 5, (WINDOW, WINDOW))
    assert scaled == pytest.approx(plain, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_rows_of_one_distribution_are_near_a_half(seed):
    area = separability(rows(seed), rows(seed + 100), (WINDOW, WINDOW))
    assert area == pytest.approx(0.5, abs=0.12)


@pytest.mark.parametrize("shift", [0.0, 0.3, 1.0])
def test_it_does_not_matter_which_comes_first(shift):
    a, b = rows(3), rows(4, shift)[:180]
    there = separability(a, b, (WINDOW, WINDOW[:180]))
    assert separability(b, a, (WINDOW[:180], WINDOW)) == pytest.approx(there, abs=1e-6)


@cache
def noise(seed, rate_hz, on_share=0.5, shape=(60, 80)):
    rng = np.random.default_rng(seed)
    count = round(rate_hz * shape[0] * shape[1] * 2)
    t_us = np.sort(rng.integers(0, 2_000_001, count))
    x, y = rng.integers(0, shape[1], count), rng.integers(0, shape[0], count)
    p = (rng.random(count) < on_share).astype(np.uint8)
    events = Events(x.astype(np.uint16), y.astype(np.uint16), t_us, p)
    return portrait(f"noise {seed}", events, shape, (0, 2_000_000))


@pytest.mark.slow
def test_two_streams_of_one_kind_and_of_two_kinds():
    alike = compared(noise(0, 10), noise(1, 10))
    assert alike.auc == pytest.approx(0.5, abs=0.12)
    assert compared(noise(0, 10), noise(1, 10, 0.8)).auc > 0.95
    assert compared(noise(0, 10), noise(1, 25)).auc > 0.95
    assert alike.real.statistics["events per pixel and second"] == pytest.approx(10, rel=0.02)
    assert alike.facts()["auc"] == alike.auc


def test_the_page_and_its_facts_unless_there_are_too_few_events(tmp_path):
    alike = compared(noise(0, 10), noise(0, 10))
    write_realism(tmp_path, alike, "command")
    assert json.loads((tmp_path / "realism.json").read_text()) == alike.facts()
    assert alike.auc == pytest.approx(0.5)
    assert "AUC of 0.500" in (tmp_path / "report.html").read_text()
    assert "take a longer recording" in line_of(noise, 0, 0.05)


def of_pixels(x, y, t_us):
    """Events on a sensor of 10 x 30 px, sorted by pixel."""
    order = np.argsort(t_us, kind="stable")
    x, y = (np.asarray(a)[order].astype(np.uint16) for a in (x, y))
    events = Events(x, y, np.asarray(t_us)[order].astype(np.int64), np.ones(len(x), np.uint8))
    return PixelEvents.of(events, (10, 30), (0, int(events.t_us[-1])))


def test_isolated_events_are_alone_and_edges_fire_by_contrast_speed_and_threshold():
    # The pair (5, 6) is not alone; a pixel is no neighbour of itself.
    pixels = of_pixels([5, 6, 20, 20, 21], [3] * 5, [0, 4000, 0, 4000, 90_000])
    assert pixels.alone.tolist() == [False, False, True, True, True]
    # Edges that pass fire a column at a time, n times 2 ms apart; single noise has no say.
    columns, rows, fires = np.arange(20), np.arange(10), np.arange(3)
    x, y, n = (a.ravel() for a in np.meshgrid(columns, rows, fires, indexing="ij"))
    noise = (np.array([25, 25]), np.array([5, 5]), np.array([1000, 1800]))
    x, y, t_us = (np.append(a, b) for a, b in zip((x, y, 7000 * x + 2000 * n), noise, strict=True))
    edge_hz = of_pixels(x, y, t_us).edge_hz
    assert len(edge_hz) == 20 * 10 * 2
    np.testing.assert_allclose(edge_hz, 500.0)
