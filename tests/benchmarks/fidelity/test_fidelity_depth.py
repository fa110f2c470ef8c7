"""Scores of several maps taken together are those of all their points."""

import numpy as np
import pytest

from eventsweep.emvs.data.events import Events
from fidelity_depth import Pair, Scored, TrueEvents, beside, pooled, shown
from panel_cases import panel_case


def test_the_mean_of_several_maps_is_that_of_all_their_points():
    rng = np.random.default_rng(0)
    maps = [rng.random(number) for number in (3, 0, 50)]
    parts = [Scored(errors.mean() if errors.size else np.nan, errors.size) for errors in maps]
    everything = np.concatenate(maps)
    assert pooled(parts) == pytest.approx((everything.mean(), everything.size))
    assert np.isnan(pooled(parts[1:2]).error_m)


def test_a_smaller_error_from_the_simulator_is_negative():
    assert shown(Pair(Scored(0.9, 5), Scored(1.0, 4))) == "−10.0 % (5, 4)"


def test_windows_take_the_true_events_in_them():
    t_us = np.array([1, 5, 5, 9])
    column = np.arange(4)
    events = Events(column.astype(np.uint16), column.astype(np.uint16), t_us, column % 2 == 1)
    found = TrueEvents(None, (events,)).events(0, 5, 9)
    assert found.t_us.tolist() == [5, 5]
    assert found.x.tolist() == [1, 2]


def test_the_other_camera_looks_the_same_way_from_the_right():
    case = panel_case("slit")
    right, T_left_right = beside(case)
    for t_s in (0.0, case.duration_s):
        apart = np.linalg.inv(case.world.T_world_cam(t_s)) @ right.world.T_world_cam(t_s)
        assert np.allclose(apart, T_left_right)
    assert T_left_right[0, 3] > 0
