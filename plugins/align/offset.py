"""Clock and rotation of a frame camera that bring edges of frames and events together.

Gauss-Newton over the events' distances from the edges of the frames. A sensor sends an event only
when the light has changed by a threshold: its edges lag behind those of the frames, as with a late
clock. So three nuisances are fitted as well: a lag in pixels, one over the edge's slope, and a
shift towards the bright side. Intervals come from the scatter between patches of the frames, whose
events depend on each other, and from what these three leave: `COHERENT_PX`.
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
_ALL = 7  # four values, three nuisances
COHERENT_PX = np.array([0.15, 0.065, 0.065, 0.065])
"""Edges of events and frames may be off by so much all together, px: behind, right, down, turned.

What draws with exact truth leave, see `plugins/align/tests/test_offset.py`.
"""
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


@dataclass
class _Equations:
    """Sums over all events beside edges.

    Attributes:
        normal: (7, 7) normal matrix of the four values and three nuisances.
        pull: (7,) gradient.
        coherent: (4, P) what a shift of 1 px of each pattern pulls at the four values.
        patches: normal matrix and gradient (7, 8) of each patch of a frame.
    """

    normal: Array
    pull: Array
    coherent: Array
    patches: list[Array]


def find_offset(setup: Setup, found: Sequence[Sample]) -> Found:
    """Finds what the clock and rotation of the frame camera lack.

    Raises:
        InputError: too few events beside edges, or a correction that runs away.
    """
    values = np.zeros(_ALL)
    for gate_px in _GATES_PX:
        sums = _equations(setup.corrected(_correction(values)), found, gate_px)
        step = -_inverse(sums.normal) @ sums.pull
        values = np.append(values[:4] + step[:4], step[4:])
        if abs(values[0]) > MARGIN_US:
            raise InputError(
                f"{setup.recording.name}: no clock within {MARGIN_US / 1000:g} ms brings frames "
                "and events together: check that both use one clock"
            )
    return Found(_correction(values), _estimates(values, sums))


def _correction(values: Array) -> Correction:
    late_us, x, y, z = (float(v) for v in values[:4])
    return Correction(late_us, (x, y, z))


def _inverse(normal: Array) -> Array:
    """The inverse, of values in units that differ by powers of ten."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale), np.float64)


def _equations(setup: Setup, found: Sequence[Sample], gate_px: float) -> _Equations:
    sums = _Equations(np.zeros((_ALL, _ALL)), np.zeros(_ALL), np.zeros((4, 4)), [])
    for sample in found:
        _add(sums, setup, sample, gate_px)
    if len(sums.patches) <= _ALL:
        raise InputError(
            f"{setup.recording.name}: too few events lie beside edges of frames to compare clocks"
        )
    return sums


def _add(sums: _Equations, setup: Setup, sample: Sample, gate_px: float) -> None:
    uv_px, moving_px, _ = places(setup, sample)
    pairs = match(sample.edges, uv_px, moving_px, sample.brighter, gate_px)
    if not len(pairs.points):
        return
    normal, slope = sample.edges.normal[pairs.edges], sample.edges.slope[pairs.edges]
    changes = [_change(setup, sample, uv_px, k)[pairs.points] for k in range(4)]
    across = np.sign((normal * moving_px[pairs.points]).sum(-1))
    columns = [(normal * change).sum(-1) for change in changes]
    J = np.stack([*columns, across, across / slope, np.ones(len(slope))], -1)
    weight = np.minimum(1.0, _HUBER_PX / np.maximum(np.abs(pairs.off_px), 1e-9))
    weight = np.where(np.isfinite(J).all(-1), weight, 0.0)
    J = np.where(np.isfinite(J), J, 0.0)
    edge_px = sample.edges.uv_px[pairs.edges]
    each = (J * weight[:, None])[:, :, None] * np.column_stack([J, pairs.off_px])[:, None, :]
    sums.normal += each[..., :_ALL].sum(0)
    sums.pull += each[..., _ALL].sum(0)
    sums.coherent += (J[:, :4] * weight[:, None]).T @ _patterns(edge_px, normal, across)
    tiles = (edge_px // _PATCH_PX).astype(np.int64)
    _, patch = np.unique(tiles[:, 1] * 10_000 + tiles[:, 0], return_inverse=True)
    parts = np.zeros((patch.max() + 1, *each.shape[1:]))
    np.add.at(parts, patch, each)
    sums.patches += list(parts)


def _patterns(edge_px: Array, normal: Array, across: Array) -> Array:
    """(M, 4) distance from edges where all are 1 px off: behind, right, down, and turned."""
    arm = edge_px - edge_px.mean(0)
    arm /= max(np.sqrt((arm**2).sum(-1).mean()), 1.0)
    turned = arm[:, 0] * normal[:, 1] - arm[:, 1] * normal[:, 0]
    return np.stack([across, normal[:, 0], normal[:, 1], turned], -1)


def _change(setup: Setup, sample: Sample, uv_px: Array, k: int) -> Array:
    """(N, 2) how the points move in the frame per unit of a value, px."""
    values = np.zeros(4)
    values[k] = _STEPS[k]
    before = setup.correction
    turned = np.array(before.turn_rad) + values[1:]
    moved = setup.corrected(Correction(before.late_us + values[0], tuple(turned.tolist())))
    there, _ = moved.frame_view(sample.number).seen(sample.points, sample.rho)
    return np.asarray((there - uv_px) / _STEPS[k], np.float64)


def _estimates(values: Array, sums: _Equations) -> tuple[Estimate, ...]:
    """Intervals of 95 %: scatter of patches, whose events are not independent; `COHERENT_PX`."""
    inverse = _inverse(sums.normal)
    nuisance = np.append(np.zeros(4), values[4:])  # fitted anew: patches have it in their gradients
    left = np.array([each[:, _ALL] + each[:, :_ALL] @ nuisance for each in sums.patches])
    scatter = np.diag(inverse @ (left.T @ left) @ inverse)[:4]
    coherent = _inverse(sums.normal[:4, :4]) @ sums.coherent * COHERENT_PX
    spread = student.ppf(0.975, len(left) - _ALL) ** 2 * scatter
    half = np.sqrt(np.maximum(spread, 0) + (coherent**2).sum(-1))
    found = []
    for k, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
        width = float(half[k] * _SCALE[k])
        known = bool(np.isfinite(width) and 0 < width <= _LOOSE[k])
        found.append(Estimate(name, unit, float(values[k] * _SCALE[k]), width, known))
    return tuple(found)
