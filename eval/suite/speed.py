"""How fast the mapper is: CPU time of mapping over that of a fixed loop.

Seconds say as much about the machine, and who else uses it, as about the mapper. So a fixed loop is
timed beside it, which does what a mapper does: arithmetic and scattered additions into an image
that fits no first-level cache. Both are counted in CPU time of one thread, one right after the
other, and the ratio is kept, with the processor's name: another one may be half as fast again at
one of the two.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.jobs.job import SEQUENCE, Job, entry
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.series import PROCESSOR
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.eval.suite.source import SequenceSource
from eventsweep.eval.suite.speed_kernels import calibration

REPEATS = 3
_VOTES, _CELLS = 60_000_000, 1 << 17


def with_speed(
    result: Results, suite: Suite, cache: Path, archive: SequenceSource | None = None
) -> Results:
    """The result, with the ratio of the suite's speed case; unchanged if that was not run."""
    timed = speed_job(result, suite, cache, archive)
    if timed is None:
        return result
    score, path = timed
    config = MapperConfig.model_validate(score.needs[1].parameters["map"])
    return replace(
        result, speed={score.parameters["case"]: map_ratios(path, config)},
        versions={**result.versions, PROCESSOR: processor()},
    )  # fmt: skip


def speed_job(
    result: Results, suite: Suite, cache: Path, archive: SequenceSource | None = None
) -> tuple[Job, Path] | None:
    """The first scoring job of the suite's speed case, and its sequence; None if it was not run."""
    case = suite.speed_case
    seeds = [s.seed for s in result.samples if s.case == case and s.seed is not None]
    if case is None or not seeds:
        return None
    (score,) = suite_jobs(suite, [case], seeds[:1], archive)
    return score, entry(score.needs[0], Cache(cache)).path / SEQUENCE


def processor() -> str:
    """This machine's, as the system names it."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def map_ratios(sequence: Path, config: MapperConfig) -> tuple[float, ...]:
    """Maps a window again and again; CPU time of each over that of the calibration loop.

    Always with one thread, and once more than is counted. Lower is faster.
    """
    recording = open_recording(sequence)
    single = config.model_copy(update={"threads": 1})
    image = np.zeros(_CELLS, np.float32)

    mapping, loop = partial(map_window, recording, single), partial(calibration, image, _VOTES)
    ratios = [_cpu_s(mapping) / _cpu_s(loop) for _ in range(REPEATS + 1)]
    return tuple(ratios[1:])  # the first one compiled and read the disk


def _cpu_s(work: Callable[[], object]) -> float:
    started_s = time.process_time()
    work()
    return time.process_time() - started_s
