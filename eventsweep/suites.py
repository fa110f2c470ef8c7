"""Suites for users of the library: a definition, a folder of results, and a paper's table."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from eventsweep.emvs.errors import InputError, check_path
from eventsweep.emvs.utils.cache import Cache, default_cache
from eventsweep.eval.jobs.executor import executor_workers
from eventsweep.eval.jobs.local import default_workers, local_workers
from eventsweep.eval.jobs.scheduler import Open
from eventsweep.eval.progress import SILENT
from eventsweep.eval.report.method_table import method_table, write_table
from eventsweep.eval.results.results import Results
from eventsweep.eval.suite import output
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.packages import Wanted, open_packages
from eventsweep.eval.suite.plan import extent
from eventsweep.eval.suite.run import run_suite as run_jobs_of

__all__ = ["method_table", "run_suite", "write_table"]


def run_suite(
    suite: str | Path, out: str | Path, *, seeds: Sequence[int] | None = None,
    cases: Sequence[str] = (), workers: int | None = None, cache: str | Path | None = None,
    force: bool = False, executor: Executor | None = None,
) -> Results:  # fmt: skip
    """Runs a suite and writes `suite.json` and `suite.csv`; finished jobs come from the cache.

    Workers import the calling script: its calls must stand below `if __name__ == "__main__":`.

    Args:
        suite: a name such as `quick`, or the path of a definition; see the page `suite`.
        out: folder to write.
        seeds: by default the suite's own.
        cases: the only ones to run; by default all.
        workers: processes, by default one per processor; of an executor as many as it has, by
            which the time left is judged.
        cache: folder of finished jobs; by default that of the command line.
        force: whether a result that is there is replaced.
        executor: where jobs run instead, such as one of threads, MPI, Ray or Parsl; it stays open.
            Its workers need this version of the code, a thread each, and the cache's folder.

    Returns:
        All numbers, of all cases and seeds, and what became of each job.

    Raises:
        InputError: an unknown suite or case, a definition or file that cannot be used, or a folder
            that is there.
    """
    check_path("out", out)
    definition, subset = load(str(suite))
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}: must be 1 or greater")
    store = Cache(Path(cache) if cache is not None else default_cache())
    count = default_workers() if workers is None else workers
    crew: Open = partial(local_workers, count, store.folder)
    if executor is not None:
        crew = partial(executor_workers, executor, store.folder, count)
    wanted = Wanted(definition, *extent(definition, subset, seeds, cases))
    depths, stated = open_packages((), wanted, store)
    with output.prepare_folder(Path(out), force=force) as folder:
        results = run_jobs_of(
            definition, subset, crew, SILENT,
            seeds=seeds, cases=cases, predictions=depths,
        )  # fmt: skip
        results = replace(results, stated=stated)
        output.write(folder, results, force=force)
    return results
