"""Epipolar residuals: none where rows agree, as many rows as one camera is pitched."""

import numpy as np
import pytest

from eventsweep.plugins.diagnose.calibrate.before_after import epipolar_residuals_px
from eventsweep.plugins.diagnose.parameters import Correction, parameters_of
from point_world import edge_points, pinhole, stereo_rig, swinging

RECORDING = edge_points(
    swinging(turn_deg=(3, 3, 3)), stereo_rig(pinhole(160, 120, 140.0), 0.05), points=900
)
PITCH = parameters_of(("stereo",), 2)[0]


@pytest.mark.parametrize("pitch_deg", [0.0, 0.8])
def test_rows_miss_by_as_much_as_a_camera_is_pitched(pitch_deg):
    changed = Correction({PITCH: pitch_deg}).applied(RECORDING)
    missed = epipolar_residuals_px(changed, 600_000, 0.7)
    assert len(missed) > 5
    assert abs(np.median(missed)) == pytest.approx(140 * np.radians(pitch_deg), abs=0.6)
