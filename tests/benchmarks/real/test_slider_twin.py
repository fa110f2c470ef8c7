"""The twin's light moves as a scene does, and the classifier separates sensors that differ."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eventsweep.plugins.diagnose.sensing.frames import FrameStack
from eventsweep.plugins.diagnose.sensing.realism import compared, portrait
from places import SHARED
from slider_twin import between, main, moved, sideways_px, table_of, watched

SLIDER = SHARED / "data" / "slider_depth"


def sliding(shift_px, shape=(90, 120)):
    """A texture, moved to the right."""
    noise = np.random.default_rng(4).random((shape[0], shape[1] + 60)).astype(np.float32)
    wide = cv2.GaussianBlur(noise, (0, 0), 2.5)
    wide = 0.1 + 0.8 * (wide - wide.min()) / np.ptp(wide)
    move = np.array([[1, 0, shift_px - 30], [0, 1, 0]], float)
    return cv2.warpAffine(wide, move, shape[::-1], flags=cv2.INTER_CUBIC)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.8])
def test_light_between_two_frames_lies_where_the_scene_is(share):
    """Blending two frames would show each edge twice."""
    one, two, true = sliding(0), sliding(6), sliding(6 * share)
    there, back = sideways_px(one, two), sideways_px(two, one)
    inside = (slice(10, -10), slice(15, -15))
    assert np.median(there[inside]) == pytest.approx(6, abs=0.2)
    off = np.abs(between(one, two, there, back, share) - true)[inside].mean()
    blended = np.abs((1 - share) * one + share * two - true)[inside].mean()
    assert off < 0.25 * blended


def test_moved_frames_keep_the_frames_and_tell_a_threshold_from_another():
    light = np.stack([sliding(4 * k) for k in range(14)])
    t_us = 40_000 * np.arange(14)
    frames = moved(FrameStack(t_us, light, np.ones(light.shape, bool), True), 4000)
    assert len(frames.t_us) == 131
    np.testing.assert_array_equal(frames.light[::10], light)
    seen = [
        portrait(f"{c}", watched(frames, dict.fromkeys(NAMES, c)), (90, 120), (0, 520_000))
        for c in (0.2, 0.21, 0.5)
    ]
    near, far = compared(*seen[:2]), compared(seen[0], seen[2])
    assert near.auc < far.auc
    assert far.auc > 0.9
    text = table_of([("near", {}, near), ("far", {}, far)])
    assert text.splitlines()[0] == "|  | real | near | far |"


NAMES = "contrast_threshold_pos", "contrast_threshold_neg"


@pytest.mark.slow
@pytest.mark.skipif(not SLIDER.exists(), reason="needs ../shared/data/slider_depth")
def test_the_fitted_twin_is_hard_to_tell_and_the_presets_easy(capsys):
    assert main(["--slider", str(SLIDER)]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("| AUC"))
    ideal, preset, fitted = map(float, row.split("|")[3:6])
    assert fitted <= 0.75 < 0.9 < min(ideal, preset)
