"""Which unit a method's confidence has, and which scale its picture: only votes compare."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.dsi.method import OWN_UNIT, VOTES
from emvs.methods import named
from eval.figures.colormaps import Scale, confidence_scale
from eval.views import WindowView

_BUSY_PERCENT = 99.7


def unit(method: str) -> str:
    """What a method says that its confidence is, or `own unit`."""
    known = named(method)
    return known.confidence if known is not None else OWN_UNIT


def scales(window: WindowView) -> dict[str, Scale]:
    """Scale by method: one for all that count votes, one each for the others."""
    finite = {m.name: m.confidence[np.isfinite(m.confidence)] for m in window.methods}
    by_votes = [values for name, values in finite.items() if unit(name) == VOTES]
    shared = _scale(max((_busy(values) for values in by_votes), default=1.0))
    # Others report few pixels; all the rest of their picture is 0.
    return {
        name: shared if unit(name) == VOTES else _scale(_busy(values[values > 0]))
        for name, values in finite.items()
    }


def _busy(values: NDArray[np.floating]) -> float:
    return float(np.percentile(values, _BUSY_PERCENT)) if values.size else 0.0


def _scale(busy: float) -> Scale:
    return confidence_scale(float(f"{busy:.2g}"))
