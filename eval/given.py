"""Depth maps of others beside ours: opened for a run's windows, complete or refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from emvs.errors import InputError
from emvs.maps.folder import StoredWindow
from eval.config import EvalConfig
from eval.folders import Scored, truth_of
from eval.pairing import Estimate
from eval.predictions import Prediction, View


def view_of(sequence: Scored, window: StoredWindow, config: EvalConfig) -> View:
    """The reference view of a window: camera 0 without lens distortion.

    Raises:
        InputError: no ground truth is stored at its time.
    """
    camera, rig = sequence.rig.cameras[0], sequence.rig
    truth = truth_of(sequence, window.info.t_ref_us, config)
    known_m = truth.depth_m[truth.scored]
    return View(
        t_us=window.info.t_ref_us,
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.fx_px,
        baseline_m=rig.baseline_m() if len(rig) > 1 else None,
        true_depth_m=float(np.median(known_m)) if known_m.size else None,
    )


def opened(folders: Sequence[Path], case: str, views: Sequence[View]) -> list[Prediction]:
    """Opens predictions and checks that none lacks a view and that their names differ.

    Raises:
        InputError: what `Prediction.open` and `Prediction.check` refuse, or two of one name.
    """
    found = [Prediction.open(folder, case) for folder in folders]
    for prediction in found:
        prediction.check(views)
    names = [prediction.name for prediction in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two predictions are called {twice}: set name in their prediction.toml")
    return found


def estimates(predictions: Sequence[Prediction], view: View) -> dict[str, Estimate]:
    """What each prediction says of a view, by name."""
    return {
        one.name: Estimate(*one.depth_m(view), confidence=one.confidence(view))
        for one in predictions
    }
