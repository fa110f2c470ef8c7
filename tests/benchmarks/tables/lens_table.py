"""What the lenses of the rigs cost: `python tests/benchmarks lens_table --page docs/lenses.md`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.lens import lens_of, widened
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.sampling import border_px, with_sampling
from markdown_blocks import show

LENSES = ("mvsec", "dsec", "tumvie-kb4")


def table() -> str:
    """A row per rig with lenses, of its first camera, as fine frames draw it by default."""
    lines = [
        "First cameras, default `sampling`. Written by `python tests/benchmarks lens_table`.",
        "",
        "| Rig | Sensor with border | Samples per pixel | Drawn, of a pinhole's | Sub-views |",
        "|---|---|--:|--:|---|",
    ]
    for name in LENSES:
        config = with_sampling(SimConfig(), RIGS[name])
        border, n = border_px(config) or 0, config.supersample or 1
        camera, lens = widened(RIGS[name], border).cameras[0], lens_of(RIGS[name], 0, n, border)
        assert lens is not None
        share = lens.samples / (n * n * camera.width_px * camera.height_px)
        turned = lens.ratio_range != (1.0, 1.0)
        views = f"{len(lens.views)}, {'turned' if turned else 'straight'}"
        size = f"{camera.width_px}×{camera.height_px}"
        lines.append(f"| `{name}` | {size} | {n} × {n} | {share:.2f} times | {views} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table, or writes it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--page", type=Path)
    show(table(), parser.parse_args(arguments).page, "lenses")


if __name__ == "__main__":
    main()
