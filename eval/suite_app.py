"""Flags that `suite`, `gate` and `study` share: where jobs run, and which seeds they take."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from emvs.errors import InputError

if TYPE_CHECKING:
    from eval.progress import Progress
    from eval.schedule import Workers
    from eval.suite import Suite
    from eval.suite_rows import SuiteResult

_WHERE = Group("Where jobs run")
_Where = Parameter(group=_WHERE)
_WhereFlag = Parameter(group=_WHERE, negative=())


@Parameter(name="*")
@dataclass(frozen=True)
class Where:
    """Where the jobs of a suite run."""

    workers: Annotated[int | None, _Where] = None
    "Worker processes; by default one for each processor."

    cache: Annotated[Path | None, _Where] = None
    "Folder that keeps what jobs made; by default $EVENTSWEEP_CACHE or the user's cache folder."

    scheduler: Annotated[str | None, _Where] = None
    "Address of a Dask scheduler, tcp://127.0.0.1:8786 or tls://HOST:8786, to run there instead."

    remote: Annotated[bool, _WhereFlag] = False
    "Let --scheduler be another machine over tcp://, neither encrypted nor authenticated."

    tls_ca: Annotated[Path | None, _Where] = None
    "Certificate of the authority, for tls://."

    tls_cert: Annotated[Path | None, _Where] = None
    "Certificate of this side, for tls://."

    tls_key: Annotated[Path | None, _Where] = None
    "Key of that certificate."

    def cache_folder(self) -> Path:
        """The cache's folder, absolute."""
        from eval.cache import default_cache

        return (self.cache or default_cache()).absolute()

    def open(self) -> AbstractContextManager[Workers]:
        """Starts workers, or connects to those of a cluster.

        Raises:
            InputError: no workers asked for, or a scheduler that is not there.
        """
        from eval.cache import Cache

        folder = self.cache_folder()
        if self.scheduler is not None:
            from eval.schedule_dask import Cluster, dask_workers

            files = (self.tls_ca, self.tls_cert, self.tls_key)
            return dask_workers(Cluster(self.scheduler, self.remote, *files), folder)
        from eval.schedule_local import default_workers, local_workers

        count = default_workers() if self.workers is None else self.workers
        if count < 1:
            raise InputError(f"--workers {count}: must be 1 or greater")
        return local_workers(count, Cache(folder).folder)


WHERE = Where()


def numbers(text: str | None, flag: str) -> tuple[int, ...] | None:
    """Seeds from `0,1,5` or `100-109`; None where nothing was given.

    Raises:
        InputError: anything else.
    """
    if text is None:
        return None
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise InputError(f"{flag} {text}: needs numbers such as 0,1,5 or 100-109")
        found += range(int(first), int(last or first) + 1)
    if not found or len(set(found)) != len(found):
        raise InputError(f"{flag} {text}: needs at least one number, each once")
    return tuple(found)


def run(
    suite: Suite,
    subset: str,
    where: Where,
    progress: Progress,
    *,
    seeds: tuple[int, ...] | None = None,
    cases: tuple[str, ...] = (),
    speed: bool = True,
) -> SuiteResult:
    """Runs a suite's subset, and measures the mapper's speed on its first case.

    Args:
        suite: the definition.
        subset: what of it.
        where: where its jobs run.
        progress: shown how far it is.
        seeds: instead of the subset's own.
        cases: some of the subset's.
        speed: whether to measure speed; on this machine, whoever did the jobs.
    """
    from eval.suite_run import run_suite
    from eval.suite_speed import with_speed

    result = run_suite(suite, subset, where.open, progress, seeds=seeds, cases=cases)
    if speed and result.samples:
        with progress.stage("speed", 1):
            result = with_speed(result, suite, where.cache_folder())
    return result
