"""Runs a suite, or a subset of one, as a graph of jobs, and measures the mapper's speed.

Seconds say as much about the machine, and who else uses it, as about the mapper. So a fixed loop is
timed beside it, which does what a mapper does: arithmetic and scattered additions into an image
that fits no first-level cache. Both are counted in CPU time of one thread, one right after the
other, and the ratio is kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.found_poses import TRACK
from eventsweep.eval.jobs.job import SEQUENCE, Done, Failed, Job, Outcome, entry
from eventsweep.eval.jobs.scheduler import Open, run_jobs
from eventsweep.eval.pipeline import check_case
from eventsweep.eval.progress import Display
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.scoring.results import together
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.predictions import assignment, open_predictions
from eventsweep.eval.suite.results import JobNote, Sample, SuiteResult, sample_from
from eventsweep.eval.suite.source import SequenceSource, simulated
from eventsweep.eval.suite.speed_kernels import calibration
from eventsweep.eval.trackers import tracker
from eventsweep.sim.config import SimConfig

if TYPE_CHECKING:
    import pandas as pd

REPEATS = 3
_VOTES, _CELLS = 60_000_000, 1 << 17


def run_suite(
    suite: Suite, subset: str, workers: Open, progress: Display, *,
    seeds: Sequence[int] | None = None, cases: Sequence[str] | None = None,
    predictions: Sequence[NamedFolder] = (), archive: SequenceSource | None = None,
) -> SuiteResult:  # fmt: skip
    """Does all jobs of a suite's subset, or of some of its cases and other seeds.

    Failed jobs are in the result. Depth maps in the folders of predictions are scored beside the
    suite's methods; sequences are those of the archive, or simulated.
    """
    its_cases, its_seeds = extent(suite, subset, seeds, cases, archive)
    jobs = suite_jobs(suite, its_cases, its_seeds, archive)
    asked = [assignment(suite, job.parameters["case"], job.parameters["seed"]) for job in jobs]
    others = open_predictions(predictions, suite, asked)
    jobs += [other.job(job) for job in jobs for other in others]
    outcomes = run_jobs(jobs, workers, progress)
    samples, rows = _scored(jobs, outcomes)
    return SuiteResult(
        suite=suite.name,
        subset=subset,
        digest=suite.digest,
        definition=suite.model_dump(mode="json"),
        cases={case: suite.digest_of(case) for case in its_cases},
        seeds=its_seeds,
        samples=samples,
        rows=rows,
        jobs=tuple(_note(outcome) for outcome in outcomes.values()),
        predictions={other.name: other.digest for other in others},
        archive=archive.facts if archive else None,
    )


def extent(
    suite: Suite, subset: str, seeds: Sequence[int] | None, cases: Sequence[str] | None,
    archive: SequenceSource | None = None,
) -> tuple[tuple[str, ...], tuple[int, ...]]:  # fmt: skip
    """The cases and seeds of a run: some of a subset's cases, its seeds or others.

    Of an archive by default those of its seeds that the subset has, of a hidden one all.
    """
    chosen = suite.subset(subset)
    its_cases = _chosen(chosen.cases, cases)
    if seeds is None:
        seeds = archive.seeds(its_cases, chosen.seeds) if archive else chosen.seeds
    return its_cases, tuple(seeds)


def _chosen(known: Sequence[str], wanted: Sequence[str] | None) -> tuple[str, ...]:
    for case in wanted or ():
        if case not in known:
            raise InputError(f"no case {case!r} here: choose from {', '.join(known)}")
    return tuple(case for case in known if not wanted or case in wanted)


def _scored(
    jobs: Sequence[Job], outcomes: Mapping[str, Outcome]
) -> tuple[tuple[Sample, ...], pd.DataFrame]:
    texts = [done.text for job in jobs if isinstance(done := outcomes[job.name], Done)]
    scored = [sample_from(text) for text in texts if text]
    samples = {(sample.case, sample.seed): sample for sample, _ in reversed(scored)}
    order = list(dict.fromkeys((sample.case, sample.seed) for sample, _ in scored))
    scored.sort(key=lambda pair: order.index((pair[0].case, pair[0].seed)))
    return tuple(samples[key] for key in order), together(rows for _, rows in scored)


def _note(outcome: Outcome) -> JobNote:
    if isinstance(outcome, Failed):
        return JobNote(outcome.name, failure=outcome.reason)
    return JobNote(
        outcome.name, outcome.key, outcome.code, round(outcome.seconds, 3), outcome.found,
        cpu_seconds=round(outcome.cpu_seconds, 3),
    )  # fmt: skip


def suite_jobs(
    suite: Suite, cases: Sequence[str], seeds: Sequence[int], archive: SequenceSource | None = None
) -> list[Job]:
    """One scoring job per case and seed, with all that it needs."""
    for case in cases:
        _check(suite, case)
    source = archive.sequence if archive else simulated
    return [
        _score_job(suite, case, seed, *source(suite, case, seed))
        for seed in seeds
        for case in cases
    ]


def _check(suite: Suite, case: str) -> None:
    """Refuses before the first job what would fail in the last."""
    spec = suite.cases[case]
    for mapper in spec.mappers:
        config = MapperConfig.model_validate(suite.mappers[mapper])
        sim = SimConfig.model_validate(suite.sim_of(spec))
        check_case(spec.scene, spec.rig, config, sim, track=spec.track)


def _score_job(suite: Suite, case: str, seed: int, sequence: Job, digest: str) -> Job:
    spec, place = suite.cases[case], f"{case}/seed{seed}"
    # Only where there is any: the keys of other jobs stay what they were.
    wrong = {"perturb": spec.imperfection, "seed": seed} if spec.imperfection else {}
    maps, mappers = [], []
    for mapper in spec.mappers:
        for number, window in enumerate(spec.windows):
            times = {"start_s": window.start_s, "duration_s": window.duration_s}
            name = f"w{number:03d}"
            mapping = {"window": name, "map": {**suite.mappers[mapper], **times}, **wrong}
            maps.append(
                Job(
                    f"map/{place}/{mapper}/{name}",
                    "eventsweep.eval.suite.stages.map",
                    mapping,
                    (sequence,),
                )
            )
            mappers.append(mapper)
    wanted = {
        "case": case,
        "seed": seed,
        "mappers": mappers,
        "score": suite.score,
        "scene_digest": digest,
    }
    tracked = (track_job(place, sequence, maps, mappers, wrong),) if spec.track else ()
    more = {"track": True} if spec.track else {}
    needs = (sequence, *maps, *tracked)
    return Job(f"score/{place}", "eventsweep.eval.suite.stages.score", {**wanted, **more}, needs)


def track_job(
    place: str, sequence: Job, maps: Sequence[Job], mappers: Sequence[str],
    wrong: Mapping[str, Any], name: str = TRACK,
) -> Job:  # fmt: skip
    """The job by which a tracker finds a sequence's poses, and maps on them as `maps` do."""
    settings: dict[str, dict[str, Any]] = {}
    for job, mapper in zip(maps, mappers, strict=True):
        settings.setdefault(mapper, {})[job.parameters["window"]] = job.parameters["map"]
    wanted = {"track": {}, "maps": settings, **wrong}
    return Job(f"track/{place}", tracker(name).STAGE, wanted, (sequence,))


def with_speed(
    result: SuiteResult, suite: Suite, cache: Path, archive: SequenceSource | None = None
) -> SuiteResult:
    """The result, with the ratio of the suite's speed case; unchanged if that was not run."""
    timed = speed_job(result, suite, cache, archive)
    if timed is None:
        return result
    score, path = timed
    config = MapperConfig.model_validate(score.needs[1].parameters["map"])
    return replace(result, speed={score.parameters["case"]: map_ratios(path, config)})


def speed_job(
    result: SuiteResult, suite: Suite, cache: Path, archive: SequenceSource | None = None
) -> tuple[Job, Path] | None:
    """The first scoring job of the suite's speed case, and its sequence; None if it was not run."""
    case = suite.speed_case
    seeds = [sample.seed for sample in result.samples if sample.case == case]
    if case is None or not seeds:
        return None
    (score,) = suite_jobs(suite, [case], seeds[:1], archive)
    return score, entry(score.needs[0], Cache(cache)).path / SEQUENCE


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
