"""Clock and rotation of a frame camera that bring edges of frames and events together.

Gauss-Newton over the events' distances from the edges of the frames. A sensor sends an event only
when the light has changed by a threshold: on average its edges lag behind those of the frames, by a
part of the threshold over the edge's slope. That part is fitted as well, since it looks like a late
clock. Intervals come from the scatter between patches of the frames, whose events depend on each
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.align.edges import match
from eventsweep.plugins.align.residual import Sample, places
from eventsweep.plugins.align.rig import Correction, Setup
from eventsweep.plugins.align.views import Array

MARGIN_US = 20_000
"""No clock is found to be later or earlier than this."""
_GATES_PX = (8.0, 6.0, 4.0, 3.0, 2.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5)
_STEPS = np.array([100.0, 1e-4, 1e-4, 1e-4])  # µs, rad
_HUBER_PX = 0.7
_PATCH_PX = 48
_NAMES = ("clock", "rotation about x", "rotation about y", "rotation about z")
_UNITS = ("ms", "deg", "deg", "deg")
_SCALE = np.array([1e-3, *[180 / np.pi] * 3])
_LOOSE = (10.0, 2.0, 2.0, 2.0)
"""Half-widths beyond which the data do not determine a value, ms and deg."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval: `value` +- `half`."""

    name: str
    unit: str
    value: float
    half: float
    known: bool

    @property
    def words(self) -> str:
        """The value and its interval, or that the data do not determine it."""
        if not self.known:
            return "not determined"
        return f"{self.value:+.3f} ± {self.half:.3f} {self.unit}"


@dataclass(frozen=True)
class Found:
    """The correction, and each of its values with an interval."""

    correction: Correction
    estimates: tuple[Estimate, ...]


def find_offset(setup: Setup, found: Sequence[Sample]) -> Found:
    """Finds what the clock and rotation of the frame camera lack.

    Raises:
        InputError: too few events beside edges, or a correction that runs away.
    """
    values, scale = np.zeros(5), 1.0
    for gate_px in _GATES_PX:
        moved = setup.corrected(_correction(values))
        normal, pull, patches = _equations(moved, found, gate_px)
        scale = np.maximum(np.sqrt(np.diag(normal)), 1e-12)
        step = np.linalg.lstsq(normal / np.outer(scale, scale), -pull / scale, rcond=1e-9)[0] / scale
        values = np.append(values[:4] + step[:4], step[4])
        if abs(values[0]) > MARGIN_US:
            raise InputError(
                f"{setup.recording.name}: no clock within {MARGIN_US / 1000:g} ms brings frames "
                "and events together: check that both use one clock"
            )
    return Found(_correction(values), _estimates(values, normal, patches))


def _correction(values: Array) -> Correction:
    late_us, x, y, z = (float(v) for v in values[:4])
    return Correction(late_us, (x, y, z))


def _equations(
    setup: Setup, found: Sequence[Sample], gate_px: float
) -> tuple[Array, Array, list[Array]]:
    """Normal matrix (5, 5), gradient (5,), and the gradient of each patch of the frames."""
    normal, pull, patches = np.zeros((5, 5)), np.zeros(5), []
    for sample in found:
        uv_px, moving_px, _ = places(setup, sample)
        pairs = match(sample.edges, uv_px, moving_px, sample.brighter, gate_px)
        if len(pairs.points) < 10:
            continue
        edge_normal = sample.edges.normal[pairs.edges]
        rows = [_change(setup, sample, uv_px, k)[pairs.points] for k in range(4)]
        J = np.stack([(edge_normal * row).sum(-1) for row in rows], -1)
        across = np.sign((edge_normal * moving_px[pairs.points]).sum(-1))
        J = np.column_stack([J, across / sample.edges.slope[pairs.edges]])
        weight = np.minimum(1.0, _HUBER_PX / np.maximum(np.abs(pairs.off_px), 1e-9))
        good = np.isfinite(J).all(-1)
        J, r, weight = J[good], pairs.off_px[good], weight[good]
        normal += (J * weight[:, None]).T @ J
        each = J * (weight * r)[:, None]
        pull += each.sum(0)
        tiles = (sample.edges.uv_px[pairs.edges[good]] // _PATCH_PX).astype(np.int64)
        _, patch = np.unique(tiles[:, 1] * 10_000 + tiles[:, 0], return_inverse=True)
        sums = np.zeros((patch.max() + 1, 5, 6))
        np.add.at(sums, patch, np.concatenate(
            [(J * weight[:, None])[:, :, None] * J[:, None, :], each[:, :, None]], -1
        ))  # fmt: skip
        patches += list(sums)
    if len(patches) < 10:
        raise InputError(
            f"{setup.recording.name}: too few events lie beside edges of frames to compare clocks"
        )
    return normal, pull, patches


def _change(setup: Setup, sample: Sample, uv_px: Array, k: int) -> Array:
    """(N, 2) how the points move in the frame per unit of a value, px."""
    values = np.zeros(4)
    values[k] = _STEPS[k]
    before = setup.correction
    turned = np.array(before.turn_rad) + values[1:]
    moved = setup.corrected(Correction(before.late_us + values[0], tuple(turned.tolist())))
    there, _ = moved.frame_view(sample.index).seen(sample.points, sample.rho)
    return (there - uv_px) / _STEPS[k]


def _estimates(values: Array, normal: Array, patches: list[Array]) -> tuple[Estimate, ...]:
    """Intervals of 95 %, from how patches differ: their events are not independent."""
    inverse = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
    # The lag was fitted anew, so each patch's gradient is what is left of it at the end.
    lag = np.zeros(5)
    lag[4] = values[4]
    left = np.array([each[:, 5] + each[:, :5] @ lag for each in patches])
    covariance = inverse @ (left.T @ left) @ inverse
    half = student.ppf(0.975, len(patches) - 5) * np.sqrt(np.maximum(np.diag(covariance), 0))
    found = []
    for k, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
        width = float(half[k] * _SCALE[k])
        known = np.isfinite(width) and 0 < width <= _LOOSE[k]
        found.append(Estimate(name, unit, float(values[k] * _SCALE[k]), width, bool(known)))
    return tuple(found)
