"""How close simulated events come to those of the continuous world, per scene and way to simulate.

The world is stood in for by the finest pictures that are practical: 16 x 16 samples per pixel,
0.05 px apart. Each is a short clip of one camera; of sensors with many pixels, of their middle.

Run: python tests/benchmarks fidelity --truth FOLDER [CASE ...] [--parts] [--page docs/simulator.md]
[--picture docs/images/fidelity.png]. The truth is kept in FOLDER: it takes minutes per case.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence as Recording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.rendering.moving_bodies import MovingBodies
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig as rig_called
from eventsweep.sim.scene import Scene
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.simulate import simulate
from fidelity_picture import draw
from markdown_blocks import show

FINEST_SAMPLES, FINEST_PX = 16, 0.05
MATCH_US = 1000
_MARK = "fidelity"


@dataclass(frozen=True)
class Clip:
    """A short piece of a scene, seen by one camera.

    Attributes:
        scene: its name.
        duration_us: length, µs.
        rig: name of the rig; that of the scene unless given.
        crop_px: width and height of the middle part of the sensor; all of it unless given.
    """

    scene: str
    duration_us: int
    rig: str | None = None
    crop_px: tuple[int, int] | None = None


CLIPS = {
    "desk": Clip("desk", 30_000),
    "boxes": Clip("boxes", 40_000),
    "thin-structures": Clip("thin-structures", 30_000),
    "moving-objects": Clip("moving-objects", 20_000),
    "hdr-window": Clip("hdr-window", 12_000, None, (320, 240)),
    "reflective": Clip("reflective", 20_000),
    "low-texture": Clip("low-texture", 30_000),
    "tumvie-6dof": Clip("tumvie-6dof", 12_000, None, (480, 270)),
    "desk, 1280×720": Clip("desk", 12_000, "tumvie", (480, 270)),
    "mvsec-flying": Clip("mvsec-flying", 20_000, None, (240, 180)),
    "dsec-street": Clip("dsec-street", 10_000, None, (320, 240)),
}
CLOSE = {"min_frame_interval_us": 1}
WAYS: dict[str, dict[str, Any]] = {
    "linear": {"sampling": "linear"},
    "fast": {"sampling": "fast"},
    "accurate": {"sampling": "accurate"},
    "8 × 8 samples": {"sampling": "accurate", "supersample": 8},
}


# What the settings of `accurate` are worth, one by one.
PARTS: dict[str, dict[str, Any]] = {
    "linear, 0.05 px apart": {"sampling": "linear", "max_displacement_px": 0.05, **CLOSE},
    "linear, 6 × 6 samples": {"sampling": "linear", "supersample": 6},
    "2 × 2 samples": {"supersample": 2},
    "4 × 4 samples": {"supersample": 4},
    "2 px apart": {"max_displacement_px": 2},
}


@dataclass(frozen=True)
class Fidelity:
    """How some events compare with the truth.

    Attributes:
        lost: share of the true number that is missing; negative where there are too many.
        error_us: (N,) per true event, time to the nearest event of the same pixel and polarity, µs.
    """

    lost: float
    error_us: NDArray[np.int64]

    @property
    def matched(self) -> float:
        """Share of the true events with one within `MATCH_US`."""
        return float(np.mean(self.error_us <= MATCH_US))

    @property
    def median_us(self) -> float:
        """Median time error, µs."""
        return float(np.median(self.error_us))


def view_of(clip: Clip) -> tuple[Scene, Rig]:
    """The clip's scene, and its one camera."""
    scene = scenes.load(clip.scene)
    whole = rig_called(clip.rig or scene.rig)
    camera = whole.cameras[0]
    if clip.crop_px is not None:
        width, height = clip.crop_px
        left, top = (camera.width_px - width) // 2, (camera.height_px - height) // 2
        camera = replace(
            camera, width_px=width, height_px=height,
            cx_px=camera.cx_px - left, cy_px=camera.cy_px - top,
        )  # fmt: skip
    return scene, Rig(whole.name, (camera,), (whole.T_body_cam[0],), ("left",))


def truth(clip: Clip, kept: Path) -> Events:
    """The events of the finest pictures; from `kept` where they have been made before."""
    if kept.exists():
        stored = np.load(kept)
        return Events(*(stored[name] for name in ("x", "y", "t", "p")))
    scene, rig = view_of(clip)
    config = scene.configured(
        SimConfig(sampling="linear", max_displacement_px=FINEST_PX, min_frame_interval_us=1)
    )
    motion, camera = scene.motion(scene.duration_s, 0), rig.cameras[0]
    pixels, parts = EventSimulator(camera.width_px, camera.height_px, config), []
    with StereoRenderer(
        scene.spec(), rig, FINEST_SAMPLES, scene.depth_range_m,
        floats=config.light.floats(scene.hdr), animate=scene.animate,
    ) as renderer:  # fmt: skip
        bodies = MovingBodies(renderer) if scene.animate else None
        stops_us = [0, clip.duration_us]
        for number, frame in enumerate(
            adaptive_frames(renderer, motion, stops_us, config, bodies=bodies)
        ):
            if number == 0:
                pixels.start(frame.frames[0].intensity, frame.t_us)
            else:
                parts.append(pixels.step(frame.frames[0].intensity, frame.t_us))
    events = Events.concat(parts)
    with atomic_path(kept) as partial, partial.open("wb") as file:
        np.savez(file, x=events.x, y=events.y, t=events.t_us, p=events.p)
    return events


def simulated(clip: Clip, settings: dict[str, Any]) -> tuple[Events, float]:
    """The clip's events as the simulator makes them, and the processor time that they took, s."""
    scene, rig = view_of(clip)
    # The whole scene's motion, of which the clip is the beginning.
    clipped = replace(scene, motion=lambda _s, seed: scene.motion(scene.duration_s, seed))
    config = SimConfig(duration_s=1e-6 * clip.duration_us, **settings)
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.process_time()
        simulate(clipped, rig, config, 0, Path(folder) / "clip")
        took_s = time.process_time() - began_s
        recording = Recording.open(Path(folder) / "clip")
        first_us, last_us = recording.event_span_us(0)
        return recording.events(0, first_us, last_us + 1), took_s


def compared(found: Events, true: Events, width_px: int) -> Fidelity:
    """Nearest events of the same pixel and polarity."""
    span = 1 << 32

    def keys(events: Events) -> NDArray[np.int64]:
        place = 2 * (events.y.astype(np.int64) * width_px + events.x) + events.p
        return np.sort(place * span + events.t_us)

    wanted, have = keys(true), keys(found)
    after = np.searchsorted(have, wanted)
    error_us = np.full(len(wanted), span // 2)
    for near in (after - 1, after):
        other = have[np.clip(near, 0, len(have) - 1)]
        same = other // span == wanted // span
        error_us = np.where(same, np.minimum(error_us, np.abs(other - wanted)), error_us)
    return Fidelity(1 - len(found) / len(true), error_us)


def table(results: dict[str, dict[str, Fidelity]], counts: dict[str, int]) -> str:
    """The results as Markdown."""
    names = list(next(iter(results.values())))
    head = "| Scene | true events | " + " | ".join(names) + " |"
    lines = [
        f"Events lost (−: too many), true events with one within {MATCH_US / 1000:g} ms, median "
        f"time error, against {FINEST_SAMPLES} × {FINEST_SAMPLES} samples {FINEST_PX:g} px apart. "
        "Written by `python tests/benchmarks fidelity`.",
        "",
        head,
        "|---|--:" + "|--:" * len(names) + "|",
    ]
    for case, ways in results.items():
        cells = [
            f"{100 * ways[way].lost:+.1f} %, {100 * ways[way].matched:.0f} %, "
            f"{ways[way].median_us:.0f} µs".replace("-", "−")
            for way in names
        ]
        count = f"{counts[case]:,}".replace(",", " ")
        lines.append(f"| {case} | {count} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Compares all ways to simulate with the truth and prints, writes or draws what came out."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CLIPS)}")
    parser.add_argument("--truth", type=Path, required=True, help="folder that keeps the truth")
    parser.add_argument("--parts", action="store_true", help="what single settings are worth")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(arguments)
    unknown = set(given.cases) - set(CLIPS)
    if unknown:
        parser.error(f"no case {', '.join(sorted(unknown))}: choose of {', '.join(CLIPS)}")
    given.truth.mkdir(parents=True, exist_ok=True)
    results: dict[str, dict[str, Fidelity]] = {}
    counts: dict[str, int] = {}
    for case in given.cases or CLIPS:
        clip = CLIPS[case]
        true = truth(clip, given.truth / f"{case}.npz")
        width_px, results[case], counts[case] = view_of(clip)[1].cameras[0].width_px, {}, len(true)
        for way, settings in (PARTS if given.parts else WAYS).items():
            found, took_s = simulated(clip, settings)
            results[case][way] = one = compared(found, true, width_px)
            line = {
                "case": case, "way": way, "true": len(true), "lost": round(one.lost, 4),
                "matched": round(one.matched, 4), "median_us": one.median_us,
                "processor_s": round(took_s, 2),
            }  # fmt: skip
            sys.stdout.write(json.dumps(line, ensure_ascii=False) + "\n")
            sys.stdout.flush()
    block = table(results, counts)
    show(block, given.page, _MARK + "-parts" * given.parts)
    if given.picture:
        draw({c: {w: f.error_us for w, f in ways.items()} for c, ways in results.items()},
             given.picture)  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
