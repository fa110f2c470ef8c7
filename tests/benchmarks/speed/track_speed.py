"""Measures `track` against the clock: `python tests/benchmarks track_speed --out FOLDER`.

Each twin of `track_scores` is tracked twice: as fast as it goes, and fed packets of 10 ms at the
pace of the recording, as a live camera does. Of the second run come the latencies: of a pose, from
the end of its packet; of a map, from the end of its window. With `--page docs/odometry.md` the
table is written into the page. Needs a quiet machine; kernels are loaded before.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import eventsweep as es
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.odometry.recorded import track
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from track_scores import Twin, simulated, twins_of, warm_up

MARK = "track-speed"
SCENES = ("desk", "mvsec-flying", "rpg-bin", "dsec-street")
_PACKET_US = 10_000
_SETTLED_US = 1_000_000
"""From then on latencies count: before, the first map is made, and what came meanwhile tracked."""


@dataclass
class Live:
    """What a run at the pace of the recording gave, s: of the clock since it began.

    Attributes:
        begun_s: when the first poses came, after the time that they wait for.
        poses_s: latency of each pose after the beginning.
        maps_s: the same of maps.
        cpu_s: CPU time per second after the beginning, all threads.
    """

    begun_s: float = float("nan")
    poses_s: list[float] = field(default_factory=list)
    maps_s: list[float] = field(default_factory=list)
    cpu_s: float = float("nan")


def live(recording: EventSequence) -> Live:
    """Feeds a tracker as a camera does."""
    found = Live()
    cameras = range(len(recording.rig))
    first_us = min(recording.event_span_us(k)[0] for k in cameras)
    last_us = max(recording.event_span_us(k)[1] for k in cameras)
    ends_us = range(first_us + _PACKET_US, last_us, _PACKET_US)
    packets = [[recording.events(k, t - _PACKET_US, t) for k in cameras] for t in ends_us]
    began_s, end_us = time.perf_counter(), first_us

    def late_s(t_us: int) -> float:
        return time.perf_counter() - began_s - (t_us - first_us) * 1e-6

    def on_pose(_pose: es.Pose) -> None:
        if np.isnan(found.begun_s):
            found.begun_s = late_s(end_us)
        if end_us - first_us >= _SETTLED_US:
            found.poses_s.append(late_s(end_us))

    def on_map(online: es.OnlineMap) -> None:
        if end_us - first_us >= _SETTLED_US:
            found.maps_s.append(late_s(online.window.t1_us))

    tracker = es.Tracker(
        recording.rig, depth_range_m=recording.depth_range_m, on_pose=on_pose, on_map=on_map
    )
    settled: tuple[float, int] | None = None
    for end_us, packet in zip(ends_us, packets, strict=True):
        time.sleep(max(0.0, -late_s(end_us)))
        tracker.push(packet, end_us)
        if settled is None and end_us - first_us >= _SETTLED_US:
            settled = time.process_time(), end_us
    if settled is not None:
        found.cpu_s = (time.process_time() - settled[0]) / ((end_us - settled[1]) * 1e-6)
    return found


def line(twin: Twin, path: Path) -> str:
    """A twin's line of the table."""
    recording = EventSequence.open(path)
    began_s = time.perf_counter()
    track(recording)
    factor = (time.perf_counter() - began_s) / twin.seconds
    found = live(recording)
    camera = recording.rig.cameras[0]

    def ms(values_s: Sequence[float], percent: float) -> str:
        return f"{1e3 * np.percentile(values_s, percent):.0f}" if len(values_s) else "–"

    cells = (
        f"`{twin.scene}`", f"{camera.width_px}×{camera.height_px}", f"{twin.seconds:g}",
        f"{recording.event_count(0) / twin.seconds / 1e6:.2g}", f"{factor:.2f}",
        f"{found.cpu_s:.2f}", ms(found.poses_s, 50), ms(found.poses_s, 95),
        ms(found.maps_s, 95), f"{found.begun_s:.1f}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def table(lines: Sequence[str]) -> str:
    """The table in Markdown."""
    heads = (
        f"Written by `python tests/benchmarks track_speed`, {os.cpu_count()} cores. “s per s”: as",
        "fast as it goes, the beginning included; the rest at the pace of the recording, after its",
        "first second. “Begins”: the first poses come so long after their events.",
        "",
        "| Scene | Image | s | Mev/s per camera | s per s | CPU s per s | Pose, ms: median | 95 % "
        "| Map, ms: 95 % | Begins, s |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    )
    return "\n".join((*heads, *lines)) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--scene", action="append", default=[], help="SCENE or SCENE=SEED")
    parser.add_argument("--seconds", type=float, help="another length of all sequences, s")
    asked = parser.parse_args(arguments)
    with exit_code() as code:
        twins = list(twins_of(asked.scene or SCENES, "4", asked.seconds))
        paths = [simulated(twin, asked.out) for twin in twins]
        for path in paths:
            warm_up(path)
        show(table([line(*each) for each in zip(twins, paths, strict=True)]), asked.page, MARK)
    return code.value


if __name__ == "__main__":
    raise SystemExit(main())
