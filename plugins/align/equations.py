"""Events beside edges of frames, as equations for what a frame camera's calibration lacks.

A sensor sends an event only when the light has changed by a threshold: edges of events lag behind
those of frames, as with a late clock. So three nuisances are fitted as well: a lag in pixels along
the motion, one over the edge's slope, and a shift towards the bright side. A photoreceptor's delay,
which is a time as the clock is, cannot be fitted beside it: `late_px` says what it would do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.align.edges import match
from eventsweep.plugins.align.residual import Sample, places
from eventsweep.plugins.align.rig import Correction, Setup
from eventsweep.plugins.align.views import Array

VALUES, ALL = 6, 9
"""Clock (µs), rotation about three axes (rad), principal point (px); with three nuisances."""
_STEP_RAD = 1e-4
_HUBER_PX, _LAG_PX = 0.7, 1.0
_TILES = 5
"""Tiles across a frame: what lies in one, over all frames, may be one edge of the scene."""
_DARK = 20 / 255
"""Added to light: a photoreceptor is as slow as that in the dark (v2e, CVPRW 2021)."""
_SECTORS = 8
"""Directions of an edge; with polarity, they are the kinds whose events may all lag alike."""


class Rows(NamedTuple):
    """An equation per event beside an edge.

    Attributes:
        J: (N, 9) change of `off_px` per unit of each value and nuisance.
        off_px: (N,) distance from the edge towards its bright side.
        weight: (N,) from 0 to 1.
        moves_px: (N, 2, 6) how the event moves in the frame per unit of each value.
        late_px: (N,) change of `off_px` if photoreceptors were slower by 1 µs at full light.
        tile: (N,) part of the frame in which it lies.
        kind: (N,) direction of the edge and polarity.
    """

    J: Array
    off_px: Array
    weight: Array
    moves_px: Array
    late_px: Array
    tile: NDArray[np.int64]
    kind: NDArray[np.int64]

    @property
    def mean_move_px(self) -> Array:
        """(2, 9) how the frame moves over its edges in the mean, per unit of each value."""
        mean = np.average(self.moves_px, axis=0, weights=self.weight)
        return np.pad(mean, ((0, 0), (0, ALL - VALUES)))


def rows(setup: Setup, values: Array, found: Sequence[Sample], gate_px: float) -> Rows | None:
    """The equations at some values; None where no event lies within `gate_px` of an edge.

    Args:
        setup: as calibrated.
        values: (9,).
        found: frames with their events.
        gate_px: events further from an edge belong to none. That and their weights count from where
            the nuisances expect them: counted from the edge, the clock would make up for a lag.
    """
    late_us, x, y, z = map(float, values[:4])
    turned = setup.corrected(Correction(late_us, (x, y, z)))
    parts = [_rows(turned, values, sample, gate_px) for sample in found]
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Rows(*columns) if columns and columns[2].any() else None


def _rows(setup: Setup, values: Array, sample: Sample, gate_px: float) -> Rows:
    uv_px, moving_px, _ = places(setup, sample)
    shifted_px, reach_px = uv_px + values[4:VALUES], gate_px + _LAG_PX
    pairs = match(sample.edges, shifted_px, moving_px, sample.brighter, reach_px)
    some, edge_px = pairs.points, sample.edges.uv_px[pairs.edges]
    normal, slope = sample.edges.normal[pairs.edges], sample.edges.slope[pairs.edges]
    moves_px = _moves_px(setup, sample, some, uv_px[some], moving_px[some])
    along = moving_px[some] / np.linalg.norm(moving_px[some], axis=-1)[:, None]
    across = (normal * along).sum(-1)
    lags = np.stack([across, np.sign(across) / slope, np.ones(len(some))], -1)
    J = np.concatenate([np.einsum("nj,njk->nk", normal, moves_px), lags], -1)
    # The cut-off of a photoreceptor is proportional to its light.
    slower = (1 + _DARK) / (np.maximum(sample.edges.light[pairs.edges], 0) + _DARK)
    left_px = np.abs(pairs.off_px + lags @ values[VALUES:])
    weight = np.minimum(1.0, _HUBER_PX / np.maximum(left_px, 1e-9))
    good = np.isfinite(J).all(-1) & (left_px <= gate_px)
    angle = np.arctan2(normal[:, 1], normal[:, 0])
    sector = ((angle / (2 * np.pi) + 0.5) * _SECTORS).astype(np.int64) % _SECTORS
    tile = (edge_px * _TILES // sample.edges.width_px).astype(np.int64)
    return Rows(
        np.where(good[:, None], J, 0.0), pairs.off_px, np.where(good, weight, 0.0),
        np.where(good[:, None, None], moves_px, 0.0), np.where(good, J[:, 0] * slower, 0.0),
        tile[:, 1] * 1000 + tile[:, 0], 2 * sector + sample.brighter[some],
    )  # fmt: skip


def _moves_px(
    setup: Setup, sample: Sample, some: NDArray[np.int64], uv_px: Array, moving_px: Array
) -> Array:
    """(M, 2, 6) how some of the events move in the frame per unit of each value."""
    turns = []
    for k in range(3):
        turn_rad = np.array(setup.correction.turn_rad)
        turn_rad[k] += _STEP_RAD
        turned = setup.corrected(replace(setup.correction, turn_rad=tuple(turn_rad.tolist())))
        view = turned.frame_view(sample.number)
        there_px, _ = view.seen(sample.points[some], sample.rho[some])
        turns.append((there_px - uv_px) / _STEP_RAD)
    shifts = (np.broadcast_to(one, uv_px.shape) for one in np.eye(2))
    return np.stack([moving_px / 1000, *turns, *shifts], -1)


def sums(rows: Rows, parts: NDArray[np.int64]) -> tuple[Array, Array]:
    """Normal matrix (G, 9, 9) and right side (G, 9) of each of the parts, which number the rows."""
    order = np.argsort(parts, kind="stable")
    _, starts = np.unique(parts[order], return_index=True)  # numbers of any sign
    J, weighted, off_px = rows.J[order], (rows.J * rows.weight[:, None])[order], rows.off_px[order]
    pieces = [np.split(each, starts[1:]) for each in (J, weighted, off_px)]
    normal = [w.T @ one for one, w, _ in zip(*pieces, strict=True)]
    side = [w.T @ off for _, w, off in zip(*pieces, strict=True)]
    return np.array(normal), np.array(side)
