"""What `suite`, `gate` and `study` share: flags that say where jobs run, seeds, and the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import JOBS
from eventsweep.eval.cli.help import RARE

if TYPE_CHECKING:
    from eventsweep.eval.jobs.scheduler import Open, Workers
    from eventsweep.eval.progress import Display
    from eventsweep.eval.results.results import Results
    from eventsweep.eval.scoring.predictions import NamedFolder
    from eventsweep.eval.suite.definition import Suite
    from eventsweep.eval.suite.source import SequenceSource

_JobFlag = Parameter(group=JOBS)
_JobSwitch = Parameter(group=JOBS, negative=())


@Parameter(name="*")
@dataclass(frozen=True)
class CacheFlags:
    """Where jobs keep what they made, and which cluster does them, if one does."""

    cache: Annotated[Path | None, _JobFlag, RARE] = None
    "Folder where results of jobs are kept; by default $EVENTSWEEP_CACHE or your cache folder."

    scheduler: Annotated[str | None, _JobFlag, RARE] = None
    "Address of a Dask scheduler to run the jobs on, such as tls://scheduler.example:8786."

    remote: Annotated[bool, _JobSwitch, RARE] = False
    "Allow another machine over tcp://, which is neither encrypted nor authenticated."

    tls_ca: Annotated[Path | None, _JobFlag, RARE] = None
    "Certificate of the certificate authority, for tls://."

    tls_cert: Annotated[Path | None, _JobFlag, RARE] = None
    "Certificate of this machine, for tls://."

    tls_key: Annotated[Path | None, _JobFlag, RARE] = None
    "Key of that certificate."

    def check(self) -> None:
        """Refuses flags of a cluster without one."""
        if self.scheduler is None and (self.remote or self.tls_ca or self.tls_cert or self.tls_key):
            raise InputError(
                "--remote and --tls-... without --scheduler: they say how to reach one; add it"
            )

    def cache_folder(self) -> Path:
        """The cache's folder, absolute."""
        from eventsweep.emvs.utils.cache import default_cache

        return (self.cache or default_cache()).absolute()

    def cluster(self) -> AbstractContextManager[Workers]:
        """Connects to the workers of the scheduler."""
        from eventsweep.emvs.utils.cache import Cache
        from eventsweep.eval.jobs.dask import Cluster, dask_workers

        files = (self.tls_ca, self.tls_cert, self.tls_key)
        folder = Cache(self.cache_folder()).folder
        return dask_workers(Cluster(str(self.scheduler), self.remote, *files), folder)


@Parameter(name="*")
@dataclass(frozen=True)
class JobFlags(CacheFlags):
    """Where the jobs of a suite run."""

    workers: Annotated[int | None, _JobFlag] = None
    "Worker processes; by default one per processor."

    cache: Annotated[Path | None, _JobFlag] = None
    "Folder where results of jobs are kept; by default $EVENTSWEEP_CACHE or your cache folder."

    def check(self) -> None:
        """Refuses flags of a cluster without one, and of this machine where there is one."""
        super().check()
        if self.scheduler is not None and self.workers is not None:
            raise InputError("--workers with --scheduler: the cluster has its own; leave it out")
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers {self.workers}: must be 1 or greater")

    def open(self) -> AbstractContextManager[Workers]:
        """Starts workers, or connects to those of a cluster."""
        from eventsweep.emvs.utils.cache import Cache
        from eventsweep.eval.jobs.local import default_workers, local_workers

        self.check()
        if self.scheduler is not None:
            return self.cluster()
        count = default_workers() if self.workers is None else self.workers
        return local_workers(count, Cache(self.cache_folder()).folder)

    def found(self) -> AbstractContextManager[Workers]:
        """Looks for what is done already."""
        from eventsweep.emvs.utils.cache import Cache
        from eventsweep.eval.jobs.local import FoundJobs

        return nullcontext(FoundJobs(Cache(self.cache_folder()).folder))


@Parameter(name="*")
@dataclass(frozen=True)
class MapJobFlags(JobFlags):
    """Where sliding windows are mapped: here, one after another, unless a flag says otherwise."""

    workers: Annotated[int | None, _JobFlag, RARE] = None
    "Worker processes that map sliding windows, a thread each; by default they are mapped here."

    cache: Annotated[Path | None, _JobFlag, RARE] = None
    "Folder where windows that workers map are kept; by default that of suites."

    def crew(self, *, slides: bool) -> Open | None:
        """What opens the workers, if there are any."""
        self.check()
        if self.workers is None and self.scheduler is None:
            return None
        if not slides:
            flag = "--workers" if self.scheduler is None else "--scheduler"
            raise InputError(
                f"{flag} maps sliding windows: add --map.window-s or --map.window-events, or leave "
                "it out: one window is mapped here, by all threads"
            )
        return self.open


CACHE_FLAGS = CacheFlags()
JOB_FLAGS = JobFlags()
MAP_JOB_FLAGS = MapJobFlags()


def seed_numbers(text: str | None, flag: str) -> tuple[int, ...] | None:
    """Seeds from `0,1,5` or `100-109`; None where nothing was said."""
    if text is None:
        return None
    seeds: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise InputError(f"{flag} {text}: needs numbers such as 0,1,5 or 100-109")
        seeds += range(int(first), int(last or first) + 1)
    if not seeds or len(set(seeds)) != len(seeds):
        raise InputError(f"{flag} {text}: needs at least one number, without repeats")
    return tuple(seeds)


def run_with_flags(
    suite: Suite, subset: str, flags: JobFlags, progress: Display, *,
    seeds: tuple[int, ...] | None = None, cases: tuple[str, ...] = (), speed: bool = True,
    predictions: Sequence[NamedFolder] = (), archive: SequenceSource | None = None,
    so_far: bool = False,
) -> Results:  # fmt: skip
    """Runs a suite's subset; `speed` times the mapper on its first case, always on this machine.

    With `so_far` nothing runs: the result is of the jobs that the cache has.
    """
    from eventsweep.eval.progress import SILENT
    from eventsweep.eval.suite.run import run_suite
    from eventsweep.eval.suite.speed import with_speed

    result = run_suite(
        suite, subset, flags.found if so_far else flags.open, SILENT if so_far else progress,
        seeds=seeds, cases=cases, predictions=predictions, archive=archive,
    )  # fmt: skip
    if speed and result.samples and not so_far:
        with progress.stage("speed", 1):
            result = with_speed(result, suite, flags.cache_folder(), archive)
    return result
