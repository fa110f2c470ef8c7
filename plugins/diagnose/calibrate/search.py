"""From a calibration that is far off to the neighbourhood of the best: scans, coarse to fine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.diagnose.calibrate.objective import COARSE, MIDDLE, Objective
from eventsweep.plugins.diagnose.calibrate.parameters import Correction, Parameter
from eventsweep.plugins.diagnose.sharpness import Level

Floats = NDArray[np.float64]
_PASSES: tuple[tuple[Level, float, int], ...] = (
    (COARSE, 1.0, 9), (COARSE, 0.5, 7), (MIDDLE, 0.25, 7), (MIDDLE, 0.12, 5),
)  # fmt: skip
"""Level, share of each parameter's reach that is scanned to either side, and points of a scan."""
_DROP = 0.02  # by which the log of sharpness should fall a step away from the top
_STEP_SHARES = (0.02, 0.5)  # of the reach: no step is smaller or larger


def scans(parameters: int) -> int:
    """How many scans `approach` makes, for its progress."""
    return parameters * len(_PASSES)


def approach(
    objective: Objective, parameters: Sequence[Parameter], start: Correction,
    on_scan: Callable[[], None],
) -> Correction:  # fmt: skip
    """Scans one parameter after the other, each around the best of those before, ever finer.

    The best determined parameters come first; `on_scan` is called after each scan.
    """
    best, cameras = start, len(objective.recording.rig)
    for level, share, points in _PASSES:
        function = objective.at(level)
        for parameter in parameters:
            offsets = np.linspace(-1, 1, points) * share * parameter.reach
            at = best.values.get(parameter, 0.0) + offsets
            values = [_score(function, best.varied({parameter: float(x)}, cameras)) for x in at]
            best = best.with_values({parameter: peak_of(at, np.array(values))})
            on_scan()
    return best


def _score(function: Objective, correction: Correction) -> float:
    return float(np.log(function(correction)).mean())


def peak_of(at: Floats, values: Floats) -> float:
    """The place of the maximum of (N,) values at equal steps: vertex of the parabola around it."""
    k = int(values.argmax())
    if not 0 < k < len(values) - 1:
        return float(at[k])
    left, top, right = values[k - 1 : k + 2]
    bend = (top - left) + (top - right)
    return (
        float(at[k] + (at[1] - at[0]) * 0.5 * (right - left) / bend) if bend > 0 else float(at[k])
    )


def steps(objective: Objective, parameters: Sequence[Parameter], at: Correction) -> Floats:
    """(P,) how far to vary each parameter so that the sharpness falls by about 2 %.

    Longer than the ripples of the top, and short enough for it to be a parabola.
    """
    middle, cameras = _score(objective, at), len(objective.recording.rig)
    chosen = []
    for parameter in parameters:
        low, high = (share * parameter.reach for share in _STEP_SHARES)
        tried = 0.25 * parameter.reach
        moved = [at.values.get(parameter, 0.0) + sign * tried for sign in (1, -1)]
        scores = [_score(objective, at.varied({parameter: x}, cameras)) for x in moved]
        drop = middle - np.mean(scores)
        wanted = tried * np.sqrt(_DROP / drop) if drop > 0 else high
        chosen.append(float(np.clip(wanted, low, high)))
    return np.array(chosen)
