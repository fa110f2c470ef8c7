"""What `suite`, `gate` and `study` share: flags that say where jobs run, seeds, and the run."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from emvs.errors import InputError

if TYPE_CHECKING:
    from eval.jobs.scheduler import Workers
    from eval.progress import Progress
    from eval.suite.definition import Suite
    from eval.suite.results import SuiteResult

_GROUP = Group("Where jobs run")
_JobFlag = Parameter(group=_GROUP)
_JobSwitch = Parameter(group=_GROUP, negative=())


@Parameter(name="*")
@dataclass(frozen=True)
class JobFlags:
    """Where the jobs of a suite run."""

    workers: Annotated[int | None, _JobFlag] = None
    "Worker processes; by default one for each processor."

    cache: Annotated[Path | None, _JobFlag] = None
    "Folder that keeps what jobs made; by default $EVENTSWEEP_CACHE or the user's cache folder."

    scheduler: Annotated[str | None, _JobFlag] = None
    "Address of a Dask scheduler, tcp://127.0.0.1:8786 or tls://HOST:8786, to run there instead."

    remote: Annotated[bool, _JobSwitch] = False
    "Let --scheduler be another machine over tcp://, neither encrypted nor authenticated."

    tls_ca: Annotated[Path | None, _JobFlag] = None
    "Certificate of the authority, for tls://."

    tls_cert: Annotated[Path | None, _JobFlag] = None
    "Certificate of this side, for tls://."

    tls_key: Annotated[Path | None, _JobFlag] = None
    "Key of that certificate."

    def cache_folder(self) -> Path:
        """The cache's folder, absolute."""
        from emvs.utils.cache import default_cache

        return (self.cache or default_cache()).absolute()

    def open(self) -> AbstractContextManager[Workers]:
        """Starts workers, or connects to those of a cluster.

        Raises:
            InputError: no workers asked for, or a scheduler that is not there.
        """
        from emvs.utils.cache import Cache

        folder = self.cache_folder()
        if self.scheduler is not None:
            from eval.jobs.dask import Cluster, dask_workers

            files = (self.tls_ca, self.tls_cert, self.tls_key)
            return dask_workers(Cluster(self.scheduler, self.remote, *files), folder)
        from eval.jobs.local import default_workers, local_workers

        count = default_workers() if self.workers is None else self.workers
        if count < 1:
            raise InputError(f"--workers {count}: must be 1 or greater")
        return local_workers(count, Cache(folder).folder)


JOB_FLAGS = JobFlags()


def seed_numbers(text: str | None, flag: str) -> tuple[int, ...] | None:
    """Seeds from `0,1,5` or `100-109`; None where nothing was said.

    Raises:
        InputError: anything else.
    """
    if text is None:
        return None
    seeds: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise InputError(f"{flag} {text}: needs numbers such as 0,1,5 or 100-109")
        seeds += range(int(first), int(last or first) + 1)
    if not seeds or len(set(seeds)) != len(seeds):
        raise InputError(f"{flag} {text}: needs at least one number, each once")
    return tuple(seeds)


def run_with_flags(
    suite: Suite,
    subset: str,
    flags: JobFlags,
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
        flags: where its jobs run.
        progress: shown how far it is.
        seeds: instead of the subset's own.
        cases: some of the subset's.
        speed: whether to measure speed; on this machine, whoever did the jobs.
    """
    from eval.suite.run import run_suite, with_speed

    result = run_suite(suite, subset, flags.open, progress, seeds=seeds, cases=cases)
    if speed and result.samples:
        with progress.stage("speed", 1):
            result = with_speed(result, suite, flags.cache_folder())
    return result
