"""A job: one stage with its parameters and the jobs that it needs; and how it is done.

A job is a value. It names its stage, so any process can do it; what it makes is kept in the cache
under a key that says all that decides it, so nothing is made twice.
"""

from __future__ import annotations

import importlib
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache as once
from pathlib import Path
from types import ModuleType
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, CacheEntry, key_of
from eventsweep.emvs.utils.runtime import versions
from eventsweep.eval.jobs.code_version import code_version
from eventsweep.eval.progress import SILENT, Display

SEQUENCE, MAP = "sequence", "map"
"""Folders that jobs leave."""
NOT_YET = "not done yet"
"""Why a job is missing where nothing was to be run."""
RESULT = "result.json"
"""A file whose text travels back with the job's outcome."""


@dataclass(frozen=True)
class Runtime:
    """With what a stage does its work; decides nothing of the outcome.

    Attributes:
        renderers: processes that draw.
        all_threads: whether the mapper uses as many threads as its settings say, or one.
        display: shows how far it is.
        unfinished: a folder for what an interrupted stage can go on from, if it makes one.
    """

    renderers: int = 1
    all_threads: bool = False
    display: Display = SILENT
    unfinished: Path | None = None

    def threads(self) -> dict[str, int]:
        """The mapper's setting."""
        return {} if self.all_threads else {"threads": 1}


ONE_OF_MANY = Runtime()
"""Of a worker beside others: one thread, silent."""


@dataclass(frozen=True)
class Job:
    """One piece of work.

    Attributes:
        name: unique in its graph, such as `map/desk/seed0/w000`.
        stage: module of the stage. Its `run(parameters, inputs, out, runtime)` writes the job's
            files into `out`, an empty folder; inputs are the folders of `needs`, then `sources`.
            Its `code(parameters)`, where it has one, names the modules and files that it reaches by
            computed names.
        parameters: plain JSON values; with the code and the inputs, all that decides the outcome.
        needs: jobs whose files this one reads.
        sources: paths outside the cache that the stage reads as well. Where they lie decides
            nothing: the parameters hold the hashes of what is read.
    """

    name: str
    stage: str
    parameters: Mapping[str, Any]
    needs: tuple[Job, ...] = ()
    sources: tuple[str, ...] = ()


@dataclass(frozen=True)
class Done:
    """A job that was done, or found done.

    Attributes:
        key: its entry in the cache.
        digest: hash of what it made.
        seconds: what making it took, whenever that was, s.
        found: whether the cache had it.
        code: version of the code that made it.
        text: the content of `result.json`, where the job made one.
    """

    name: str
    key: str
    digest: str
    seconds: float
    found: bool
    code: str
    text: str | None = None
    cpu_seconds: float = 0.0


@dataclass(frozen=True)
class Failed:
    """A job that was not done.

    Attributes:
        reason: in one line.
        log: where the error came from, if its code did not foresee it.
        again: whether another try may end otherwise; bad input stays bad.
    """

    name: str
    reason: str
    log: str = ""
    again: bool = False


Outcome = Done | Failed


def do(job: Job, cache_folder: str) -> Outcome:
    """Does a job, unless the cache has it; failures are reported, never raised.

    Inputs that are lost or damaged are made again, here.
    """
    try:
        made = entry(job, Cache(Path(cache_folder)))
        text = _text(made)
    except InputError as error:
        return Failed(job.name, str(error))
    except (OSError, MemoryError) as error:
        return Failed(job.name, _one_line(error), traceback.format_exc(), again=True)
    except Exception as error:  # a job that fails must not stop the others
        reason = f"{type(error).__name__}: {_one_line(error)}"
        return Failed(job.name, reason, traceback.format_exc(), again=True)
    return _done(job, made, text)


def find(job: Job, cache: Cache, digests: Mapping[str, str]) -> Done | None:
    """The outcome of a job that was done before, if the cache has it; does nothing otherwise.

    `digests` says by name what the jobs made that this one needs.
    """
    made = cache.find(key_of(_facts(job, [digests[need.name] for need in job.needs])))
    return None if made is None else _done(job, made, _text(made))


def stored(job: Job, cache: Cache) -> CacheEntry | None:
    """What a job made, if the cache has it and all that it needs; does nothing otherwise."""
    made: dict[str, CacheEntry] = {}
    for one in order([job]):
        found = cache.find(key_of(_facts(one, [made[need.name].digest for need in one.needs])))
        if found is None:
            return None
        made[one.name] = found
    return made[job.name]


def entry(job: Job, cache: Cache, runtime: Runtime = ONE_OF_MANY) -> CacheEntry:
    """Finds or makes what a job makes, and all that it needs, each once; errors pass through."""
    made: dict[str, CacheEntry] = {}
    for one in order([job]):
        made[one.name] = _entry(one, [made[need.name] for need in one.needs], cache, runtime)
    return made[job.name]


def _entry(job: Job, inputs: Sequence[CacheEntry], cache: Cache, runtime: Runtime) -> CacheEntry:
    facts, stage = _facts(job, [made.digest for made in inputs]), _stage(job)
    paths = [*(made.path for made in inputs), *map(Path, job.sources)]
    key = key_of(facts)
    place = cache.path_of(key)
    own = replace(runtime, unfinished=place.with_name(f"{key}.unfinished"))
    return cache.get(key, facts, lambda out: stage.run(job.parameters, paths, out, own))


def _facts(job: Job, inputs: Sequence[str]) -> dict[str, Any]:
    """All that decides what a job makes."""
    return {
        "stage": job.stage,
        "parameters": dict(job.parameters),
        "code": code_of(job),
        "inputs": list(inputs),
        "versions": _libraries(),
    }


def _done(job: Job, made: CacheEntry, text: str | None) -> Done:
    return Done(
        job.name, made.key, made.digest, made.seconds, made.found, code_of(job), text,
        made.cpu_seconds,
    )  # fmt: skip


def _text(made: CacheEntry) -> str | None:
    result = made.path / RESULT
    return result.read_text(encoding="utf-8") if result.is_file() else None


def code_of(job: Job) -> str:
    """Version of the code that a job runs."""
    code = getattr(_stage(job), "code", None)
    modules, files = code(job.parameters) if code else ((), ())
    return _version((job.stage, *modules), tuple((path, path.stat().st_mtime_ns) for path in files))


def order(jobs: Iterable[Job]) -> list[Job]:
    """The jobs and all that they need, each once, what is needed before what needs it."""
    found: dict[str, Job] = {}

    def place(job: Job) -> None:
        if job.name not in found:
            for need in job.needs:
                place(need)
            found[job.name] = job

    for job in jobs:
        place(job)
    return list(found.values())


def _stage(job: Job) -> ModuleType:
    return importlib.import_module(job.stage)


@once
def _version(modules: tuple[str, ...], files: tuple[tuple[Path, int], ...]) -> str:
    """Of files with the times of their last change: weights may change while this runs."""
    return code_version(modules, [path for path, _ in files])


@once
def _libraries() -> dict[str, str]:
    return {name: version for name, version in versions().items() if name != "eventsweep"}


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
