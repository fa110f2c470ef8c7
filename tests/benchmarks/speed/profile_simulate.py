"""Where its time goes: `python tests/benchmarks profile_simulate SCENE RIG SECONDS WORKERS`.

Stages of worker processes are not seen from here; profile with one worker.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

import scenes
from emvs.data import event_store, image_stores
from sim import simulate
from sim.config import SimConfig
from sim.parallel import render_job, sensors
from sim.rendering import adaptive_sampling, renderer
from sim.rigs import rig

# Owner, function, stage; a stage in a thread of its own runs beside the others.
STAGES = (
    (renderer.StereoRenderer, "frame", "render frames"),
    (renderer.StereoRenderer, "_draw", "of it: draw, read back"),
    (render_job.ChunkRenderer, "_truth", "render truth"),
    (adaptive_sampling._View, "moved_px", "choose times"),
    (sensors.Cameras, "_step", "events (threads)"),
    (sensors.Cameras, "collect", "wait for events"),
    (event_store.EventStoreWriter, "append", "write events"),
    (image_stores.TruthWriter, "append", "write truth"),
    (simulate.CheckpointFolder, "commit", "finish checkpoints"),
    (simulate, "_assemble", "put together"),
)
_lock = threading.Lock()


def watch(owner, name, stage, wall_s, cpu_s):
    inner = getattr(owner, name)

    def timed(*args, **kwargs):
        began = time.perf_counter(), time.thread_time()
        try:
            return inner(*args, **kwargs)
        finally:
            with _lock:
                wall_s[stage] += time.perf_counter() - began[0]
                cpu_s[stage] += time.thread_time() - began[1]

    setattr(owner, name, timed)


def main(scene: str, rig_name: str, seconds: str, workers: str) -> None:
    wall_s, cpu_s = defaultdict(float), defaultdict(float)
    for owner, name, stage in STAGES:
        watch(owner, name, stage, wall_s, cpu_s)
    calls = []
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        simulate.simulate(
            scenes.load(scene), rig(rig_name), SimConfig(duration_s=float(seconds)), 0,
            Path(folder) / "s", workers=int(workers), progress=lambda *call: calls.append(call),
        )  # fmt: skip
    total_s = time.perf_counter() - began_s
    print(f"{total_s:.1f} s, {len(calls)} frames, {calls[-1][2] / 1e6:.2f} M events")  # noqa: T201
    for stage in (stage for *_, stage in STAGES if stage in wall_s):
        share = 100 * wall_s[stage] / total_s
        print(f"{stage:18} {wall_s[stage]:7.2f} s {share:5.1f} %  CPU {cpu_s[stage]:6.2f} s")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
