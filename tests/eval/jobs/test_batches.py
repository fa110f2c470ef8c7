"""Jobs by the batch: the same outcomes as one by one, nothing lost, and no batch that is long."""

import json
import os
import random
import subprocess
import sys
import time
from collections import deque
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import nullcontext

import pytest

from eventsweep.eval.jobs import batches as batches_of_jobs
from eventsweep.eval.jobs.batches import (
    BATCH_S,
    LOSSES,
    MOST,
    Batches,
    BatchWorkers,
    do_batch,
    packed,
    unpacked,
)
from eventsweep.eval.jobs.dask import Cluster, dask_workers
from eventsweep.eval.jobs.job import Done, Failed, Job, code_of, do
from eventsweep.eval.jobs.local import local_workers
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.progress import Silent
from job_stages import runs
from places import HELPERS, ROOT


def done(jobs, cache, code=code_of):
    """What comes back of a batch of jobs."""
    parcel = packed((batches_of_jobs.BATCH_S, [(job, str(cache), code(job)) for job in jobs]))
    return unpacked(do_batch(parcel))[0]


def empty(count):
    return [Job(f"j{k}", "job_stages", {"id": k}) for k in range(count)]


def nothing(sent):
    done = [Done(job.name, "k", "d", 0.0, False, "v") for job, _, _ in unpacked(sent)[1]]
    return packed((done, 0.0))


class Threads(BatchWorkers):
    """Workers that are threads of this process; `do` is what they do of a batch."""

    count = 2
    lost = (CancelledError, TimeoutError)
    final = (KeyError,)

    def __init__(self, cache, do=do_batch):
        super().__init__(cache)
        self.do, self.pool, self.sizes, self.most = do, ThreadPoolExecutor(2), [], 0

    def start(self, stage, sent):
        batch_s, jobs = unpacked(sent)
        self.sizes.append(len(jobs))
        self.batch_s = batch_s
        self.most = max(self.most, len(self.held) + 1)
        return self.pool.submit(self.do, sent)


def run_on(crew, jobs):
    return run_jobs(jobs, lambda: nullcontext(crew), Silent())


def test_every_job_is_in_one_batch_until_it_is_done_whatever_batches_do_not_finish():
    rng, waiting, over, sizes = random.Random(1), Batches(), [], []
    for job in empty(3000):
        waiting.add(job)
    while waiting:
        batch = waiting.next(4)
        count = rng.choice([len(batch), len(batch), rng.randint(1, len(batch))])
        sizes.append(len(batch))
        over += batch[:count]
        waiting.over(batch, count, 0.0)
    assert [job.name for job in over] == [f"j{k}" for k in range(3000)]
    assert sizes[0] == 1 < max(sizes) <= MOST


def test_batches_grow_while_they_are_done_in_time_shrink_at_once_and_leave_others_their_share():
    waiting = Batches()
    for job in empty(100 * MOST):
        waiting.add(job)
    sizes = []
    for _ in range(40):
        batch = waiting.next(4)
        sizes.append(len(batch))
        waiting.over(batch, len(batch), 0.4)
    assert sizes == [min(2**k, MOST) for k in range(40)]
    waiting.over(waiting.next(8), 3, 0.0)
    assert len(waiting.next(8)) == 3
    waiting.over(waiting.next(8), 3, 0.6)
    assert len(waiting.next(8)) == 3
    few = Batches()
    few._size = MOST
    for job in empty(20):
        few.add(job)
    assert [len(few.next(8)) for _ in range(3)] == [3, 3, 2]


def test_a_batch_begins_no_job_after_its_time_and_what_is_cached_takes_none(
    make, log, tmp_path, monkeypatch
):
    monkeypatch.setattr(batches_of_jobs, "BATCH_S", 0.5)
    jobs = [make(name, "sleep", seconds=0.3) for name in "abcd"]
    names = lambda: [one.name for one in done(jobs, tmp_path)]  # noqa: E731
    assert names() == ["a", "b"]
    assert names() == ["a", "b", "c", "d"]
    assert {name: runs(log, name) for name in "abcd"} == dict.fromkeys("abcd", 1)
    assert BATCH_S < 10, "so long a killed scheduler or an interruption may cost every worker"


def test_a_batch_sends_back_no_more_than_a_message_holds(make, tmp_path, monkeypatch):
    monkeypatch.setattr(batches_of_jobs, "_MOST_TEXT", 3)
    jobs = [make(name) for name in ("aa", "bb", "cc")]
    assert len(done(jobs, tmp_path)) == 2


def test_workers_with_other_code_do_nothing(make, log, tmp_path):
    (outcome,) = done([make("a")], tmp_path, lambda _: "other")
    assert "runs different code" in outcome.reason
    assert runs(log, "a") == 0


def test_a_graph_in_batches_is_done_as_in_processes(make, log, tmp_path, monkeypatch):
    monkeypatch.setattr(Threads, "least", 3)
    first = [make(f"a{k}") for k in range(60)]
    jobs = [make(f"b{k}", needs=(first[k], first[k - 1])) for k in range(60)]
    jobs += [make("x", "fail"), make("y", needs=(make("z", "refuse"),)), make("w", "fail once")]
    crew = Threads(tmp_path / "batches")
    ours = run_on(crew, jobs)
    theirs = run_jobs(jobs[:60], lambda: local_workers(1, tmp_path / "local"), Silent())
    assert {name: ours[name].digest for name in theirs} == {
        name: one.digest for name, one in theirs.items()
    }
    assert ours["x"].reason == "ZeroDivisionError: as asked"
    assert ours["y"].reason == "not started: 3 came, needs 4: add one"
    assert isinstance(ours["w"], Done)
    assert [runs(log, name) for name in ("x", "w", "z")] == [2, 2, 1]
    assert max(crew.sizes) > 1


def test_few_batches_are_handed_over_at_a_time_and_each_has_many_of_many_jobs(tmp_path):
    crew = Threads(tmp_path, nothing)
    assert len(run_on(crew, empty(20_000))) == 20_000
    assert crew.most <= crew.least
    assert len(crew.sizes) < 20_000 / 40


@pytest.mark.parametrize(("workers", "batch_s"), [(1, BATCH_S), (50, BATCH_S), (1000, 10.0)])
def test_many_workers_get_batches_of_more_time_so_that_a_scheduler_passes_on_a_hundred_a_second(
    tmp_path, monkeypatch, workers, batch_s
):
    monkeypatch.setattr(Threads, "count", workers)
    crew = Threads(tmp_path, nothing)
    run_on(crew, empty(10))
    assert crew.batch_s == batch_s


class Losing(BatchWorkers):
    """Does a batch at once, but loses what came of it the first times."""

    count = 1
    lost = (CancelledError, TimeoutError)

    def __init__(self, cache, losses):
        super().__init__(cache)
        self.losses = deque(losses)

    def start(self, stage, sent):
        future = Future()
        if self.losses:
            future.set_exception(self.losses.popleft())
        else:
            future.set_result(do_batch(sent))
        return future


def test_what_is_lost_on_its_way_is_no_try_of_the_job_but_is_bounded(make, tmp_path):
    def outcome(*losses):
        crew = Losing(tmp_path / "cache", losses)
        return run_on(crew, [make("a")])["a"], len(losses) - len(crew.losses)

    for kind in (CancelledError, TimeoutError):
        one, _ = outcome(*[kind()] * LOSSES)
        assert type(one) is Done
        one, used = outcome(*[kind()] * 99)
        assert (type(one), used) == (Failed, LOSSES + 2)
        assert one.reason.startswith(kind.__name__)
    one, used = outcome(*[OSError("no such weights")] * 99)
    assert (one.reason, used) == ("OSError: no such weights", 2)


@pytest.mark.parametrize(("error", "tries"), [(KeyError("killed"), 1), (OSError("odd"), 2)])
def test_of_a_batch_that_fails_every_job_is_done_alone_and_only_the_bad_one_fails(
    tmp_path, error, tries
):
    alone = []

    def unless_bad(sent):
        names = [job.name for job, _, _ in unpacked(sent)[1]]
        if "j700" in names:
            alone.append(len(names) == 1)
            raise error
        return nothing(sent)

    crew = Threads(tmp_path, unless_bad)
    outcomes = run_on(crew, empty(2000))
    assert [name for name, one in outcomes.items() if isinstance(one, Failed)] == ["j700"]
    assert outcomes["j700"].reason.startswith(type(error).__name__)
    assert alone == [False] + [True] * tries


def test_batches_of_which_nothing_can_come_any_more_are_handed_over_again(tmp_path):
    class Forgetful(Threads):
        """The first batches get lost without a word, as with a scheduler."""

        def start(self, stage, sent):
            return super().start(stage, sent) if self.found else Future()

        found = False

        def check(self):
            if self.held and not self.found:
                self.found = True
                self.take_back()

    crew = Forgetful(tmp_path, nothing)
    assert len(run_on(crew, empty(500))) == 500
    assert sum(crew.sizes) == 500


# On a cluster


@pytest.fixture
def cluster(tmp_path):
    """A scheduler with one worker, processes of their own."""
    file = tmp_path / "scheduler.json"
    env = {**os.environ, "PYTHONPATH": f"{HELPERS}{os.pathsep}{ROOT}"}
    started = []

    def start(what, *words):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard"]
        command += ["--scheduler-file", str(file), "--host", "127.0.0.1", *words]
        started.append(subprocess.Popen(command, env=env, stderr=subprocess.DEVNULL))

    def worker():
        start("worker", "--nthreads", "1", "--no-nanny")

    start("scheduler", "--port", "0")
    end_s = time.monotonic() + 30
    while not file.exists():
        assert time.monotonic() < end_s, "no scheduler"
        time.sleep(0.05)
    worker()
    yield Cluster(json.loads(file.read_text())["address"]), worker
    for one in started:
        one.kill()
        one.wait()


@pytest.mark.slow
def test_programs_at_one_scheduler_get_what_they_asked_for_though_jobs_have_one_name(
    cluster, make, tmp_path
):
    """To Dask tasks of one key are one."""
    place, _ = cluster
    asked = [Job("a", "job_stages", {"id": word, "log": str(tmp_path / word)}) for word in "xy"]
    with dask_workers(place, tmp_path / "1") as one, dask_workers(place, tmp_path / "2") as other:
        for crew, job in zip((one, other), asked, strict=True):
            crew.submit(job)
        both = []
        for crew in (one, other):
            over = []
            while not over:
                over = crew.wait(1.0)
            both += over
    assert [outcome.text for outcome in both] == ["x", "y"]


@pytest.mark.slow
def test_of_a_batch_whose_worker_is_killed_only_the_job_in_progress_begins_again(
    cluster, make, log, tmp_path
):
    place, worker = cluster
    worker()
    jobs = [make(f"j{k}", "die once" if k == 250 else "write") for k in range(300)]
    outcomes = run_jobs(jobs, lambda: dask_workers(place, tmp_path / "cache"), Silent())
    assert all(isinstance(one, Done) for one in outcomes.values()), outcomes
    assert {job.name: runs(log, job.name) for job in jobs} == {
        job.name: 2 if job.name == "j250" else 1 for job in jobs
    }
    assert do(jobs[0], str(tmp_path / "cache")).found
