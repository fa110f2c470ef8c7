"""The extractions that the study compares, each a depth and as many pixels as Alg1/H reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs import focus
from emvs.config import MapperConfig
from emvs.depthmap import confidence_mask, without_border
from emvs.focus_config import FocusConfig
from emvs.found import Found, at_least, most_reliable
from emvs.fusion import FUSIONS
from emvs.in_focus import find
from emvs.median import masked_median
from emvs.running import Maximum
from eval.study_cache import Sample

BASE = "Alg1/H"
OURS = "variance, agreement × support × inside"
BEFORE = "variance, agreement × support"
RIVAL_GAP_PLANES = 6
RELIABILITIES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4)

# The difference of Gaussians filters votes and gathers none: it needs the scale of an edge.
_SCALES_PX = {"variance": 2.5, "mean-square": 2.5, "gradient": 2.5, "laplacian": 2.5, "dog": 0.7}

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Estimate:
    """(H, W) plane positions, and the pixels that report them."""

    position: Floats
    mask: Mask


@dataclass(frozen=True, eq=False)
class Volumes:
    """One sample's volumes, and what all extractions share.

    Attributes:
        votes: (C, N, H, W) float32.
        fused: (N, H, W) float32 harmonic mean.
        plane_px: disparity between two planes, px.
        config: the mapper's defaults.
    """

    votes: Floats
    fused: Floats
    plane_px: float
    config: MapperConfig

    @classmethod
    def of(cls, sample: Sample) -> Volumes:
        """Fuses a sample's volumes."""
        rho = sample.view.rho
        step = abs(float(rho[-1]) - float(rho[0])) / (len(rho) - 1)
        fused = FUSIONS["H"](sample.votes)
        plane_px = step * sample.truth.baseline_focal_px_m
        return cls(sample.votes, fused, plane_px, MapperConfig())

    @cached_property
    def maximum(self) -> Maximum:
        """The plain ray maximum of the fused volume."""
        return maximum_of(self.fused)

    @cached_property
    def base(self) -> Estimate:
        """What Alg1/H reports."""
        mask = confidence_mask(self.maximum.value, self.config)
        position = masked_median(self.maximum.position(), mask, self.config.median_px)
        return Estimate(position, without_border(mask, self.config.border_px))

    @cached_property
    def focused(self) -> Floats:
        """(N, H, W) local variance of the fused planes."""
        return np.stack([focus.variance(p, FocusConfig().sigma_px) for p in self.fused])

    def found(self, config: FocusConfig) -> Found:
        """Extraction by focus."""
        return find(self.fused, self.votes, self.plane_px, config)

    def best(self, found: Found, reliability: Floats | None = None) -> Estimate:
        """The most reliable pixels, as many as Alg1/H reports."""
        if reliability is not None:
            # `reliability` is a product of both: all of it goes into one
            ones = np.ones_like(found.support)
            found = replace(found, agreement=reliability, support=ones, inside=ones)
        points = int(np.count_nonzero(self.base.mask))
        return Estimate(found.position, most_reliable(found, points, self.config.border_px))


def maximum_of(volume: Floats) -> Maximum:
    """The first maximum of a whole (N, H, W) volume along its first axis."""
    planes = len(volume)
    index = volume.argmax(0)

    def at(plane: NDArray[np.int64]) -> Floats:
        inside = np.clip(plane, 0, planes - 1)[None]
        value: Floats = np.take_along_axis(volume, inside, 0)[0]
        return value

    return Maximum(at(index), index.astype(np.int16), at(index - 1), at(index + 1), planes)


def finalists(volumes: Volumes) -> dict[str, Estimate]:
    """Alg1/H and ours, with and without its last factor."""
    ours = volumes.found(FocusConfig())
    without = volumes.best(ours, ours.agreement * ours.support)
    return {BASE: volumes.base, BEFORE: without, OURS: volumes.best(ours)}


def threshold_name(reliability: float) -> str:
    """What the estimate of every pixel with at least this reliability is called."""
    return f"reliability at least {reliability:g}"


def thresholds(volumes: Volumes) -> dict[str, Estimate]:
    """Ours as the mapper reports it: every pixel that is reliable enough."""
    found, border_px = volumes.found(FocusConfig()), volumes.config.border_px
    return {
        threshold_name(reliability): Estimate(
            found.position, at_least(found, reliability, border_px)
        )
        for reliability in RELIABILITIES
    }


def estimates(volumes: Volumes) -> dict[str, Estimate]:
    """Every extraction by its name, Alg1/H first."""
    base = volumes.base
    ours = volumes.found(FocusConfig())
    chosen = volumes.best(ours)
    out = {BASE: base, "Alg1/H without median": Estimate(volumes.maximum.position(), base.mask)}
    out |= _same_pixels(volumes)
    out |= {
        "Alg1/H's depth at our pixels": Estimate(base.position, chosen.mask),
        "votes, ours": volumes.best(volumes.found(FocusConfig(measure="votes"))),
    }
    out |= {f"variance, {name}": volumes.best(ours, r) for name, r in _ranks(volumes, ours).items()}
    out["ours, 5 px median"] = Estimate(masked_median(ours.position, chosen.mask, 5), chosen.mask)
    for sigma_px in (1.5, 3.5):
        found = volumes.found(FocusConfig(sigma_px=sigma_px))
        out[f"ours, scale {sigma_px} px"] = volumes.best(found)
    return out | {OURS: chosen}


def _same_pixels(volumes: Volumes) -> dict[str, Estimate]:
    """Each focus measure at the pixels of Alg1/H: what the depth alone gains."""
    out = {}
    for name, sigma_px in _SCALES_PX.items():
        measure = focus.measure(name)
        planes = np.stack([measure(plane, sigma_px) for plane in volumes.fused])
        position = maximum_of(planes).position()
        out[f"{name} {sigma_px:g} px at Alg1/H's pixels"] = Estimate(position, volumes.base.mask)
    return out


def _ranks(volumes: Volumes, ours: Found) -> dict[str, Floats]:
    """Reliabilities that pick the pixels, with the depth of the local variance."""
    peak = maximum_of(volumes.focused)
    all_three = ours.agreement * ours.support * ours.inside
    rival, spread = _rival_ratio(volumes.focused, peak), _z_score(volumes.focused, peak)
    around = cv2.dilate(ours.confidence, np.ones((3, 3), np.uint8))
    crest = ours.confidence / np.maximum(around, np.float32(1e-6))
    return {
        "strongest votes": ours.confidence,
        "agreement": ours.agreement,
        "support": ours.support,
        "second-peak ratio": rival,
        "z-score along the ray": spread,
        "agreement × support": ours.agreement * ours.support,
        "agreement × inside": ours.agreement * ours.inside,
        "support × inside": ours.support * ours.inside,
        "ours × second-peak ratio": rival * all_three,
        "ours × z-score": spread * all_three,
        "ours × share of the strongest neighbour": crest * all_three,
    }


def _rival_ratio(volume: Floats, peak: Maximum) -> Floats:
    """Logarithm of the peak over the largest value more than six planes away from it."""
    apart = np.abs(np.arange(len(volume))[:, None, None] - peak.plane) > RIVAL_GAP_PLANES
    rival = np.where(apart, volume, 0).max(0)
    ratio: Floats = np.log(np.maximum(peak.value / np.maximum(rival, 1e-6), 1)).astype(np.float32)
    return ratio


def _z_score(volume: Floats, peak: Maximum) -> Floats:
    score: Floats = (peak.value - volume.mean(0)) / np.maximum(volume.std(0), 1e-6)
    return score.astype(np.float32)
