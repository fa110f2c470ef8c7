"""Ground truth of two cameras against each other: surfaces of one found in the other's depth."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.ground_truth import boundary


class Warped(NamedTuple):
    """Pixels of camera a that camera b sees too.

    Attributes:
        error_px: (N,) distance in camera a between a pixel and where camera b's depth puts the
            surface that it should show.
        seen: share of camera a's surface pixels that land in camera b and are not occluded.
    """

    error_px: NDArray[np.float64]
    seen: float

    @property
    def within(self) -> float:
        """Share of the pixels with an error of less than half a pixel."""
        return float(np.mean(self.error_px < 0.5))


def warped(
    rig: Rig,
    a: int,
    b: int,
    depth_a_m: NDArray[np.float32],
    depth_b_m: NDArray[np.float32],
    mixed_px: float = 0.25,
) -> Warped:
    """Lifts the pixels of camera a by their depth, finds them in camera b, and comes back.

    Left out, and nothing else: pixels at a depth boundary of either camera, so small that bilinear
    inverse depth mixes two surfaces `mixed_px` of disparity apart; folds of camera b's surfaces so
    sharp that it misses them by as much; and pixels in front of whose surface camera b sees another
    one, by two such steps or more.

    Args:
        rig: the cameras, with their lenses.
        a: index of the camera whose pixels are followed.
        b: index of the other.
        depth_a_m: (H, W) z-depth of camera a, m; inf where nothing is seen.
        depth_b_m: (H, W) z-depth of camera b at the same time, m.
        mixed_px: what counts as a boundary, as disparity of the nearest surface, px.
    """
    camera_a, camera_b = rig.cameras[a], rig.cameras[b]
    T_b_a = se3.inverse(rig.T_body_cam[b]) @ rig.T_body_cam[a]
    nearest_m = min(depth_a_m.min(), depth_b_m.min())
    jump = mixed_px * float(nearest_m) / (camera_a.fx_px * rig.baseline_m(a, b))
    excluded_b = boundary(depth_b_m, jump) | _sharp_fold(depth_b_m, jump)
    use = np.isfinite(depth_a_m) & ~boundary(depth_a_m, jump)
    rows, columns = np.nonzero(use)
    pixels = np.stack([columns, rows], -1).astype(float)
    points_a = _lifted(camera_a.unproject(pixels), depth_a_m[use])
    points_b = se3.transform(T_b_a, points_a)
    uv_b_px = camera_b.project(points_b)
    rho_b, clean = _sampled(1 / depth_b_m.astype(float), excluded_b, uv_b_px)
    ok = clean & (rho_b > 0)
    hidden = rho_b > (1 + 2 * jump) / np.where(points_b[:, 2] > 0, points_b[:, 2], np.inf)
    ok &= ~hidden
    back_b = _lifted(camera_b.unproject(uv_b_px[ok]), 1 / rho_b[ok])
    back = camera_a.project(se3.transform(se3.inverse(T_b_a), back_b))
    return Warped(np.linalg.norm(back - pixels[ok], axis=1), ok.sum() / max(1, len(pixels)))


def _sharp_fold(depth_m: NDArray[np.float32], jump: float) -> NDArray[np.bool_]:
    """Where inverse depth bends so much that a chord misses it by a quarter: 4 `jump`s of bend."""
    rho = 1 / depth_m.astype(float)
    bend = np.zeros(rho.shape)
    bend[:, 1:-1] = np.abs(rho[:, 2:] - 2 * rho[:, 1:-1] + rho[:, :-2])
    across = np.abs(rho[2:] - 2 * rho[1:-1] + rho[:-2])
    bend[1:-1] = np.maximum(bend[1:-1], across)
    sharp: NDArray[np.bool_] = bend > 4 * jump * rho
    return sharp


def _lifted(bearing: NDArray[np.float64], depth_m: NDArray[Any]) -> NDArray[np.float64]:
    rays = np.concatenate([bearing, np.ones((len(bearing), 1))], -1)
    return np.asarray(rays * depth_m[:, None], np.float64)


def _sampled(
    rho: NDArray[np.float64], excluded: NDArray[np.bool_], pixels: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Bilinear inverse depth, and whether all four pixels count."""
    height, width = rho.shape
    with np.errstate(invalid="ignore"):
        within = (pixels >= 0) & (pixels < (width - 1, height - 1))
    inside: NDArray[np.bool_] = within[:, 0] & within[:, 1]
    u, v = np.where(inside[:, None], pixels, 0).T
    j, i = u.astype(int), v.astype(int)
    fu, fv = u - j, v - i
    value = np.zeros(len(u))
    clean = inside.copy()
    for di, dj in np.ndindex(2, 2):
        value += (fv if di else 1 - fv) * (fu if dj else 1 - fu) * rho[i + di, j + dj]
        clean &= ~excluded[i + di, j + dj]
    return value, clean
