"""Draws a contact sheet of scenes: a frame and the true depth of each.

python docs/figures/scene_sheet.py docs/images/twins.png [NAME...]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig

INDOOR = (
    "tumvie-6dof", "tumvie-desk2", "tumvie-1d", "tumvie-3d", "mvsec-flying", "hdr-window",
    "rpg-boxes", "rpg-reader", "rpg-monitor", "rpg-bin", "hdr-night", "trinocular-desk",
)  # fmt: skip

_TILE = (224, 148)
"""Width and height of one picture, px; narrower ones leave a gap."""


def draw(names: tuple[str, ...], columns: int = 3) -> Any:
    """Returns a Pillow image: frame and depth of every scene in the middle of its motion."""
    from PIL import Image, ImageDraw

    width, height = 2 * _TILE[0] + 8, _TILE[1] + 20
    rows = -(-len(names) // columns)
    sheet = Image.new("RGB", (columns * width, rows * height), "white")
    pen = ImageDraw.Draw(sheet)
    for k, name in enumerate(names):
        left, top = k % columns * width, k // columns * height
        pen.text((left + 4, top + 4), name, fill="black")
        for j, picture in enumerate(_pictures(name)):
            small = Image.fromarray(picture)
            small.thumbnail(_TILE, Image.Resampling.LANCZOS)
            sheet.paste(small, (left + 2 + j * (small.width + 2), top + 20))
    return sheet


def _pictures(name: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Frame and depth, (H, W, 3): inverse depth in colour, near is red."""
    from matplotlib import colormaps

    scene = scenes.load(name)
    pose = scene.motion(scene.duration_s, 0).T_world_body(scene.duration_s / 2)
    spec, seen, span_m = scene.spec(), rig(scene.rig), scene.depth_range_m
    with StereoRenderer(spec, seen, 2, span_m, floats=scene.hdr, animate=scene.animate) as renderer:
        renderer.at(scene.duration_s / 2)
        grey = _toned(renderer.frame(0, pose).intensity, scene.hdr)
        depth_m = renderer.depth(0, pose)
    near, far = (1 / d for d in scene.depth_range_m)
    colour = colormaps["turbo"](np.clip((1 / depth_m - far) / (near - far), 0, 1))[..., :3]
    frame = np.repeat(grey[..., None], 3, axis=2)
    return _bytes(frame), _bytes(colour)


def _toned(intensity: NDArray[np.float32], hdr: bool) -> NDArray[np.float64]:
    """What an eye would see: a gamma curve, or decades of light."""
    light = intensity.astype(np.float64)
    if not hdr:
        return np.asarray(light ** (1 / 1.5))
    low, high = np.log(np.maximum(np.percentile(light, (0.5, 99.9)), 1e-4))
    decades = (np.log(np.maximum(light, 1e-4)) - low) / (high - low)
    return np.asarray(np.clip(decades, 0, 1) ** 0.6)


def _bytes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def main() -> None:
    """Writes the sheet that the command line asks for."""
    out, *names = sys.argv[1:]
    sheet = draw(tuple(names) or INDOOR)
    sheet.quantize(160).save(Path(out), optimize=True)


if __name__ == "__main__":
    main()
