"""How late poses and maps of `track` come: `python tests/benchmarks track_latency --out FOLDER`.

A tracker is fed twins of `track_scores` in packets of 10 ms, twice: as fast as it takes them, and
at the pace of the recording, as a live camera does. Both clocks begin with the first poses; how
long these take stands by itself. Latencies are of the second run: of a pose, from the end of its
packet; of a map, from the end of its window. Images of a megapixel are tracked at half resolution,
too. Kernels are loaded before. With `--page` the table is written into a page. Needs a quiet
machine.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import eventsweep as es
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.pose import Pose
from eventsweep.plugins.track.odometry.tracker import Tracker
from markdown_blocks import show
from table_code import Code, of_scenes
from track_scores import Twin, simulated, twins_of

MARK = "track-latency"
SCENES = "desk", "rpg-bin", "dsec-street", "tumvie-6dof"
_PACKET_US, _WARM_US, _MEGAPIXEL = 10_000, 600_000, 900_000
_HEADS = (
    "Scene", "Image", "s", "Mev/s per camera", "Begins, s", "s per s", "CPU s per s",
    "Pose, ms: median", "95 %", "Map, ms: 95 %", "ATE, % of the way",
)  # fmt: skip


@dataclass
class Run:
    """What feeding a tracker gave; the second clock begins with the first poses.

    Attributes:
        begin_s: what the packet took that gave the first poses.
        wall_s: time per second of the recording from then on.
        cpu_s: CPU time of all threads, likewise.
        poses_s: latency of each pose from then on.
        maps_s: the same of maps.
        poses: all, not smoothed.
    """

    begin_s: float = float("nan")
    wall_s: float = float("nan")
    cpu_s: float = float("nan")
    poses_s: list[float] = field(default_factory=list)
    maps_s: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)


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


def packets_of(
    recording: Recording, length_us: int | None = None
) -> list[tuple[int, list[es.Events]]]:
    """All events, or those of a first part, in packets of 10 ms, each with its end."""
    cameras = range(len(recording.rig))
    first_us, last_us = events_span_us(recording)
    until_us = last_us if length_us is None else min(last_us, first_us + length_us)
    return [
        (t_us, [recording.events(k, t_us - _PACKET_US, t_us) for k in cameras])
        for t_us in range(first_us + _PACKET_US, until_us + 1, _PACKET_US)
    ]


def fed(
    recording: Recording, packets: Sequence[tuple[int, list[es.Events]]], config: TrackConfig, *,
    paced: bool,
) -> Run:  # fmt: skip
    """Feeds a tracker; `paced`: each packet at its time, after the beginning."""
    run, clock, end_us = Run(), None, 0

    def on_pose(pose: Pose) -> None:
        run.poses.append(pose)
        if clock is not None:
            run.poses_s.append(clock.late_s(end_us))

    def on_map(online: es.OnlineMap) -> None:
        if clock is not None:
            run.maps_s.append(clock.late_s(online.window.t1_us))

    tracker = Tracker(
        recording.rig, config, depth_range_m=recording.depth_range_m, on_pose=on_pose, on_map=on_map
    )
    for end_us, packet in packets:
        if clock is not None and paced:
            time.sleep(max(0.0, -clock.late_s(end_us)))
        pushed_s = time.perf_counter()
        begun = tracker.push(packet, end_us) is not None
        if clock is None and begun:
            run.begin_s, clock = time.perf_counter() - pushed_s, Clock(end_us)
    if clock is not None:
        run.wall_s, run.cpu_s = clock.per_second(end_us)
    return run


def lines(twin: Twin, path: Path) -> Iterator[list[str]]:
    """A twin's cells of the table; of a megapixel's images at half resolution, too."""
    recording = open_recording(path)
    camera = recording.rig.cameras[0]
    packets = packets_of(recording)
    rate = sum(len(packet[0]) for _, packet in packets) / twin.seconds / 1e6
    is_large = camera.width_px * camera.height_px > _MEGAPIXEL
    for half in (False, True) if is_large else (False,):
        size = f"{camera.width_px}×{camera.height_px}" + ", half" * half
        cells = f"`{twin.drawn}`", size, f"{twin.seconds:g}", f"{rate:.2g}"
        yield [*cells, *_measured(recording, packets, TrackConfig(half_resolution=half))]


def _measured(
    recording: Recording, packets: Sequence[tuple[int, list[es.Events]]], config: TrackConfig
) -> list[str]:
    fed(recording, packets_of(recording, _WARM_US), config, paced=False)
    fast, live = (fed(recording, packets, config, paced=paced) for paced in (False, True))
    found = Trajectory.from_matrices(
        [pose.t_us for pose in live.poses], np.stack([pose.T_world_body for pose in live.poses])
    )
    ate_percent = score_poses(recording.trajectory, found).values["ate_share"]

    def ms(values_s: Sequence[float], percent: float) -> str:
        return f"{1e3 * np.percentile(values_s, percent):.0f}" if len(values_s) else "–"

    return [
        f"{fast.begin_s:.1f}",
        f"{fast.wall_s:.2f}",
        f"{fast.cpu_s:.2f}",
        ms(live.poses_s, 50),
        ms(live.poses_s, 95),
        ms(live.maps_s, 95),
        f"{ate_percent:.2f}",
    ]


def table(rows: Sequence[Sequence[str]]) -> str:
    """The table in Markdown."""
    rule = ["---"] * 2 + ["--:"] * (len(_HEADS) - 2)
    cores = len(os.sched_getaffinity(0))
    return "\n".join(
        [
            f"Written by `python tests/benchmarks track_latency`; {cores} cores. Begins: the",
            "first poses come so long after their events. The rest is from then on: time per",
            "second as fast as it goes; latencies at the pace of the recording. ATE: not smoothed.",
            "",
            *(f"| {' | '.join(row)} |" for row in (_HEADS, rule, *rows)),
            "",
        ]
    )


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    own, simulation = (
        ("track_latency:lines", "track_latency:table"),
        "eventsweep.eval.stages.simulate",
    )
    return {f"plugins/track/odometry.md#{MARK}": Code(own, (simulation,)) + of_scenes(SCENES)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--scene", action="append", default=[], help="SCENE or SCENE=SEED")
    parser.add_argument("--seconds", type=float, help="another length of all sequences, s")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        twins = list(twins_of(asked.scene or SCENES, "521", asked.seconds))
        paths = [simulated(twin, asked.out) for twin in twins]
        found = [row for each in zip(twins, paths, strict=True) for row in lines(*each)]
        show(table(found), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    raise SystemExit(main())
