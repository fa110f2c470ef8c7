"""A frame in an event camera's pixels, and its mask: `python docs/figures/draw_align.py FILE`."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.formats.depth import write_image
from eventsweep.plugins.align.carry import aligned_frame
from eventsweep.plugins.align.depths import depth_source
from eventsweep.plugins.align.rig import Setup, set_up
from eventsweep.plugins.align.views_kernels import OCCLUDED, SEEN
from eventsweep.scenes import load
from eventsweep.sim.config import FramesConfig, SimConfig
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.simulate import simulate

_AROUND_US = 2000
_ORANGE = np.array([0, 94, 213], np.float32)  # blue, green, red
_SCALE, _GAMMA = 2, 1 / 2.2


def draw(setup: Setup, path: Path) -> None:
    """Draws the first frame: the camera's own, in the eye's pixels with events, and the mask."""
    assert setup.frames is not None
    index = setup.covered()[0]
    frame = aligned_frame(setup, index)
    grey = _bright(frame.image)
    events = setup.recording.events(setup.events, frame.t_us - _AROUND_US, frame.t_us + _AROUND_US)
    over = grey.copy()
    over[events.y, events.x] = _ORANGE
    hidden = np.where((frame.mask == OCCLUDED)[..., None], _ORANGE, grey)
    hidden[(frame.mask != OCCLUDED) & (frame.mask != SEEN)] = 255
    own = _bright(setup.frames.photo(index).image.astype(np.float32))
    height = over.shape[0] * _SCALE
    width = round(own.shape[1] * height / own.shape[0])
    parts = [cv2.resize(own, (width, height), interpolation=cv2.INTER_AREA)]
    for picture in (over, hidden):
        size = picture.shape[1] * _SCALE, height
        parts.append(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST))
    row = np.concatenate(parts, axis=1)
    small = cv2.resize(row, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    levels = np.rint(small / 16).clip(0, 15) * 17  # sixteen levels keep the file small
    write_image(path, ".png", levels.astype(np.uint8))


def _bright(image: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32: the linear light as a screen shows it."""
    shown = 255 * np.clip(1.6 * image / 255, 0, 1) ** _GAMMA
    return np.repeat(shown[..., None], 3, axis=-1).astype(np.float32)


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulates a desk with a frame camera between two event cameras, and draws its first frame."""
    parser = argparse.ArgumentParser(prog="python docs/figures/draw_align.py", description=__doc__)
    parser.add_argument("file", type=Path)
    path = parser.parse_args(arguments).file
    with tempfile.TemporaryDirectory() as folder:
        config = SimConfig(duration_s=0.06, frames=FramesConfig(rate_hz=20.0))
        simulate(load("desk"), RIGS["davis346-frames"], config, 0, Path(folder) / "desk")
        recording = open_recording(Path(folder) / "desk")
        draw(set_up(recording, depth_source(recording, None)), path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
