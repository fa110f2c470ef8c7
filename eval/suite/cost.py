"""What one method alone costs: mapped in a process of its own, in one thread.

A suite maps all methods of a window together, which share their sweep; so its jobs do not tell what
one of them needs.
"""

from __future__ import annotations

import multiprocessing
import time
from pathlib import Path
from typing import Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.eval.jobs.local import ONE_THREAD, environment
from eventsweep.eval.progress import Display
from eventsweep.eval.results.results import MeasuredCost, Results, mapper_method
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.source import SequenceSource
from eventsweep.eval.suite.speed import speed_job

REPEATS = 3


def measured_costs(
    result: Results, suite: Suite, cache: Path, progress: Display,
    archive: SequenceSource | None = None,
) -> dict[str, MeasuredCost]:  # fmt: skip
    """Maps the first window of the suite's speed case with each method alone.

    By the method's name in the rows; nothing where there is no speed case or it was not run.
    """
    timed = speed_job(result, suite, cache, archive)
    if timed is None:
        return {}
    score, sequence = timed
    wanted: dict[str, dict[str, Any]] = {}
    for mapper, job in zip(score.parameters["mappers"], score.needs[1:], strict=True):
        settings = job.parameters["map"]
        for method in MapperConfig.model_validate(settings).methods:
            alone = {**settings, "methods": [method]}
            wanted.setdefault(mapper_method(method, mapper), alone)
    found = {}
    with progress.stage("cost", len(wanted)) as update, environment(ONE_THREAD):
        for name, settings in wanted.items():
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                seconds, memory_mb = pool.apply(_mapped, (str(sequence), settings))
            case = score.parameters["case"]
            found[name] = MeasuredCost(case, round(seconds, 4), round(memory_mb, 1))
            update(len(found), name)
    return found


def _mapped(sequence: str, settings: dict[str, Any]) -> tuple[float, float]:
    """CPU seconds of mapping, the least of several times, and the process's peak memory, MB."""
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.mapper import map_window

    recording = open_recording(sequence)
    config = MapperConfig.model_validate({**settings, "threads": 1})
    seconds = []
    for _ in range(REPEATS + 1):  # the first one compiles and reads the disk
        started_s = time.process_time()
        map_window(recording, config)
        seconds.append(time.process_time() - started_s)
    return min(seconds[1:]), _peak_memory_mb()


def _peak_memory_mb() -> float:
    """Of this process; `getrusage` would count what its parent had before it began."""
    lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
    peak = next(line for line in lines if line.startswith("VmHWM:"))
    return int(peak.split()[1]) * 1024 / 1e6
