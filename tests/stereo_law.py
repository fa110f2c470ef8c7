"""Stereo consistency: one surface seen by two cameras lies where the calibration says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from emvs.data import se3
from sim.truth import boundary


class Warped(NamedTuple):
    """Pixels of camera a that camera b sees too.

    Attributes:
        error_px: (N,) distance in camera a between a pixel and where camera b's depth puts the
            surface that it should show.
        seen: share of camera a's surface pixels that land in camera b and are not occluded.
    """

    error_px: np.ndarray
    seen: float


def warped(rig, a, b, depth_a_m, depth_b_m, mixed_px=0.25) -> Warped:
    """Lifts the pixels of camera a by their depth, finds them in camera b, and comes back.

    Left out, and nothing else: pixels at a depth boundary of either camera, so small that bilinear
    inverse depth mixes two surfaces `mixed_px` of disparity apart, and pixels in front of whose
    surface camera b sees another one, by two such steps or more.
    """
    camera_a, camera_b = rig.cameras[a], rig.cameras[b]
    T_b_a = se3.inverse(rig.T_body_cam[b]) @ rig.T_body_cam[a]
    nearest_m = min(depth_a_m.min(), depth_b_m.min())
    jump = mixed_px * float(nearest_m) / (camera_a.fx_px * rig.baseline_m(a, b))
    boundary_a, boundary_b = boundary(depth_a_m, jump), boundary(depth_b_m, jump)
    use = np.isfinite(depth_a_m) & ~boundary_a
    rows, columns = np.nonzero(use)
    pixels = np.stack([columns, rows], -1).astype(float)
    points_a = _lifted(camera_a.unproject(pixels), depth_a_m[use])
    points_b = se3.transform(T_b_a, points_a)
    found = camera_b.project(points_b)
    rho_b, clean = _sampled(1 / depth_b_m.astype(float), boundary_b, found)
    ok = clean & (rho_b > 0)
    hidden = rho_b > (1 + 2 * jump) / np.where(points_b[:, 2] > 0, points_b[:, 2], np.inf)
    ok &= ~hidden
    back_b = _lifted(camera_b.unproject(found[ok]), 1 / rho_b[ok])
    back = camera_a.project(se3.transform(se3.inverse(T_b_a), back_b))
    return Warped(np.linalg.norm(back - pixels[ok], axis=1), ok.sum() / max(1, len(pixels)))


def _lifted(bearing, depth_m):
    return np.concatenate([bearing, np.ones((len(bearing), 1))], -1) * depth_m[:, None]


def _sampled(rho, excluded, pixels):
    """Bilinear inverse depth, and whether all four pixels count."""
    height, width = rho.shape
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(-1) & (pixels < (width - 1, height - 1)).all(-1)
    u, v = np.where(inside[:, None], pixels, 0).T
    j, i = u.astype(int), v.astype(int)
    fu, fv = u - j, v - i
    value, clean = np.zeros(len(u)), inside.copy()
    for di, dj in np.ndindex(2, 2):
        value += (fv if di else 1 - fv) * (fu if dj else 1 - fu) * rho[i + di, j + dj]
        clean &= ~excluded[i + di, j + dj]
    return value, clean
