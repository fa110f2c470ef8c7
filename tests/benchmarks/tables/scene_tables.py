"""Writes the table of figures of the scenes' page: every number is measured, none is typed.

python tests/benchmarks scene_tables docs/scenes.md

Each case is simulated for a short piece with its own rig at full resolution, and the true depth of
its cameras is warped onto each other. About one minute a case at 1280x720 on two cores, ten
seconds for smaller ones. `--only CASE...` prints rows of some cases and writes nothing.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig
from eventsweep.sim.simulate import simulate
from markdown_blocks import into_page
from table_code import Code, of_scenes
from warped_depth import warped

CASES = (
    "desk", "boxes", "planes",
    "tumvie-6dof", "tumvie-desk2", "tumvie-1d", "tumvie-3d", "mvsec-flying", "rpg-boxes",
    "rpg-reader", "rpg-monitor", "rpg-bin", "hdr-window", "hdr-night", "trinocular-desk",
    "tumvie-skate", "tumvie-run", "tumvie-bike", "dsec-street",
    "moving-objects", "low-texture", "repetitive", "thin-structures", "reflective",
)  # fmt: skip
"""In the order of the page."""

HEAD = (
    "| Case | Rig | Pixels | Baseline, cm | Depth seen, m | Moving by itself | Mev/s "
    "| Events/s per pixel | Frames/s | Stereo, largest error, px |\n"
    "|---|---|---|---|---|---|---|---|---|---|\n"
)


class Figures(NamedTuple):
    """What was measured of one case.

    Attributes:
        name: of the case.
        rig: its own.
        seconds: simulated, s.
        depth_m: 5th and 95th percentile of the true depth of all cameras and stored times, m.
        moving: share of the pixels that show bodies which move by themselves.
        events: of all cameras.
        frames: times at which all cameras were rendered.
        stereo_px: largest error of the stereo law at the stored times, both ways, px.
    """

    name: str
    rig: Rig
    seconds: float
    depth_m: tuple[float, float]
    moving: float
    events: int
    frames: int
    stereo_px: float

    @property
    def row(self) -> str:
        """A line of the table; rates are per second."""
        cameras = self.rig.cameras
        rate = self.events / self.seconds / len(cameras)
        pixels = cameras[0].width_px * cameras[0].height_px
        size = f"{cameras[0].width_px}×{cameras[0].height_px}"
        others = (100 * self.rig.baseline_m(0, k) for k in range(1, len(cameras)))
        columns = (
            f"`{self.name}`",
            f"`{self.rig.name}`",
            size if len(cameras) == 2 else f"{len(cameras)} × {size}",
            ", ".join(f"{cm:.2f}" for cm in others),
            "–".join(f"{d:.3g}" for d in self.depth_m),
            f"{100 * self.moving:.1f} %" if self.moving else "none",
            f"{rate / 1e6:.2f}",
            f"{rate / pixels:.1f}",
            f"{(self.frames - 1) / self.seconds:.0f}",
            f"{self.stereo_px:.2f}",
        )
        return f"| {' | '.join(columns)} |\n"


def measure(name: str, seconds: float) -> Figures:
    """Simulates a short piece of a case, seed 0, with an ideal sensor's default thresholds."""
    scene = scenes.load(name)
    seen, times_us = rig(scene.rig), list[int]()
    config = SimConfig(duration_s=seconds, truth=("segmentation",))
    with tempfile.TemporaryDirectory() as folder:
        out = simulate(
            scene, seen, config, 0, Path(folder) / "s",
            progress=lambda _stage, t_us, _total_us: times_us.append(t_us),
        )  # fmt: skip
        sequence = Sequence.open(out)
        stored = [(k, int(t)) for k in range(len(seen)) for t in sequence.truth_times_us(k)]
        depth_m = np.concatenate([sequence.truth_depth_m(*at).ravel() for at in stored])
        low_m, high_m = np.percentile(depth_m[np.isfinite(depth_m)], (5, 95))
        moving = float(np.mean([sequence.truth_dynamic(*at).mean() for at in stored]))
        events = sum(sequence.event_count(k) for k in range(len(seen)))
        stereo_px = _largest_error_px(sequence)
    return Figures(name, seen, seconds, (low_m, high_m), moving, events, len(times_us), stereo_px)


def _largest_error_px(sequence: Sequence) -> float:
    """Of the stereo law, over all stored times and ordered pairs of cameras."""
    errors = []
    for t_us in sequence.truth_times_us(0).tolist():
        depths: list[NDArray[np.float32]] = [
            sequence.truth_depth_m(k, t_us) for k in range(len(sequence.rig))
        ]
        for a, b in permutations(range(len(depths)), 2):
            errors.append(warped(sequence.rig, a, b, depths[a], depths[b]).error_px.max())
    return float(max(errors))


def rows(names: tuple[str, ...], seconds: float) -> str:
    """The table's lines for some cases; tells on the standard error stream how it goes."""
    lines = []
    for k, name in enumerate(names):
        began_s = time.monotonic()
        lines.append(measure(name, seconds).row)
        taken_s = time.monotonic() - began_s
        print(f"{k + 1}/{len(names)} {name}: {taken_s:.0f} s", file=sys.stderr, flush=True)  # noqa: T201
    return "".join(lines)


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    written = Code(("scene_tables:rows", "scene_tables:HEAD"))
    return {"docs/scenes.md#figures": written + of_scenes(CASES)}


def main() -> None:
    """Measures what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", nargs="?", type=Path, help="docs/scenes.md")
    parser.add_argument("--only", nargs="+", default=(), choices=scenes.names())
    parser.add_argument("--seconds", type=float, default=0.05, help="length of each piece")
    asked = parser.parse_args()
    if asked.only:
        print(HEAD + rows(tuple(asked.only), asked.seconds), end="")  # noqa: T201
    if asked.page:
        into_page(asked.page, "figures", HEAD + rows(CASES, asked.seconds), code)


if __name__ == "__main__":
    main()
