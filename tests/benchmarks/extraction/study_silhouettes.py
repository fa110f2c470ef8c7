"""Where errors lie: `python tests/benchmarks study_silhouettes --planes 250`.

The table of `docs/extraction.md` on tumvie-6dof at 1280x720; needs 8 GB of memory.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import confidence_mask, masked_median, without_border
from eventsweep.emvs.depth.focus import FocusConfig
from eventsweep.emvs.reference_view import inverse_depth_at
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.pairing import pair
from study_cache import StudySample, load_sample
from study_variants import VariantEstimate, Volumes, maximum_of, most_reliable

SILHOUETTE_PX = 2.0  # of disparity, within a square of 5 px
_C = np.arange(5, 13, 0.5)  # thresholds tried until Alg1/H has no more points than camera 0

Mask = NDArray[np.bool_]


def plain(volume: NDArray[np.float32], config: MapperConfig) -> VariantEstimate:
    """What Alg. 1 reports of one volume."""
    maximum = maximum_of(volume)
    mask = confidence_mask(maximum.value, config)
    position = masked_median(maximum.position(), mask, config.median_px)
    return VariantEstimate(position, without_border(mask, config.border_px))


def silhouettes(sample: StudySample) -> Mask:
    """Pixels within 2 px of a depth edge."""
    truth = sample.truth
    depth_m = np.where(truth.scored, truth.depth_m, np.inf)
    disparity_px = (truth.baseline_focal_px_m / depth_m).astype(np.float32)
    square = np.ones((5, 5), np.uint8)
    spread = cv2.dilate(disparity_px, square) - cv2.erode(disparity_px, square)
    return np.asarray(spread > SILHOUETTE_PX, np.bool_)


def line(name: str, sample: StudySample, estimate: VariantEstimate, edges: Mask) -> str:
    """One row: points, errors, and how they divide at silhouettes."""
    depth_m = np.reciprocal(inverse_depth_at(sample.view.rho, estimate.position))
    pairs = pair(depth_m, estimate.mask, sample.truth)
    value = {key: ALL_METRICS[key](pairs) for key in ("points", "median_error", "mean_error")}
    scored = estimate.mask & sample.truth.scored
    off_mm = 1e3 * abs(depth_m - sample.truth.depth_m)
    return (
        f"{name}: {value['points']:.0f} points, median {1e3 * value['median_error']:.1f} mm, mean "
        f"{1e3 * value['mean_error']:.0f} mm, bad {ALL_METRICS['bad_published'](pairs):.1f} %; "
        f"at silhouettes {edges[scored].mean():.2f} of them, mean "
        f"{off_mm[scored & edges].mean():.0f} mm, elsewhere {off_mm[scored & ~edges].mean():.0f} mm"
    )


def main(arguments: list[str] | None = None) -> None:
    """Prints one line for each method."""
    parser = argparse.ArgumentParser(description="Divide errors into silhouettes and the rest.")
    parser.add_argument("--case", default="tumvie-6dof")
    parser.add_argument("--rig", default="tumvie-kb4")
    parser.add_argument("--planes", type=int, default=100)
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    chosen = parser.parse_args(arguments)
    config = MapperConfig(planes=chosen.planes)
    sample = load_sample(chosen.case, 0, chosen.cache, config, rig=chosen.rig, seconds=0.5)
    volumes, edges = Volumes.of(sample), silhouettes(sample)
    single = plain(sample.votes[0], config)
    points = int(np.count_nonzero(single.mask))
    rows = {"EMVS/cam0": single, "Alg1/H": volumes.base}
    for c in _C:
        fewer = plain(volumes.fused, config.model_copy(update={"threshold_c": float(c)}))
        if np.count_nonzero(fewer.mask) <= points:
            rows[f"Alg1/H, C = {c:g}"] = fewer
            break
    found = volumes.found(FocusConfig())
    rows["ours, as many as EMVS/cam0"] = VariantEstimate(
        found.position, most_reliable(found, points, config.border_px)
    )
    rows["ours, as many as Alg1/H"] = volumes.best(found)
    for name, estimate in rows.items():
        sys.stdout.write(line(name, sample, estimate, edges) + "\n")


if __name__ == "__main__":
    main()
