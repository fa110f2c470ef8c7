"""What the tracker believes of itself: its scale by stereo, how far events and map agree."""

import numpy as np
import pytest

import line_world
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.registration.fit import Fit
from eventsweep.plugins.track.odometry.trust import Trust
from line_world import tracker_of

GOOD = Fit(1000, 500, 1000, 600, 0.72)


@pytest.fixture(scope="module")
def tracker():
    """Of a pair that has just begun."""
    recording = line_world.swaying(260_000)
    tracker, _ = tracker_of(recording)
    tracker.push([recording.events(k, 0, 250_000) for k in (0, 1)], 250_000)
    return tracker


@pytest.mark.parametrize("larger", [0.98, 1.0, 1.02])
def test_stereo_measures_the_scale_of_a_map_whatever_the_motion_was(tracker, larger):
    """Law: a map that is larger by a share, about the body, is found too small by minus that."""
    registration, motion = tracker._registration, tracker._motion
    T_body_world = se3.inverse(motion.T_world_body)
    few = registration._few
    unscaled, sigma = registration.scale(motion)
    scaled = se3.transform(T_body_world, few) * larger
    registration._few = se3.transform(motion.T_world_body, scaled)
    found, _ = registration.scale(motion)
    registration._few = few
    assert found - unscaled == pytest.approx(-np.log(larger), abs=0.006)
    assert 0 < sigma < 0.03


@pytest.mark.parametrize(("fit", "scale", "said"), [
    (GOOD, (0.0, 0.01), ""),
    (Fit(1000, 500, 1000, 600, 0.62), (0.0, 0.01), "agree to 0.62"),
    (GOOD, (0.05, 0.01), "off by 5.0 %"),
    (GOOD, (0.0, np.inf), "measure the scale"),
])  # fmt: skip
def test_what_cannot_be_believed_is_said_with_its_reason(fit, scale, said):
    trust = Trust(stereo=True)
    reasons = [trust.judge(fit, scale) for _ in range(12)]
    assert all(said in reason and bool(reason) == bool(said) for reason in reasons)
    for _ in range(12):
        trust.judge(GOOD, (0.0, 0.01))
    assert not trust.reason


def test_one_camera_is_not_asked_for_the_scale():
    assert not Trust(stereo=False).judge(GOOD, (0.0, np.inf))
