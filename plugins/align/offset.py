"""Clock, rotation and principal point of a frame camera that bring its edges and events together.

A coarse search for the shift, then Gauss-Newton over the events' distances from edges, until its
steps are small beside the intervals. These come from leaving out parts: what lies in one tile of
the frame, over all frames, depends on each other, and so does all of one kind, edges of one
direction with events of one polarity. What a photoreceptor's delay would change is added to them:
with one direction of time, it is the same as a clock's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.align.edges import match
from eventsweep.plugins.align.equations import ALL, VALUES, Rows, rows, sums
from eventsweep.plugins.align.residual import Sample, places
from eventsweep.plugins.align.rig import Correction, Setup
from eventsweep.plugins.align.views import Array

MARGIN_US = 20_000
"""No clock is found to be later or earlier than this."""
_MOST_EVENTS, _MOST_SEARCHED = 8_000, 3_000  # of a frame
_SEARCH_PX, _SEARCHED_PX = 1.5, 4.5
_REACH_PX = _SEARCHED_PX + _SEARCH_PX
"""Edges that would move further were never searched for: others were taken for them."""
_COARSE = ((3.0, 4), (2.0, 4), (2.0, 3), (2.0, 3), *[(2.0, 1)] * 4)
"""How far from an edge, px, and the first of the values besides the clock that is fitted."""
_GATE_PX, _MOST_STEPS = 1.5, 30
_SETTLED = 0.05
"""Of an interval's half-width: the estimate is done when no value would move by more."""
WIDTHS = 2.5
"""Half-width of an interval in standard deviations of `covariance`.

The 95 % quantile of errors, the clock's left out, of the 60 draws for development, 2.4, rounded up
to a half: `python tests/benchmarks align_draws --half development` prints it.
"""
DELAY_US = 1e6 / (2 * np.pi * 300)
"""A photoreceptor's delay at the frames' full scale that intervals allow for, µs.

A cut-off of 300 Hz is that of v2e's DAVIS346 in full light, as of the simulator's.
"""
_FEWEST_TILES, _MANY = 4, 100  # the latter events, of which a search finds none by chance
_NAMES = (
    "clock", "rotation about x", "rotation about y", "rotation about z",
    "principal point right", "principal point down", "edges right", "edges down",
)  # fmt: skip
_UNITS = ("ms", "deg", "deg", "deg", "px", "px", "px", "px")
_SCALE = np.array([1e-3, *[180 / np.pi] * 3, *[1.0] * 4])
_LOOSEST_MS, _LOOSEST_DEG, _LOOSEST_PX = 10.0, 2.0, 2.0
"""Half-widths beyond which the data do not determine a value."""
_APART_DEG = 0.5
"""Least turn: a principal point known less well cannot be distinguished from a rotation."""


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
    """The correction, and each of its values with an interval.

    Attributes:
        correction: what to apply.
        estimates: the six values; then how far they move the frame's edges in the mean.
        mean_move_px: (2, 6) that mean per unit of each value: µs, rad, px.
        note: what the data cannot distinguish, that steps did not settle, or that the estimate is
            wrong; empty if none of them.
    """

    correction: Correction
    estimates: tuple[Estimate, ...]
    mean_move_px: Array
    note: str = ""

    @property
    def useful(self) -> bool:
        """Whether anything is determined."""
        return any(each.known for each in self.estimates)


def find_offset(setup: Setup, found: Sequence[Sample]) -> Found:
    """Finds what the clock, rotation and principal point of the frame camera lack.

    Raises:
        InputError: too few events beside edges, or a correction that runs away.
    """
    few, most = (
        [_thinned(sample, count) for sample in found] for count in (_MOST_SEARCHED, _MOST_EVENTS)
    )
    values = np.zeros(ALL)
    values[4:VALUES] = _searched_px(setup, few)
    for gate_px, first in _COARSE:
        values = _stepped(setup, values, _enough(setup, values, few, gate_px), first)
    return _settled(setup, values, most)


def _settled(setup: Setup, values: Array, found: Sequence[Sample]) -> Found:
    """Steps until the next one would be small beside the intervals."""
    for _ in range(_MOST_STEPS):
        near = _enough(setup, values, found, _GATE_PX)
        stepped = _stepped(setup, values, near, 1)
        values[VALUES:] = stepped[VALUES:]
        spread = np.diag(covariance(near, values))[:VALUES]
        moves = np.abs(stepped - values)[:VALUES] / (WIDTHS * np.sqrt(np.maximum(spread, 1e-30)))
        if moves.max() <= _SETTLED:
            return _found(setup, values, near)
        values = stepped
    return _found(setup, values, near, _UNSETTLED.format(_MOST_STEPS, moves.max()))


def _thinned(sample: Sample, most: int) -> Sample:
    some = slice(None, None, -(-len(sample.rho) // most))
    points, rho, brighter = sample.points[some], sample.rho[some], sample.brighter[some]
    return sample._replace(points=points, rho=rho, brighter=brighter)


def _searched_px(setup: Setup, found: Sequence[Sample]) -> Array:
    """The shift, on a grid, that brings most events near edges."""
    steps = np.arange(-_SEARCHED_PX, _SEARCHED_PX + 0.1, _SEARCH_PX)
    shifts = np.array([(right, down) for down in steps for right in steps])
    score = np.zeros(len(shifts))
    for sample in found:
        uv_px, moving_px, _ = places(setup, sample)
        for k, shift in enumerate(shifts):
            pairs = match(sample.edges, uv_px + shift, moving_px, sample.brighter, _SEARCH_PX)
            score[k] += (1 - (pairs.off_px / _SEARCH_PX) ** 2).sum()
    return np.asarray(shifts[score.argmax()], np.float64)


def _enough(setup: Setup, values: Array, found: Sequence[Sample], gate_px: float) -> Rows:
    near = rows(setup, values, found, gate_px)
    if near is None or len(np.unique(near.tile)) < _FEWEST_TILES:
        raise InputError(
            f"{setup.recording.name}: too few events lie beside edges of frames to compare clocks"
        )
    return near


def _stepped(setup: Setup, values: Array, near: Rows, first: int) -> Array:
    """A step of Gauss-Newton; of the values between the clock and `first` none changes."""
    normal, side = (each[0] for each in sums(near, np.zeros(len(near.off_px), np.int64)))
    free = np.r_[0, first:ALL]
    step = np.zeros(ALL)
    step[free] = -_inverse(normal[np.ix_(free, free)]) @ side[free]
    stepped = np.append(values[:VALUES] + step[:VALUES], step[VALUES:])
    if abs(stepped[0]) > MARGIN_US:
        used = int((near.weight > 0).sum())
        cure = "check that both use one clock" if used >= _MANY else "take frames with more edges"
        raise InputError(
            f"{setup.recording.name}: no clock within {MARGIN_US / 1000:g} ms brings the "
            f"{used:,} events that lie beside edges of frames to these: {cure}"
        )
    return stepped


def _inverse(normal: Array) -> Array:
    """The inverse, of values in units that differ by powers of ten."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, 0, -2, -1), 1e-30))
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.pinv(normal / both, rcond=1e-12, hermitian=True) / both, np.float64)


def covariance(near: Rows, values: Array) -> Array:
    """(9, 9) from leaving out tiles, one after the other, and from leaving out kinds."""
    fitted = near._replace(off_px=near.off_px + near.J[:, VALUES:] @ values[VALUES:])
    return _left_out(*sums(fitted, near.tile)) + _left_out(*sums(fitted, near.kind))


def _left_out(normal: Array, side: Array) -> Array:
    """The jackknife's covariance (Wu, Annals of Statistics 1986), of parts of unequal weight."""
    whole = _inverse(normal.sum(0)) @ side.sum(0)
    without = np.einsum("gij,gj->gi", _inverse(normal.sum(0) - normal), side.sum(0) - side)
    off = without - whole
    return np.asarray((len(off) - 1) / len(off) * off.T @ off, np.float64)


def slower(near: Rows) -> Array:
    """(9,) what the values would be more by if photoreceptors were slower by 1 µs at full light."""
    every = np.zeros(len(near.off_px), np.int64)
    normal, side = (each[0] for each in sums(near._replace(off_px=near.late_px), every))
    return np.asarray(_inverse(normal) @ side, np.float64)


def _found(setup: Setup, values: Array, near: Rows, note: str = "") -> Found:
    move_px = near.mean_move_px
    move_px[:, 0] = 0.0  # of a clock, frames move differently at every time
    all_of = np.vstack([np.eye(ALL)[:VALUES], move_px])
    spread = all_of @ covariance(near, values) @ all_of.T
    random = WIDTHS * np.sqrt(np.maximum(np.diag(spread), 0))
    half = np.hypot(random, DELAY_US * (all_of @ slower(near))) * _SCALE
    value = all_of @ values * _SCALE
    known = np.isfinite(half) & (random > 0) & (half <= _loosest(setup))
    far_px = float(np.abs(value[VALUES:]).max())
    if far_px > _REACH_PX:
        known[:], note = False, _FAR.format(far_px, _REACH_PX)
    elif not (known[4] and known[5]):
        note = f"{_NOT_APART}; {note}" if note else _NOT_APART
        known[[1, 2, 4, 5]] = False
        values = _turned_instead(values, near)
    names = zip(_NAMES, _UNITS, value.tolist(), half.tolist(), known.tolist(), strict=True)
    late_us, x, y, z, right_px, down_px = map(float, values[:VALUES])
    correction = Correction(late_us, (x, y, z), (right_px, down_px))
    return Found(correction, tuple(Estimate(*each) for each in names), move_px[:, :VALUES], note)


_UNSETTLED = (
    "the estimate did not settle: step {} still moved it by {:.0%} of an interval's half-width"
)
_FAR = (
    "the estimate would move edges by {:.1f} px, further than the {:g} px within which they were "
    "searched for: other edges were taken for them, and nothing is determined"
)
_NOT_APART = (
    "a rotation about x or y and another principal point move these edges alike: only how far both "
    "move them together is determined, and a rotation alone would correct it"
)


def _loosest(setup: Setup) -> Array:
    assert setup.frames is not None
    apart_px = np.radians(_APART_DEG) * setup.frames.camera.fx_px
    rotations, principal = [_LOOSEST_DEG] * 3, [apart_px] * 2
    return np.array([_LOOSEST_MS, *rotations, *principal, *[_LOOSEST_PX] * 2])


def _turned_instead(values: Array, near: Rows) -> Array:
    """The same without another principal point: what it moves, a rotation about x and y moves."""
    normal = sums(near, np.zeros(len(near.off_px), np.int64))[0][0]
    turn, shift = [1, 2], [4, 5]
    instead = values.copy()
    instead[turn] += _inverse(normal[np.ix_(turn, turn)]) @ normal[np.ix_(turn, shift)] @ (
        values[shift]
    )  # fmt: skip
    instead[shift] = 0.0
    return instead
