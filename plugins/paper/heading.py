"""Forward motion: what a method reports, and what it knows where it reports as much.

A heading of 0° is sideways, one of 90° straight ahead. Methods that report fewer points may err
less for that alone, so errors are compared three times: of all points; of equally many, the surest;
and of as many as give an equal share of the texture edges in view. Straight ahead parallax grows
with the distance from the focus of expansion, the image of where the camera goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.paper.evidence import Evidence, View
from eventsweep.plugins.paper.statements import Finding, Verdict

SCENES = ("boxes", "planes")
HEADINGS_DEG = (0, 45, 90)
SIDEWAYS = tuple(f"{scene}-0" for scene in SCENES)
RINGS = 6
PAIR = ("Alg1/H", "EMVS/cam0")


class Surest(NamedTuple):
    """Relative errors of a map's points, the surest first, and how many edge pixels are in view."""

    errors: NDArray[np.float64]
    edges: int

    def of(self, count: int) -> float:
        """Median relative error of so many points, %."""
        return 100 * float(np.median(self.errors[: max(1, count)]))


def surest(view: View, method: str = "Alg1/H") -> Surest:
    """The points of a method that are scored, in order of confidence."""
    one, truth = view.maps[method], view.truth
    both = one.mask & truth.scored
    errors = np.abs(one.depth_m[both] - truth.depth_m[both]) / truth.depth_m[both]
    first = np.argsort(-one.confidence[both], kind="stable")
    edges = int(np.count_nonzero(truth.regions["edges"] & truth.scored))
    return Surest(errors[first].astype(np.float64), edges)


def pooled_surest(evidence: Evidence, cases: Sequence[str], method: str, mapper: str) -> float:
    """Mean relative error over cases, at as many points as every method of `PAIR` reports there."""
    means = []
    for case in cases:
        view = evidence.view(case, mapper)
        count = min(len(surest(view, name).errors) for name in PAIR)
        means.append(float(surest(view, method).errors[:count].mean()))
    return float(np.mean(means))


def by_heading(evidence: Evidence) -> Finding:
    """Whether sideways motion is best, by each of the three comparisons."""
    texts, best, lost = [], [], []
    for scene in SCENES:
        found = [surest(evidence.view(f"{scene}-{angle}")) for angle in HEADINGS_DEG]
        fewest = min(len(one.errors) for one in found)
        share = min(len(one.errors) / one.edges for one in found)
        every = [one.of(len(one.errors)) for one in found]
        equal = [one.of(fewest) for one in found]
        recall = [one.of(round(share * one.edges)) for one in found]
        points = [len(one.errors) for one in found]
        texts.append(
            f"{scene}: points {_list(points, ',.0f')}; median relative error {_list(every)} %, at "
            f"equal points {_list(equal)} %, at an equal share of the edges {_list(recall)} %"
        )
        better = equal[0] < equal[-1] and recall[0] < recall[-1]
        best.append((better, points[0] == max(points)))
        lost.append(next(rings(evidence.view(f"{scene}-90"))))
    near = ", ".join(f"{ring.error:.0f}" for ring in lost)
    return Finding(
        f"At 0°, 45° and 90° from sideways, {'; '.join(texts)}. Straight ahead the innermost ring "
        f"around the focus of expansion has {1000 * lost[0].found:.1f} and "
        f"{1000 * lost[1].found:.1f} points per 1000 edge pixels, {near} % off",
        Verdict.of(all(better for better, _ in best), all(more for _, more in best)),
        "What parallax does not reach is not reported, which errors of all points hide; the number "
        "of points depends on a map's own greatest confidence, by which C is scaled.",
    )


def _list(values: list[float] | list[int], form: str = ".2f") -> str:
    return ", ".join(f"{value:{form}}" for value in values)


class Ring(NamedTuple):
    """What was found at some distance from the focus of expansion.

    `from_px` and `to_px` bound it; `found` is points per edge pixel; `error` the median relative
    error, %.
    """

    from_px: float
    to_px: float
    found: float
    error: float


def rings(view: View, method: str = "Alg1/H") -> Iterator[Ring]:
    """Rings of equal width around the focus of expansion, from it to the furthest edge."""
    distance = np.hypot(*_from_focus(view))
    one, truth = view.maps[method], view.truth
    edges = truth.regions["edges"] & truth.scored
    both = one.mask & truth.scored
    error = np.zeros(both.shape)
    error[both] = np.abs(one.depth_m[both] - truth.depth_m[both]) / truth.depth_m[both]
    bounds = np.linspace(0, float(np.percentile(distance[truth.scored], 98)), RINGS + 1)
    for inner, outer in pairwise(bounds.tolist()):
        ring = (distance >= inner) & (distance < outer)
        there, points = int(np.count_nonzero(ring & edges)), ring & both
        median = 100 * float(np.median(error[points])) if points.any() else float("nan")
        yield Ring(inner, outer, int(np.count_nonzero(points)) / max(1, there), median)


def _from_focus(view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(H, W) columns and rows from the focus of expansion, px."""
    camera, way = view.window.camera, view.forward
    assert camera is not None  # a mapped window has its view
    x_px = camera.cx_px + camera.fx_px * way[0] / way[2]
    y_px = camera.cy_px + camera.fy_px * way[1] / way[2]
    rows, columns = np.indices(view.truth.depth_m.shape)
    return columns - x_px, rows - y_px
