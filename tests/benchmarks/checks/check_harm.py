"""Whether a fault that was not noticed does harm: the map's error and points with and without it.

The rule was stated before any campaign was opened under it: a fault is harmless if, over three
windows, the mean relative error of the depth (`Alg1/H`) grows by less than a tenth and the points
fall by less than a tenth. The studies call a property harmful where the error doubles.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import eventsweep as es
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError

_METHOD, _STARTS_S, _WINDOW_S = "Alg1/H", (0.05, 0.2, 0.35), 0.2
_HARMLESS = 0.1


def harm(right: Recording, spoilt: Recording) -> dict[str, Any]:
    """By how many times error and points change: `error`, `points` and whether `harmless`.

    Args:
        right: the recording as simulated, which knows the depth.
        spoilt: the same with a fault.
    """
    before, after = (np.mean([_scores(one, right, s) for s in _STARTS_S], axis=0)
                     for one in (right, spoilt))  # fmt: skip
    error, points = map(float, after / before)
    harmless = error < 1 + _HARMLESS and points > 1 - _HARMLESS
    return {"error": error, "points": points, "harmless": harmless}


def _scores(recording: Recording, right: Recording, start_s: float) -> tuple[float, float]:
    """Relative error, %, and points of a window's map; a window that cannot be mapped is harmed."""
    config = es.MapperConfig(methods=(_METHOD,), start_s=start_s, duration_s=_WINDOW_S)
    try:
        rows = es.score(es.map_window(recording, config), right).rows
    except InputError:
        return np.inf, 0.0
    own = rows[(rows.method == _METHOD) & (rows.window == "w000") & (rows.region == "all")]
    values = dict(zip(own.metric, own.value, strict=True))
    return float(values["abs_rel"]), float(values["points"])
