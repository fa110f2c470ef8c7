"""Why pixels are bad: each gets exactly one cause, the first that applies in a stated order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]

CAUSES: dict[str, str] = {
    "out_of_range": "the true depth lies outside the planes that were swept",
    "moving": "the pixel shows something that moves by itself",
    "occlusion": "at a depth discontinuity, or hidden from another camera",
    "repeated": "the wrong point meets another, similar edge in another camera",
    "few_events": "a camera has too few events where the true point was seen",
    "noise": "most events where the wrong point would be seen are noise",
    "ambiguous": "every camera has as many events for the wrong point as for the true one, or more",
    "other": "none of these: the events favour the true depth",
}
"""Causes in the order in which they are asked, each with its test."""


def count_causes(flags: Mapping[str, Flags], bad: int) -> dict[str, int]:
    """Counts bad pixels by their first cause.

    Args:
        flags: per cause, (N,) whether it applies to each bad pixel; a missing cause applies to
            none, and what no cause applies to is `other`.
        bad: N.

    Returns:
        Counts of all causes, which add up to N.
    """
    left = np.ones(bad, np.bool_)
    counts = {}
    for cause in CAUSES:
        found = left & flags.get(cause, np.full(bad, cause == "other"))
        counts[cause] = int(np.count_nonzero(found))
        left = left & ~found
    return counts


def pooled_causes(parts: Sequence[Mapping[str, int] | None]) -> dict[str, int] | None:
    """Adds counts of several windows; None where any has none."""
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    return {cause: sum(part[cause] for part in known) for cause in CAUSES}
