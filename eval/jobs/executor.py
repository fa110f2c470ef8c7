"""Jobs on any `concurrent.futures.Executor`: threads, processes, MPI, loky, Ray, Parsl."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.jobs.batches import Batch, BatchWorkers, Result, do_batch
from eventsweep.eval.jobs.job import Outcome

_HELD = 1024  # batches: how many workers an executor has need not be known
_ANEW = "open a new one and call again; finished jobs are in the cache"


class ExecutorWorkers(BatchWorkers):
    """Those of an executor, which stays open.

    Attributes:
        count: how many work at once, as its owner says: only the time left depends on it.
    """

    count: int = 1
    lost = (CancelledError, TimeoutError)
    least = _HELD

    def __init__(self, executor: Executor, cache: Path, count: int = 1) -> None:
        super().__init__(cache)
        self._executor, self.count = executor, count

    def start(self, stage: str, parcel: bytes) -> Result:  # noqa: ARG002 (only Dask needs it)
        """Hands over a batch."""
        try:
            return self._executor.submit(do_batch, parcel)
        except RuntimeError as error:  # shut down, or broken
            raise InputError(f"the executor takes no job ({_words(error)}): {_ANEW}") from error

    def failed(self, batch: Batch, error: Exception) -> list[Outcome]:
        """As of any batch, but nothing can come of an executor that is broken."""
        if isinstance(error, BrokenExecutor):
            reason = _words(error) or "a worker died"
            raise InputError(f"the executor is broken ({reason}): {_ANEW}") from error
        return super().failed(batch, error)

    def end(self) -> None:
        """Takes back the jobs that did not begin."""
        for _, future in self.held.values():
            cancel = getattr(future, "cancel", None)
            if cancel is not None:
                cancel()


@contextmanager
def executor_workers(executor: Executor, cache: Path, count: int = 1) -> Iterator[ExecutorWorkers]:
    """Workers of an executor; what did not begin is taken back if the work ends before it."""
    workers = ExecutorWorkers(executor, cache, count)
    try:
        yield workers
    finally:
        workers.end()


def _words(error: Exception) -> str:
    return " ".join(str(error).split())
