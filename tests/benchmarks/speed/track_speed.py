"""Measures `track` against the clock: `python tests/benchmarks track_speed --out FOLDER`.

A tracker is fed each twin of `track_scores` twice, in packets of 10 ms: as fast as it takes them,
and at the pace of the recording, as a live camera does. How long the beginning takes stands by
itself: both clocks begin with the first poses. Of the second run come the latencies: of a pose,
from the end of its packet; of a map, from the end of its window. With `--page plugins/track/odometry.md` the
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
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from track_scores import Twin, simulated, twins_of, warm_up

MARK = "track-speed"
SCENES = ("desk", "mvsec-flying", "rpg-bin", "dsec-street")
_PACKET_US = 10_000


@dataclass
class Run:
    """What feeding a tracker gave.

    Attributes:
        begin_s: time that the packet took that gave the first poses.
        wall_s: time per second of the recording from then on.
        cpu_s: CPU time of all threads, likewise.
        poses_s: latency of each pose from then on.
        maps_s: the same of maps.
    """

    begin_s: float = float("nan")
    wall_s: float = float("nan")
    cpu_s: float = float("nan")
    poses_s: list[float] = field(default_factory=list)
    maps_s: list[float] = field(default_factory=list)


class Clock:
    """Runs beside the time of a recording, from some moment on."""

    def __init__(self, t_us: int) -> None:
        self._t_us, self._wall_s, self._cpu_s = t_us, time.perf_counter(), time.process_time()

    def late_s(self, t_us: int) -> float:
        """How long ago a time of the recording was."""
        return time.perf_counter() - self._wall_s - (t_us - self._t_us) * 1e-6

    def per_second(self, t_us: int) -> tuple[float, float]:
        """Time and CPU time per second of the recording up to now."""
        wall_s, cpu_s = time.perf_counter() - self._wall_s, time.process_time() - self._cpu_s
        seconds = (t_us - self._t_us) * 1e-6
        return wall_s / seconds, cpu_s / seconds


def fed(recording: EventSequence, *, paced: bool) -> Run:
    """Feeds a tracker; `paced`: each packet at its time, after the beginning."""
    run, clock = Run(), None
    cameras = range(len(recording.rig))
    first_us = min(recording.event_span_us(k)[0] for k in cameras)
    last_us = max(recording.event_span_us(k)[1] for k in cameras)
    ends_us = range(first_us + _PACKET_US, last_us, _PACKET_US)
    packets = [[recording.events(k, t - _PACKET_US, t) for k in cameras] for t in ends_us]
    end_us = first_us

    def on_pose(_pose: es.Pose) -> None:
        if clock is not None:
            run.poses_s.append(clock.late_s(end_us))

    def on_map(online: es.OnlineMap) -> None:
        if clock is not None:
            run.maps_s.append(clock.late_s(online.window.t1_us))

    tracker = es.Tracker(
        recording.rig, depth_range_m=recording.depth_range_m, on_pose=on_pose, on_map=on_map
    )
    for end_us, packet in zip(ends_us, packets, strict=True):
        if clock is not None and paced:
            time.sleep(max(0.0, -clock.late_s(end_us)))
        pushed_s = time.perf_counter()
        begun = tracker.push(packet, end_us) is not None
        if clock is None and begun:
            run.begin_s, clock = time.perf_counter() - pushed_s, Clock(end_us)
    if clock is not None:
        run.wall_s, run.cpu_s = clock.per_second(end_us)
    return run


def line(twin: Twin, path: Path) -> str:
    """A twin's line of the table."""
    recording = EventSequence.open(path)
    fast, live = (fed(recording, paced=paced) for paced in (False, True))
    camera = recording.rig.cameras[0]

    def ms(values_s: Sequence[float], percent: float) -> str:
        return f"{1e3 * np.percentile(values_s, percent):.0f}" if len(values_s) else "–"

    cells = (
        f"`{twin.scene}`", f"{camera.width_px}×{camera.height_px}", f"{twin.seconds:g}",
        f"{recording.event_count(0) / twin.seconds / 1e6:.2g}", f"{fast.begin_s:.1f}",
        f"{fast.wall_s:.2f}", f"{fast.cpu_s:.2f}", ms(live.poses_s, 50), ms(live.poses_s, 95),
        ms(live.maps_s, 95),
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def table(lines: Sequence[str]) -> str:
    """The table in Markdown."""
    heads = (
        f"Written by `python tests/benchmarks track_speed`, {os.cpu_count()} cores. “Begins”: the",
        "first poses come so long after their events. The rest is from then on: time per second",
        "as fast as it goes; latencies at the pace of the recording, without the queue that the",
        "beginning leaves.",
        "",
        "| Scene | Image | s | Mev/s per camera | Begins, s | s per s | CPU s per s "
        "| Pose, ms: median | 95 % | Map, ms: 95 % |",
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
