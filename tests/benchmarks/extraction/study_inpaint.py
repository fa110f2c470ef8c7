"""The picture and numbers of in-painting: `python tests/benchmarks study_inpaint PICTURE`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.focus import FocusConfig, at_least
from eventsweep.emvs.depth.inpainting import MAX_RATIO, fill
from eventsweep.emvs.reference_view import inverse_depth_at
from study_cache import StudySample, load_sample
from study_variants import Volumes

Floats = NDArray[np.float32]


def fillings(depth_m: Floats, mask: NDArray[np.bool_]) -> dict[str, Floats]:
    """Depth filled by triangles, with and without steps, and by OpenCV's two in-paintings."""
    rho = np.where(mask, 1 / depth_m, 0).astype(np.float32)
    low, high = float(rho[mask].min()), float(rho[mask].max())
    grey = np.clip(255 * (rho - low) / (high - low), 0, 255).astype(np.uint8)
    gaps = (~mask).astype(np.uint8)
    out = {
        "triangles, steps kept": fill(depth_m, mask, MAX_RATIO)[0],
        "triangles, no steps": fill(depth_m, mask, np.inf)[0],
    }
    for name, kind in (("Telea", cv2.INPAINT_TELEA), ("Navier-Stokes", cv2.INPAINT_NS)):
        shades = np.asarray(cv2.inpaint(grey, gaps, 3, kind), np.float32)
        out[name] = np.reciprocal(shades / 255 * (high - low) + low)
    return out


def draw(sparse_m: Floats, dense_m: Floats, true_m: Floats, path: Path) -> None:
    """Writes a PNG: points, filled depth, true depth."""
    near, far = np.nanpercentile(true_m, [0.5, 99.5])
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.6), layout="constrained", dpi=80)
    titles = ("Focus/H: points", "gaps filled in", "true depth")
    for panel, image, title in zip(axes, (sparse_m, dense_m, true_m), titles, strict=True):
        shown = panel.imshow(image, cmap="turbo_r", vmin=near, vmax=far, interpolation="nearest")
        panel.set(title=title, xticks=[], yticks=[], facecolor="#d8d8d8")
    figure.colorbar(shown, ax=axes, label="depth, m", shrink=0.9)
    figure.savefig(path)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Prints the errors of the filled pixels, and draws the first case."""
    parser = argparse.ArgumentParser(description="Compare ways to fill the gaps between points.")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--cases", nargs="+", default=["desk", "boxes"])
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    chosen = parser.parse_args(arguments)
    for k, case in enumerate(chosen.cases):
        config = MapperConfig()
        sample = load_sample(case, 0, chosen.cache, config, rig="davis346", seconds=0.5)
        depth_m, mask = _points(sample, config)
        sys.stdout.write(f"{case}\n")
        _, filled = fill(depth_m, mask)
        counted = filled & sample.truth.scored
        for name, dense_m in fillings(depth_m, mask).items():
            off = abs(dense_m - sample.truth.depth_m)[counted] / sample.truth.depth_m[counted]
            sys.stdout.write(f"  {name}: median {np.median(off):.1%}, mean {off.mean():.1%}\n")
        if k == 0:
            dense_m = np.where(mask | filled, fill(depth_m, mask)[0], np.float32(np.nan))
            sparse_m = np.where(mask, depth_m, np.float32(np.nan))
            draw(sparse_m, dense_m, np.asarray(sample.truth.depth_m, np.float32), chosen.picture)


def _points(sample: StudySample, config: MapperConfig) -> tuple[Floats, NDArray[np.bool_]]:
    found = Volumes.of(sample).found(FocusConfig())
    depth_m = np.reciprocal(inverse_depth_at(sample.view.rho, found.position))
    return depth_m, at_least(found, config.focus.reliability, config.border_px)


if __name__ == "__main__":
    main()
