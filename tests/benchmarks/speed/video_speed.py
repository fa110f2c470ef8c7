"""How fast videos become events, and how far apart their frames may be.

    python tests/benchmarks video_speed --page plugins/video/howto_video.md

Writes two tables. Speed: a texture that moves 0.7 px per frame, as a Motion JPEG video and as a
folder of PNG images, through the whole way from files to a sequence on disk, in one process whose
kernels are compiled; the best of three runs. Pace: textures and bars that move from half a pixel to
16 px per frame, against the events of the same motion in steps of 1/20 px.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.video.film import TOO_FAST, Pace
from eventsweep.plugins.video.record import RecordedVideo, record
from eventsweep.sim.config import PixelConfig, VideoConfig
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor_presets import PresetName, SensorConfig
from markdown_blocks import into_page
from study_cost import machine

Frames = Iterator[NDArray[np.uint8]]
SIZES = ((346, 260), (1280, 720))
PRESETS: tuple[PresetName, ...] = ("ideal", "davis346")
COUNT, RATE_HZ, STEP_PX, RUNS = 300, 300.0, 0.7, 3
# A sixth of the seconds would do for large frames: 60 of them are 55 million pixels.
LARGE_COUNT = 60
FINE_PX, WAY_PX = 0.05, 64
STEPS_PX = (0.5, 1, 2, 4, 8, 16)


class Taken(NamedTuple):
    """Seconds by the clock, and of all processors."""

    wall_s: float
    processor_s: float


def drifting(width_px: int, height_px: int, count: int) -> Frames:
    """Colour frames of a smooth texture that moves sideways."""
    rng = np.random.default_rng(0)
    noise = rng.random((height_px + 20, width_px + 40 + int(count * STEP_PX), 3), np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 5, 250, cv2.NORM_MINMAX)  # type: ignore[call-overload]
    for k in range(count):
        centre = width_px / 2 + 10 + STEP_PX * k, height_px / 2 + 5
        yield np.rint(cv2.getRectSubPix(texture, (width_px, height_px), centre)).astype(np.uint8)


def write_video(path: Path, frames: Frames, size_px: tuple[int, int]) -> None:
    """A Motion JPEG video."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, size_px)
    for frame in frames:
        writer.write(frame)
    writer.release()


def write_folder(path: Path, frames: Frames) -> None:
    """PNG images; their times follow from the rate."""
    path.mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(str(path / f"{k}.png"), frame)


def fastest(make: Callable[[Path], RecordedVideo], folder: Path) -> tuple[Taken, RecordedVideo]:
    """Least times of several runs, after one that does not count, and what came out."""
    wall, processor = [], []
    for run in range(RUNS + 1):
        since_s = time.perf_counter(), time.process_time()
        made = make(folder / f"{run}")
        wall.append(time.perf_counter() - since_s[0])
        processor.append(time.process_time() - since_s[1])
    return Taken(min(wall[1:]), min(processor[1:])), made


def speed_lines() -> Iterator[str]:
    """A line per size, source and sensor."""
    for size_px in SIZES:
        count = COUNT if size_px[0] < 1000 else LARGE_COUNT
        for source in ("video.avi", "images"):
            for preset in PRESETS:
                yield speed_line(size_px, count, source, preset)


def speed_line(size_px: tuple[int, int], count: int, source: str, preset: PresetName) -> str:
    """Measures one case."""
    pixels = PixelConfig(sensor=SensorConfig(preset=preset))
    video = VideoConfig(rate_hz=RATE_HZ)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / source
        frames = drifting(*size_px, count)
        write_video(path, frames, size_px) if path.suffix else write_folder(path, frames)
        taken, made = fastest(lambda out: record(path, out, pixels, video), Path(name))
    what = "Motion JPEG" if path.suffix else "PNG images"
    slower = taken.wall_s / (made.frames / RATE_HZ)
    cells = (
        f"{size_px[0]}x{size_px[1]}", what, f"`{preset}`", f"{made.events / made.frames:,.0f}",
        f"{made.frames / taken.wall_s:,.0f}", f"{1e3 * taken.processor_s / made.frames:.1f}",
        f"{1 / slower:.1f} times faster" if slower < 1 else f"{slower:.1f} times slower",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def speed_table() -> str:
    """Ours, measured."""
    where = machine()
    head = (
        "| px | source | sensor | events per frame | frames/s | processor ms per frame | than a "
        f"video of {RATE_HZ:g} Hz plays |\n|---|---|---|---|---|---|---|"
    )
    return "\n".join([head, *speed_lines(), "", where])


def textures() -> dict[str, NDArray[np.float32]]:
    """What moves, as linear light."""
    rng = np.random.default_rng(0)

    def cloudy(sigma_px: float, contrast: float) -> NDArray[np.float32]:
        noise = cv2.GaussianBlur(rng.random((400, 900), np.float32), (0, 0), sigma_px)
        light = 0.4 * np.exp(contrast * (noise - noise.mean()) / noise.std())
        return np.asarray(np.clip(light, 0.02, 1), np.float32)

    bars = np.where(np.arange(900) % 60 < 30, np.float32(0.8), np.float32(0.15))[None].repeat(
        400, axis=0
    )
    return {
        "smooth, strong (σ 3 px, 0.3)": cloudy(3, 0.3),
        "fine, strong (σ 1.5 px, 0.5)": cloudy(1.5, 0.5),
        "fine, weak (σ 1.5 px, 0.15)": cloudy(1.5, 0.15),
        "bars of 30 px, 5 : 1": np.asarray(
            cv2.GaussianBlur(bars.repeat(400, axis=0), (0, 0), 0.7), np.float32
        ),
    }


def moved(texture: NDArray[Any], step_px: float) -> tuple[Events, float]:
    """Events of a texture that moves 1 px/ms, seen every so many pixels, and the measure."""
    pixels = PixelConfig()
    simulator, pace, packets = EventSimulator(346, 260, pixels), Pace(pixels), []
    for k in range(int(WAY_PX / step_px) + 1):
        view = cv2.getRectSubPix(texture, (346, 260), (213 + step_px * k, 150))
        frame = np.asarray(view, np.float32)
        pace.take(frame)
        if k:
            packets.append(simulator.step(frame, round(k * step_px * 1000)))
        else:
            simulator.start(frame, 0)
    return Events.concat(packets), pace.lost_at_half_rate


def found(coarse: Events, fine: Events) -> float:
    """Share of the fine events that a coarse one of pixel and sign has within 1 px of motion."""

    def keys(events: Events) -> NDArray[np.int64]:
        place = (events.y.astype(np.int64) * 346 + events.x) * 2 + events.p
        return place * 10**8 + events.t_us

    sorted_keys, wanted = np.sort(keys(coarse)), keys(fine)
    after = np.searchsorted(sorted_keys, wanted)
    last = len(sorted_keys) - 1
    gaps = [np.abs(wanted - sorted_keys[np.clip(k, 0, last)]) for k in (after - 1, after)]
    return float((np.minimum(*gaps) <= 1000).mean())


def pace_table() -> str:
    """For every texture and speed: the measure, and the share of events that are there in time."""
    head = " | ".join(f"{step:g} px" for step in STEPS_PX)
    lines = [f"| | {head} |", "|---|" + "---|" * len(STEPS_PX)]
    for name, texture in textures().items():
        fine, _ = moved(texture, FINE_PX)
        cells = []
        for step_px in STEPS_PX:
            coarse, lost = moved(texture, step_px)
            told = "**" if lost > TOO_FAST else ""
            cells.append(f"{told}{lost:.2f}{told}, {found(coarse, fine):.0%}".replace("%", " %"))
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, and writes the tables into a page."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks video_speed", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--page", type=Path, help="page whose tables to write; else they are shown")
    asked = parser.parse_args(arguments)
    with exit_code() as code:
        for mark, table in {"video-speed": speed_table(), "video-pace": pace_table()}.items():
            if asked.page is None:
                sys.stdout.write(f"{table}\n\n")
            else:
                into_page(asked.page, mark, table)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
