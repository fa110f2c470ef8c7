"""What the tracker believes of itself: by scale, regions, spread, and maps that confirm it."""

import numpy as np
import pytest

import line_world
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry import trust as module
from eventsweep.plugins.track.odometry.registration.fit import Evidence, Fit
from eventsweep.plugins.track.odometry.trust import (
    ASTRAY,
    SHORT,
    UNCONFIRMED,
    Trust,
    disagrees,
    speaks_against,
)
from line_world import tracker_of

GOOD, SEEN = Fit(1000, 500, 1000, 600, 0.72), Evidence(0.0, 0.01, 0.0)


@pytest.fixture(scope="module")
def tracker():
    """Of a pair that has just begun."""
    recording = line_world.swaying(260_000)
    tracker, _ = tracker_of(recording)
    tracker.push([recording.events(k, 0, 250_000) for k in (0, 1)], 250_000)
    return tracker


def confirmed(*, stereo=True):
    """A trust whose beginning a second map has confirmed."""
    trust = Trust(stereo=stereo)
    trust.next_map()
    for _ in range(12):
        trust.judge(GOOD, SEEN)
    return trust


@pytest.mark.parametrize("larger", [0.98, 1.0, 1.02])
def test_stereo_measures_the_scale_of_a_map_whatever_the_motion_was(tracker, larger):
    """Law: a map that is larger by a share, about the body, is found too small by minus that."""
    registration, motion = tracker._registration, tracker._motion
    T_body_world = se3.inverse(motion.T_world_body)
    few = registration._few
    unscaled = registration.evidence(motion)
    scaled = se3.transform(T_body_world, few) * larger
    registration._few = se3.transform(motion.T_world_body, scaled)
    found = registration.evidence(motion)
    registration._few = few
    assert found.scale_off - unscaled.scale_off == pytest.approx(-np.log(larger), abs=0.006)
    assert 0 < found.scale_sigma < 0.03


def test_a_part_of_the_map_that_moves_by_itself_is_off_in_its_regions(tracker):
    registration, motion = tracker._registration, tracker._motion
    few = registration._few
    assert registration.evidence(motion).regions_off < 0.05
    X, _, Z = se3.transform(se3.inverse(motion.T_world_body), few).T
    moved = few + np.where(X / Z < 0, 1.0, 0.0)[:, None] * (Z / 90)[:, None] * [0.7, 0.7, 0]
    registration._few = moved  # the left half by about 1.5 px
    off = registration.evidence(motion).regions_off
    registration._few = few
    assert 0.2 < off < 0.8


@pytest.mark.parametrize(("fit", "evidence", "said"), [
    (GOOD, SEEN, ""),
    (Fit(1000, 500, 1000, 600, 0.62), SEEN, "agree to 0.62"),
    (GOOD, Evidence(0.05, 0.01, 0.0), "off by 5.0 %"),
    (GOOD, Evidence(0.0, 0.01, 0.3), "30 % of the image's regions"),
])  # fmt: skip
def test_what_cannot_be_believed_is_said_with_its_reason(fit, evidence, said):
    trust = confirmed()
    reasons = [trust.judge(fit, evidence) for _ in range(12)][-1:]
    assert all(said in reason and bool(reason) == bool(said) for reason in reasons)
    for _ in range(12):
        trust.judge(GOOD, SEEN)
    assert not trust.reason


def test_a_path_that_may_be_off_by_much_of_its_way_is_doubted_where_images_would_show_it():
    trust = confirmed()
    assert "20 % of the way" in trust.judge(GOOD, SEEN, spread=0.2, px=5.0)
    assert not trust.judge(GOOD, SEEN, spread=0.2, px=1.0)


def test_a_beginning_is_believed_once_poses_agree_with_a_second_map():
    trust = Trust(stereo=True)
    assert {trust.judge(GOOD, SEEN) for _ in range(30)} == {UNCONFIRMED}
    trust.next_map()
    assert [bool(trust.judge(GOOD, SEEN)) for _ in range(6)] == [True] * 4 + [False] * 2


def test_a_short_way_is_waited_for_last_and_speaks_against_nothing():
    trust = Trust(stereo=True)
    assert trust.judge(GOOD, SEEN, is_short=True) == UNCONFIRMED
    trust = confirmed()
    assert [trust.judge(GOOD, SEEN, is_short=k < 2) for k in range(3)] == [SHORT, SHORT, ""]
    assert "agree to" in trust.judge(Fit(1000, 500, 1000, 600, 0.0), SEEN, is_short=True)
    assert not trust.is_sound
    assert speaks_against(trust.reason)


def test_a_path_that_maps_of_doubted_poses_led_astray_is_doubted_and_disagrees_with_nothing():
    trust = confirmed()
    assert trust.judge(GOOD, SEEN, is_short=True, is_astray=True) == ASTRAY
    assert trust.is_sound
    assert speaks_against(ASTRAY)
    assert not disagrees(ASTRAY)
    assert disagrees(trust.judge(Fit(1000, 500, 1000, 600, 0.0), SEEN, is_astray=True))
    assert not disagrees(confirmed().judge(GOOD, SEEN, spread=0.2, px=5.0))
    trust.restart()
    assert not disagrees(trust.judge(GOOD, SEEN))


def mapped(sigma, maps, trust):
    """What it says at the end of each of so many maps whose stereo leaves the scale so open."""
    reasons = []
    for _ in range(maps):
        trust.next_map()
        reasons += [trust.judge(GOOD, Evidence(0.0, sigma, 0.0)) for _ in range(20)][-1:]
    return reasons


def test_what_maps_say_of_the_scale_adds_up_as_a_kalman_filter_has_it():
    """An independent twin: the filter by its textbook steps, predict and update."""
    trust, variance = Trust(stereo=True), np.inf
    for sigma in (0.05, 0.05, 0.04, 0.2, 0.06):
        mapped(sigma, 1, trust)
        gain = 1.0 if np.isinf(variance) else variance / (variance + sigma**2)
        variance = sigma**2 if np.isinf(variance) else (1 - gain) * variance
        assert trust.scale_sigma == pytest.approx(variance**0.5)
        variance += (module._WALK * sigma) ** 2


def test_a_scale_that_each_map_measures_badly_is_known_by_many_and_by_none_forever():
    """5 % per map is 3 % over four; 20 % never; what was near is forgotten in the far."""
    said = [bool(reason) for reason in mapped(0.05, 8, Trust(stereo=True))]
    assert said == [True] * 3 + [False] * 5
    assert all(mapped(0.2, 100, Trust(stereo=True)))
    far = mapped(0.1, 10, confirmed())
    assert not far[0]
    assert far[-1].startswith("the scale is known to")


def test_what_was_known_of_the_scale_before_an_interruption_counts_no_more():
    trust = Trust(stereo=True)
    mapped(0.05, 8, trust)
    trust.restart()
    trust.judge(GOOD, Evidence(0.0, 0.05, 0.0))
    assert trust.scale_sigma == pytest.approx(0.05)


def test_a_scale_that_is_not_measured_is_not_known_and_one_that_is_off_is_wrong():
    unmeasured, off = Trust(stereo=True), confirmed()
    for _ in range(12):
        unmeasured.judge(GOOD, Evidence(0.0, 0.05, 0.0))
        off.judge(GOOD, Evidence(0.05, 0.01, 0.0))
    assert not unmeasured.is_sound
    assert not speaks_against(unmeasured.reason)
    assert speaks_against(off.reason)


def test_after_an_interruption_some_poses_must_agree_first():
    trust = confirmed()
    trust.restart()
    assert [bool(trust.judge(GOOD, SEEN)) for _ in range(6)] == [True] * 4 + [False] * 2
    trust.restart()
    assert "agree to 0.66" in trust.judge(Fit(1000, 500, 1000, 600, 0.66), SEEN)


def test_one_camera_is_not_asked_for_the_scale():
    assert not confirmed(stereo=False).judge(GOOD, Evidence(0.0, np.inf, 0.0))
