"""What is expected of a motion: it does not depend on the unit of length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.odometry.motion import Motion, reach_for


@pytest.mark.parametrize("begin", [Motion.unknown, Motion.near])
def test_a_world_that_is_larger_is_the_same_motion_in_other_units(begin):
    """All lengths 8 times as long: so are positions and velocities, and their errors."""
    units = np.diag(np.repeat([8.0, 1, 8, 1], 3))
    pose, twist = se3.exp([0.1, -0.2, 0.3, 0.4, 0.1, -0.3]), np.array([1, 2, -1, 0.5, 0.1, 2])
    longer = pose.copy()
    longer[:3, 3] *= 8
    small = replace(begin(0, pose), twist=twist).at(12_000)
    large = replace(begin(0, longer, 8.0), twist=units[:6, :6] @ twist).at(12_000)
    np.testing.assert_allclose(large.T_world_body[:3, 3], 8 * small.T_world_body[:3, 3])
    np.testing.assert_allclose(large.covariance, units @ small.covariance @ units, rtol=1e-9)
    assert large.held(13_000).reach == large.turning(np.zeros(3), 0.1).reach == 8


def test_heads_reach_as_far_as_they_do_and_cars_farther():
    assert reach_for(0.2) == reach_for(0.5) == 1
    assert reach_for(4.0) == 8
