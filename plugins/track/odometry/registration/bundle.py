"""Poses of a stretch and the depths of what they see, found together: bundle adjustment.

Where batches hardly tell a turn from a shift across, a map on poses that err shows the same error,
and the poses on it err more: tracking and mapping in turns may grow what neither sees. Here depths
follow the poses. Residuals are r + J xi + d delta, xi of the poses and delta of the logarithms of
depths, seen from one reference view; the deltas are eliminated (the Schur complement of Triggs et
al., *Bundle adjustment: a modern synthesis*, 2000), and Gauss-Newton steps the poses of all batches
at once. Noise of acceleration connects poses in turn, as in `motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.batches import Batch
from eventsweep.plugins.track.odometry.motion import Motion, density
from eventsweep.plugins.track.odometry.registration.fit import Registration
from eventsweep.plugins.track.odometry.registration.gauss_newton_kernels import FARTHER, TRUST

Matrix = NDArray[np.float64]
_STEPS = 2
_DEPTH = 0.05  # standard deviation of a depth, as a share: one edge's, for they err alike
_HELD = 1e12  # information that holds a pose
_FEWEST = 3  # poses that noise of acceleration connects


@dataclass(frozen=True)
class Equations:
    """Normal equations of K poses and N logarithms of depths; zero until residuals are added.

    Attributes:
        H, g: (K, 6, 6) and (K, 6) of each pose.
        a, c: (N,) of each depth, the second of its gradient.
        b: (K, N, 6) of both.
    """

    H: Matrix
    g: Matrix
    a: Matrix
    b: Matrix
    c: Matrix

    @classmethod
    def none(cls, poses: int, depths: int) -> Equations:
        """Of no residuals."""
        K, N = poses, depths
        return cls(*(np.zeros(shape) for shape in ((K, 6, 6), (K, 6), N, (K, N, 6), N)))

    def weighed(self, weight: float, delta: Matrix, sigma: float) -> Equations:
        """The same with this weight, of depths that are `delta` (N,) from what is known of them."""
        H, g, a, b, c = (weight * part for part in (self.H, self.g, self.a, self.b, self.c))
        return Equations(H, g, a + sigma**-2, b, c + delta * sigma**-2)

    def reduced(self) -> tuple[Matrix, Matrix]:
        """The equations of the poses alone, (K, 6, K, 6) and (K, 6): any depths follow them."""
        K, by_depth = len(self.H), self.b / self.a[:, None]
        S = -np.einsum("kna,lnb->kalb", by_depth, self.b, optimize=True)
        S[np.arange(K), :, np.arange(K)] += self.H
        return S, self.g - by_depth.swapaxes(1, 2) @ self.c

    def depths(self, xi: Matrix) -> Matrix:
        """The step (N,) of the logarithms of depths that belongs to (K, 6) of the poses."""
        step: Matrix = -(self.c + np.einsum("kna,ka->n", self.b, xi)) / self.a
        return step


def adjusted(
    batches: Sequence[Batch],
    motions: Sequence[Motion],
    registration: Registration,
    middle_m: Matrix,
) -> list[Motion]:
    """Better motions at batches: the same at the middle one; too few of them stay as they are.

    Args:
        batches: in order of time.
        motions: at each of them.
        registration: with the map that they see.
        middle_m: (3,) where it was seen from, in the world.
    """
    if len(motions) < _FEWEST:
        return list(motions)
    here, rays = list(motions), registration.few - middle_m
    delta = np.zeros(len(rays))
    for _ in range(_STEPS):
        points = middle_m + np.exp(delta)[:, None] * rays
        equations = Equations.none(len(here), len(rays))
        for k, (batch, motion) in enumerate(zip(batches, here, strict=True)):
            parts = (equations.H[k], equations.g[k], equations.a, equations.b[k], equations.c)
            registration.add_depths(batch.events, motion, points, middle_m, parts)
        equations = equations.weighed(TRUST, delta, _DEPTH)
        xi = FARTHER * _step(here, *equations.reduced())
        delta += equations.depths(xi) + (FARTHER - 1) * equations.depths(np.zeros_like(xi))
        here = _moved(here, xi)
    return here


def _step(motions: Sequence[Motion], S: Matrix, s: Matrix) -> Matrix:
    """The (K, 6) step of Gauss-Newton, with the middle pose held; fills `S` and `s` up."""
    _add_noise(motions, S, s)
    middle = len(motions) // 2
    S[middle, :, middle] += _HELD * np.eye(6)
    step: Matrix = np.asarray(np.linalg.solve(S.reshape(s.size, s.size), -s.ravel()), np.float64)
    return step.reshape(s.shape)


def _add_noise(motions: Sequence[Motion], S: Matrix, s: Matrix) -> None:
    """Adds that twists, the mean ones between poses in turn, differ by white acceleration only.

    The mean over a time h of a walk and that over the next h' differ by the variance (h + h') / 3
    times its density.
    """
    twists, h = _twists(motions)
    K = len(motions)
    D, at = np.zeros((K - 2, K)), np.arange(K - 2)
    D[at, at], D[at, at + 1], D[at, at + 2] = -1 / h[:-1], 1 / h[:-1] + 1 / h[1:], -1 / h[1:]
    off, variance = np.diff(twists, axis=0), (h[:-1] + h[1:]) / 3
    for a, spread in enumerate(np.diag(density(motions[0].reach))):
        weighted = D / (spread * variance)[:, None]
        S[:, a, :, a] += weighted.T @ D
        s[:, a] += weighted.T @ off[:, a]


def _twists(motions: Sequence[Motion]) -> tuple[Matrix, Matrix]:
    """Mean twists (K - 1, 6) of the body between poses in turn, and those times (K - 1,), s."""
    h = 1e-6 * np.diff([motion.t_us for motion in motions])
    poses = np.stack([motion.T_world_body for motion in motions])
    ways = se3.inverse(poses[:-1]) @ poses[1:]
    return np.stack([se3.log(way) for way in ways]) / h[:, None], h


def _moved(motions: Sequence[Motion], xi: Matrix) -> list[Motion]:
    """Motions with poses corrected by `T_body_world' = exp(xi) T_body_world`, and their twists."""
    poses = [
        se3.nearest_rigid(motion.T_world_body @ se3.inverse(se3.exp(step)))
        for motion, step in zip(motions, xi, strict=True)
    ]
    moved = [replace(m, T_world_body=T) for m, T in zip(motions, poses, strict=True)]
    between, _ = _twists(moved)
    ends = np.concatenate([between[:1], between]), np.concatenate([between, between[-1:]])
    twists = (ends[0] + ends[1]) / 2
    return [replace(motion, twist=twist) for motion, twist in zip(moved, twists, strict=True)]
