"""A picture by MuJoCo's renderer and by `raster`, in turn: `python tests/benchmarks bench_raster`.

    python tests/benchmarks bench_raster desk mvsec-flying --page plugins/raster/raster.md
    python tests/benchmarks bench_raster desk --pictures out/raster

Times are those of the processor, threads of the graphics library included, the least of several.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.plugins.raster.drawing import RasterDrawing
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.drawing import MUJOCO
from eventsweep.sim.rigs import rig
from eventsweep.sim.sampling import border_px, with_sampling
from markdown_blocks import show
from table_code import Code, of_scenes

TIMES, AT_S = 7, 0.1
CASES = "desk", "mvsec-flying", "tumvie-6dof"


class Row(NamedTuple):
    """One scene's frames.

    Attributes:
        case: its name.
        samples: per pixel and axis.
        mujoco_ms: processor time of a frame.
        raster_ms: the same.
        finer_ms: with 8 samples per pixel and axis.
        light: two pictures (H, W).
    """

    case: str
    samples: int
    mujoco_ms: float
    raster_ms: float
    finer_ms: float
    light: tuple[NDArray[np.float32], ...]


def timed(case: str) -> Row:
    """Draws the first camera's frame by turns."""
    scene = scenes.load(case)
    its = rig(scene.rig)
    config = with_sampling(SimConfig(), its, MUJOCO.why_plain(scene), floats=scene.hdr)
    settings: dict[str, Any] = {"floats": scene.hdr, "border_px": border_px(config)}
    number = config.supersample or 1
    T_world_body = scene.motion(scene.duration_s, 0).T_world_body(AT_S)
    ours = RasterDrawing()
    with ExitStack() as stack:
        drawn = [
            stack.enter_context(drawing.open(scene, its, samples, **settings))
            for drawing, samples in ((MUJOCO, number), (ours, number), (ours, 8))
        ]
        for renderer in drawn:
            renderer.at(AT_S)
            renderer.near_first(T_world_body)
        light = tuple(renderer.frame(0, T_world_body).intensity for renderer in drawn)
        ms = np.array([[_ms(each, T_world_body) for each in drawn] for _ in range(TIMES)]).min(0)
    return Row(case, number, *ms.tolist(), light[:2])


def _ms(renderer: Any, T_world_body: NDArray[np.float64]) -> float:
    start_s = time.process_time()
    renderer.frame(0, T_world_body)
    return 1e3 * (time.process_time() - start_s)


def table(rows: list[Row]) -> str:
    """What the page shows."""
    head = [
        "Processor time of a fine frame of one camera, ms "
        f"({platform.machine()}, {os.cpu_count()} cores):",
        "",
        "| | samples | MuJoCo, software OpenGL | `raster` | `raster`, 8 × 8 |",
        "|---|--:|--:|--:|--:|",
    ]
    lines = [
        f"| `{row.case}` | {row.samples} × {row.samples} | {row.mujoco_ms:.0f} | "
        f"{row.raster_ms:.0f} | {row.finer_ms:.0f} |"
        for row in rows
    ]
    return "\n".join(head + lines)


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    its = Code(("bench_raster:timed", "bench_raster:table"))
    return {"plugins/raster/raster.md#raster": its + of_scenes(CASES)}


def save(row: Row, folder: Path) -> None:
    """Writes both pictures and sixteen times their difference, side by side."""
    import cv2

    brightest = max(1.0, float(np.percentile(row.light[0], 99)))
    both = [np.clip(light / brightest, 0, 1) for light in row.light]
    apart = np.clip(16 * np.abs(row.light[1] - row.light[0]) / brightest, 0, 1)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{row.case}.png"
    cv2.imwrite(str(path), np.rint(255 * np.hstack([*both, apart])).astype(np.uint8))


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--page", type=Path)
    parser.add_argument("--pictures", type=Path, help="folder for pictures of both renderers")
    wanted = parser.parse_args()
    os.environ.setdefault("LP_NUM_THREADS", "1")
    rows = [timed(case) for case in wanted.cases]
    for row in rows if wanted.pictures else ():
        save(row, wanted.pictures)
    show(table(rows) + "\n", wanted.page, "raster", code)


if __name__ == "__main__":
    main()
