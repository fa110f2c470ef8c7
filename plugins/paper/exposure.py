"""Figure 3: depth where an ordinary camera's picture is black or white."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.eval.scoring.regions import on_view
from eventsweep.plugins.paper.evidence import Evidence, Missing, View
from eventsweep.plugins.paper.statements import Finding, Verdict

CASES = ("hdr-window", "hdr-night")
METHODS = ("Alg1/H", "EMVS/cam0", "Frames/sgm")
_BLACK, _WHITE = 2, 253
"""Linear values, 0..255, at which an 8-bit picture no longer tells its levels apart."""


class Part(NamedTuple):
    """One method in one part of the picture: points per pixel of it, and median relative error."""

    covered: float
    error: float
    points: int


def parts(view: View) -> dict[str, NDArray[np.bool_]]:
    """(H, W) where the picture is black, white, and neither."""
    photo, camera = view.window.photo, view.sequence.rig.cameras[0]
    if photo is None:
        raise Missing("the sequence has no pictures")
    image = on_view(photo.image, camera)
    black, white = image <= _BLACK, image >= _WHITE
    return {"black": black, "well exposed": ~black & ~white, "white": white}


def part_of(view: View, method: str, where: NDArray[np.bool_]) -> Part:
    """What a method found there."""
    one, there = view.maps[method], where & view.truth.scored
    both = one.mask & there
    truth_m = view.truth.depth_m[both]
    errors = np.abs(one.depth_m[both] - truth_m) / truth_m
    median = 100 * float(np.median(errors)) if errors.size else float("nan")
    return Part(100 * errors.size / max(1, int(np.count_nonzero(there))), median, errors.size)


def finding(evidence: Evidence) -> Finding:
    """Whether the harmonic mean is right in every part, and better there than frames."""
    texts, right, better = [], [], []
    for case in CASES:
        view = evidence.view(case)
        for name, where in parts(view).items():
            ours, _, frames = (part_of(view, method, where) for method in METHODS)
            if not np.count_nonzero(where & view.truth.scored):
                continue
            texts.append(
                f"{case}, {name}: {ours.error:.1f} % at {ours.points:,} points, frames "
                f"{frames.error:.1f} % at {frames.points:,}"
            )
            right.append(ours.error < 10)
            if name != "well exposed":
                better.append(ours.error < frames.error)
    return Finding(
        f"Median relative error of H; {'; '.join(texts)}",
        Verdict.of(all(right), all(better)),
        "Where a frame is exposed its matcher fills whole surfaces, which are easier than edges; "
        "where it is white, depth is that of its surroundings.",
    )
