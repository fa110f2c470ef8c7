"""Jobs: nothing twice, nothing lost, and no failure that stops the others."""

import cProfile
import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from concurrent.futures import (
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import nullcontext
from pathlib import Path

import pytest

from eventsweep.emvs.utils.cache import Cache, key_of
from eventsweep.emvs.utils.files import MARK
from eventsweep.eval.jobs import code_version as versions_of_code
from eventsweep.eval.jobs import dask as schedule_dask
from eventsweep.eval.jobs.batches import LOSSES
from eventsweep.eval.jobs.code_version import closure, code_version, definition_digest
from eventsweep.eval.jobs.dask import Cluster, dask_workers
from eventsweep.eval.jobs.executor import executor_workers
from eventsweep.eval.jobs.job import NOT_YET, RESULT, Done, Failed, Job, do, order, stored
from eventsweep.eval.jobs.local import ATTEMPTS, FoundJobs, local_workers
from eventsweep.eval.jobs.scheduler import JobBoard, run_jobs
from eventsweep.eval.progress import Silent
from eventsweep.sim.mjcf import files_of
from job_stages import runs
from places import HELPERS, ROOT
from refusals import line_of


def run_here(jobs, folder, count=2):
    return run_jobs(jobs, lambda: local_workers(count, folder), Silent())


def test_workers_have_one_thread_from_the_start_and_keep_it(make, tmp_path):
    """Numba reads the number when it is loaded, and refuses another when it next compiles."""
    before = dict(os.environ)
    outcomes = run_here([make("a", "threads")], tmp_path / "cache", count=1)
    assert isinstance(outcomes["a"], Done), outcomes
    assert dict(os.environ) == before


# The cache
def write(text):
    return lambda out: (out / "a").write_text(text)


def refuse_to_fill(out):
    raise AssertionError("must not be made again")


def test_an_entry_is_made_once_and_keys_tell_facts_apart(tmp_path):
    cache = Cache(tmp_path)
    made = cache.get(key_of("k1"), "k1", write("one"))
    again = cache.get(key_of("k1"), "k1", refuse_to_fill)
    assert (made.found, again.found, made.digest) == (False, True, again.digest)
    assert (again.path / "a").read_text() == "one"
    keys = {key_of(facts) for facts in ({"a": 1}, {"a": 2}, {"b": 1}, {"a": "1"}, {})}
    assert len(keys) == 5
    assert key_of({"a": 1, "b": 2}) == key_of({"b": 2, "a": 1})


def flip(path):
    content = bytearray(path.read_bytes())
    content[0] ^= 1
    path.write_bytes(content)


DAMAGES = {
    "a flipped bit": lambda entry: flip(entry / "data" / "a"),
    "a lost file": lambda entry: (entry / "data" / "a").unlink(),
    "a file too many": lambda entry: (entry / "data" / "b").write_text("x"),
    "a truncated index": lambda entry: (entry / "entry.json").write_text('{"files": {'),
    "another index": lambda entry: (entry / "entry.json").write_text("[]"),
    "no index": lambda entry: (entry / "entry.json").unlink(),
    "nothing": shutil.rmtree,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_is_made_again(tmp_path, damage):
    cache = Cache(tmp_path)
    before = cache.get(key_of("k1"), "k1", write("one"))
    damage(before.path.parent)
    after = cache.get(key_of("k1"), "k1", write("one"))
    assert not after.found
    assert after.digest == before.digest
    assert [path.name for path in after.path.iterdir()] == ["a"]


@pytest.mark.parametrize("damage", [name for name in DAMAGES if name != "nothing"])
def test_what_is_not_ours_in_a_damaged_entry_is_kept(tmp_path, damage):
    cache = Cache(tmp_path / "cache")
    entry = cache.get(key_of("k1"), "k1", write("one")).path.parent
    mine = [entry / "notes", entry / "data" / "b"]
    for path in mine:
        path.write_text("mine")
    DAMAGES[damage](entry)
    before = {path.name: path.read_text() for path in mine}
    assert not cache.get(key_of("k1"), "k1", write("one")).found
    (kept,) = entry.parent.glob("*.kept-*")
    assert {name: next(kept.rglob(name)).read_text() for name in before} == before
    assert cache.get(key_of("k1"), "k1", refuse_to_fill).found


def test_a_damaged_index_names_no_file_elsewhere(tmp_path):
    cache = Cache(tmp_path / "cache")
    entry = cache.get(key_of("k1"), "k1", write("one")).path.parent
    (tmp_path / "mine").write_text("mine")
    outside = ["../../../../mine", str(tmp_path / "mine")]
    (entry / "entry.json").write_text(json.dumps({"facts": "k1", "files": dict.fromkeys(outside)}))
    assert not cache.get(key_of("k1"), "k1", write("one")).found
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_failed_entry_leaves_nothing_and_what_a_kill_left_goes_with_the_next(tmp_path):
    cache = Cache(tmp_path)
    with pytest.raises(ZeroDivisionError):
        cache.get(key_of("k1"), "k1", lambda out: 1 / 0)
    assert not cache.path_of(key_of("k1")).exists()
    assert cache.size_bytes() == 0
    cache = Cache(tmp_path)
    place = cache.path_of(key_of("k1"))
    left, looks_like_it = (place.with_name(f".{place.name}{word}.partial") for word in ("", ".b"))
    for folder, name in ((left, MARK), (looks_like_it, "thesis")):
        folder.mkdir(parents=True)
        (folder / name).touch()
    cache.get(key_of("k1"), "k1", write("one"))
    assert not left.exists()
    assert (looks_like_it / "thesis").exists()


def _get_slowly(folder, log):
    def fill(out):
        (log / str(os.getpid())).touch()
        time.sleep(0.3)
        (out / "a").write_text("one")

    Cache(folder).get(key_of("k1"), "k1", fill)


def test_two_processes_make_it_once(tmp_path):
    log = tmp_path / "log"
    log.mkdir()
    context = multiprocessing.get_context("fork")
    both = [context.Process(target=_get_slowly, args=(tmp_path / "c", log)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join()
    assert [process.exitcode for process in both] == [0, 0]
    assert len(list(log.iterdir())) == 1


def test_pruning_removes_what_was_not_used_for_longest(tmp_path):
    cache = Cache(tmp_path)
    for number, name in enumerate(("k1", "k2", "k3")):
        entry = cache.get(key_of(name), name, write("x" * 1000))
        os.utime(entry.path.parent / "entry.json", (number, number))
    cache.get(key_of("k1"), "k1", refuse_to_fill)
    one = cache.size_bytes() / 3
    freed = cache.prune(round(2.5 * one))
    assert freed == pytest.approx(one, rel=0.1)
    assert cache.get(key_of("k1"), "k1", refuse_to_fill).found
    assert cache.get(key_of("k3"), "k3", refuse_to_fill).found
    assert not cache.path_of(key_of("k2")).exists()
    cache.prune(0)
    assert cache.size_bytes() == 0


def test_a_cache_is_a_folder_of_which_only_what_is_ours_is_pruned(tmp_path):
    (tmp_path / "file").touch()
    said = line_of(Cache, tmp_path / "file" / "c")
    assert re.match(r"cannot make the folder .*file is a file; choose", said)
    folder = tmp_path / "cache"
    for empty in (folder, tmp_path):
        assert (Cache(empty).size_bytes(), Cache(empty).prune(0)) == (0, 0)
    assert not folder.exists()
    entry = Cache(folder).get(key_of("k1"), "k1", write("one")).path.parent
    (entry / "notes").write_text("mine")
    theirs = [folder / "th" / "thesis" / name for name in ("entry.json", "data/a", "thesis.tex")]
    for path in theirs:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('{"facts": {}, "files": {"a": {}}}')
    assert Cache(folder).prune(0) > 0
    left = {path for path in folder.rglob("*") if path.is_file()}
    assert left == {*theirs, entry / "notes"}


# The version of code
@pytest.fixture
def module(tmp_path, monkeypatch):
    """A function that writes a module and returns its version."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def forget():
        for memory in ("_source", "_file"):
            getattr(versions_of_code, memory).cache_clear()

    def version(text):
        (tmp_path / "written.py").write_text(text)
        forget()
        return code_version(["written"])

    yield version
    forget()


def test_words_for_people_and_moves_do_not_change_what_code_defines(module, tmp_path, monkeypatch):
    plain = module("def f(x):\n    return x + 1\n")
    told = module('"""M."""\n# why\n\n\ndef f(x):\n    """F."""\n    return (x\n        + 1)\n')
    assert told == plain
    before = "from a import f\ndef g():\n    import b\n    return f(1)\n"
    texts = {"here_once": before, "there_now": before.replace("a", "c.d", 1).replace("b", "e")}
    texts["other"] = texts["there_now"].replace("f(1)", "f(2)")
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    once, now, other = (definition_digest([name]) for name in texts)
    assert once == now != other


@pytest.mark.parametrize("text", [
    "def f(x):\n    return x + 2\n", "def f(x):\n    return x - 1\n",
    "def g(x):\n    return x + 1\n", "def f(y):\n    return y + 1\n",
    "def f(x):\n    return x + 1\nf(1)\n", "def f(x):\n    return x + 1.0\n",
    "import eventsweep.emvs.errors\ndef f(x):\n    return x + 1\n",
])  # fmt: skip
def test_what_code_does_changes_the_version(module, text):
    assert module("def f(x):\n    return x + 1\n") != module(text)


STAGES = {
    "simulate": (("sim.simulate", "sim.sensor.esim", "scenes.planes", "emvs.data.writer"),
     ("emvs.mapper", "eval.scoring.score")),
    "map": (("mapper", "dsi.voting_kernels", "dsi.fusion_kernels", "depth.depth_map"),
     ("sim", "scenes", "eval.scoring.score")),
    "score": (("score", "metrics", "curves"),
     ("scenes", "emvs.mapper", "eval.report", "sim.simulate", "sim.sensor.esim",
      "sim.motion.curves")),
}  # fmt: skip


@pytest.mark.parametrize("stage", STAGES)
def test_each_stage_reaches_its_own_code_and_no_more(stage):
    scene = ["eventsweep.scenes.planes"] if stage == "simulate" else []
    found = closure([f"eventsweep.eval.stages.{stage}", *scene])
    own, foreign = STAGES[stage]
    place = {"simulate": "", "map": "emvs.", "score": "eval.scoring."}[stage]
    assert {f"eventsweep.{place}{name}" for name in own} <= found
    assert [one for one in found if one.startswith(tuple(f"eventsweep.{x}" for x in foreign))] == []


@pytest.mark.parametrize("damage", [
    "", "[]", [], [1], ["x", 3], [[""], "x"], [["?"], ""], [[3], "x"],
])  # fmt: skip
def test_damaged_memory_of_parsed_sources_is_parsed_anew(tmp_path, monkeypatch, damage):
    def version():
        for memory in (versions_of_code._kept, versions_of_code._source):
            memory.cache_clear()
        return code_version(["eventsweep.scenes.planes"])

    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path))
    right, place = version(), tmp_path / "sources-1.json"
    if not isinstance(damage, str):
        kept = json.loads(place.read_text())
        assert kept
        damage = json.dumps({path: [*state[:2], *damage] for path, state in kept.items()})
    place.write_text(damage)
    assert version() == right


def test_a_scene_has_the_files_that_it_includes():
    from eventsweep import scenes

    names = {path.name for path in files_of(scenes.load("desk").mjcf)}
    assert {"desk.xml", "common.xml"} <= names


# Jobs in processes
def test_a_graph_is_done_in_order_and_once_and_a_failure_stops_what_needs_it(make, log, tmp_path):
    a, b = make("a"), make("b")
    c = make("c", needs=(a, b))
    d = make("d", needs=(c, a))
    first = run_here([d], tmp_path / "cache")
    assert first["d"].text == "a+b+c+a+d"
    again = run_here([d], tmp_path / "cache")
    assert all(one.found for one in again.values())
    assert {name: runs(log, name) for name in "abcd"} == dict.fromkeys("abcd", 1)
    bad = make("bad", "fail")
    jobs = [make("after", needs=(make("between", needs=(bad,)),)), make("other")]
    over = run_here(jobs, tmp_path / "cache")
    told = "ZeroDivisionError: as asked"
    assert [over[name].reason for name in ("bad", "between", "after")] == [
        told, f"not started: {told}", f"not started: {told}",
    ]  # fmt: skip
    assert over["other"].text == "other"


def test_bad_input_and_a_full_disk_are_one_line(make, tmp_path):
    acts = {"r": "refuse", "f": "full disk", "s": "small files"}
    over = run_here([make(name, act) for name, act in acts.items()], tmp_path / "cache", 1)
    assert over["r"] == Failed("r", "3 came, needs 4: add one")
    assert "no space left on device" in over["f"].reason.lower()
    assert "file too large" in over["s"].reason
    assert all("\n" not in one.reason for one in over.values())
    assert Cache(tmp_path / "cache").size_bytes() == 0


def test_a_worker_killed_in_the_middle_is_replaced(make, log, tmp_path):
    over = run_here([make("a", "die once"), make("b")], tmp_path / "cache")
    assert (over["a"].text, runs(log, "a"), over["b"].text) == ("a", 2, "b")


@pytest.mark.slow
def test_a_job_that_always_dies_fails_alone(make, log, tmp_path):
    over = run_here([make("a", "die"), make("b"), make("c")], tmp_path / "cache")
    assert over["a"] == Failed("a", f"its worker died {ATTEMPTS} times, last by signal 9")
    assert runs(log, "a") == ATTEMPTS
    assert {type(over[name]) for name in "bc"} == {Done}


def test_a_lost_or_damaged_result_is_made_again(make, log, tmp_path):
    a = make("a")
    b = make("b", needs=(a,))
    cache = str(tmp_path / "cache")
    done = do(a, cache)
    flip(Cache(tmp_path / "cache").path_of(done.key) / "data" / RESULT)
    assert do(b, cache).text == "a+b"
    assert runs(log, "a") == 2
    shutil.rmtree(Cache(tmp_path / "cache").path_of(done.key))
    assert do(make("c", needs=(a,)), cache).text == "a+c"
    assert runs(log, "a") == 3


def test_what_is_needed_in_many_ways_is_looked_up_once(make, tmp_path):
    """Through ten layers of two jobs each lead a thousand ways."""
    layer = ()
    for k in range(10):
        layer = tuple(make(f"{side}{k}", needs=layer) for side in "ab")
    last, cache = make("last", needs=layer), Cache(tmp_path / "cache")
    profile = cProfile.Profile()
    outcome = profile.runcall(do, last, str(cache.folder))
    looks = {one.code: one.callcount for one in profile.getstats()}
    assert (looks[Cache.get.__code__], stored(last, cache).key) == (2 * 10 + 1, outcome.key)


SWEEP = """
import sys
from pathlib import Path
from eventsweep.eval.jobs.job import Job
from eventsweep.eval.progress import Silent
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.jobs.local import local_workers

if __name__ == "__main__":
    log, cache = sys.argv[1:]
    jobs = [
        Job(f"j{k}", "job_stages", {"id": f"j{k}", "act": act, "log": log, "seconds": 60})
        for k, act in enumerate(("write", "write", "sleep"))
    ]
    run_jobs(jobs, lambda: local_workers(1, Path(cache)), Silent())
"""


def test_a_killed_sweep_goes_on_where_it_was(make, log, tmp_path):
    (tmp_path / "sweep.py").write_text(SWEEP)
    arguments = [sys.executable, str(tmp_path / "sweep.py"), str(log), str(tmp_path / "cache")]
    search = f"{HELPERS}{os.pathsep}{ROOT}"
    sweep = subprocess.Popen(arguments, env={**os.environ, "PYTHONPATH": search})
    wait_for(lambda: runs(log, "j2"))
    (worker,) = {int(path.suffix[1:]) for path in log.glob("j2.*")}
    sweep.kill()
    sweep.wait()
    os.kill(worker, signal.SIGKILL)
    jobs = [make(name, seconds=60) for name in ("j0", "j1", "j2")]
    over = run_here(jobs, tmp_path / "cache")
    assert [over[name].found for name in ("j0", "j1")] == [True, True]
    assert runs(log, "j0") == runs(log, "j1") == 1


def wait_for(condition, seconds=30):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)


def test_order_puts_needs_first_and_progress_says_how_many_are_left(make):
    a = make("a")
    b, c = make("b", needs=(a,)), make("c", needs=(a,))
    names = [job.name for job in order([make("d", needs=(b, c)), c])]
    assert names == ["a", "b", "c", "d"]
    board = JobBoard([make(name) for name in "abcd"])
    assert board.words(2) == "0/4 jobs, 0 running, 0 failed"
    assert [job.name for job in board.start()] == ["a", "b", "c", "d"]
    board.running.remove("d")
    board.take(Done("a", "k", "d", 4.0, False, "v"))
    board.take(Failed("b", "why"))
    assert board.words(2) == "2/4 jobs, 1 running, 1 failed, 4 s left"
    assert "no worker yet" in board.words(0)


def run_on(executor, jobs, folder, count=2):
    return run_jobs(jobs, lambda: executor_workers(executor, folder, count), Silent())


EXECUTORS = {
    "threads": lambda: ThreadPoolExecutor(2),
    "processes": lambda: ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")),
}


@pytest.mark.parametrize("executor", EXECUTORS.values(), ids=EXECUTORS)
def test_any_executor_does_what_local_workers_do_and_stays_open(make, log, tmp_path, executor):
    a = make("a")
    jobs = [make("d", needs=(make("b", needs=(a,)), make("c", needs=(a,)))), make("x", "fail")]
    local = run_here(jobs, tmp_path / "local")
    with executor() as pool:
        there = run_on(pool, jobs, tmp_path / "there")
        assert pool.submit(int, "3").result() == 3
        again = run_on(pool, jobs[:1], tmp_path / "there")
    digests = {name: getattr(one, "digest", one) for name, one in there.items()}
    assert digests.pop("x").reason == "ZeroDivisionError: as asked"
    assert digests == {name: one.digest for name, one in local.items() if name != "x"}
    assert all(one.found for one in again.values())
    assert runs(log, "d") == 2, "once for each cache"


def test_an_executor_whose_worker_dies_is_named_and_what_is_done_is_kept(make, log, tmp_path):
    a = make("a")
    with EXECUTORS["processes"]() as pool:
        text = line_of(lambda: run_on(pool, [make("b", "die", needs=(a,))], tmp_path / "cache"))
        assert text.startswith("the executor is broken")
        assert "open a new one and call again" in text
        assert "takes no job" in line_of(lambda: run_on(pool, [make("c")], tmp_path / "cache"))
    with EXECUTORS["threads"]() as pool:
        outcomes = run_on(pool, [make("b2", needs=(a,))], tmp_path / "cache")
    assert outcomes["a"].found
    assert runs(log, "a") == 1


def test_an_error_that_may_pass_is_tried_once_more_and_its_log_kept_bad_input_is_not(
    make, log, tmp_path
):
    jobs = [make("x", "fail"), make("y", "fail once"), make("z", "refuse"), make("w")]
    outcomes = run_here(jobs, tmp_path / "cache")
    assert {name: runs(log, name) for name in "wxyz"} == {"w": 1, "x": 2, "y": 2, "z": 1}
    assert isinstance(outcomes["y"], Done)
    assert "job_stages.py" in outcomes["x"].log
    assert (outcomes["z"].log, outcomes["z"].again) == ("", False)


@pytest.mark.parametrize("error", [CancelledError(), TimeoutError()])
def test_what_an_executor_loses_on_its_way_is_no_try_of_the_job_but_is_bounded(
    make, tmp_path, error
):
    class Losing(Executor):
        def __init__(self, losses):
            self.left = losses

        def submit(self, call, /, *given):
            future, self.left = Future(), self.left - 1
            if self.left < 0:
                future.set_result(call(*given))
            else:
                future.set_exception(error)
            return future

    assert isinstance(run_on(Losing(LOSSES), [make("a")], tmp_path / "cache")["a"], Done)
    outcome = run_on(Losing(99), [make("b")], tmp_path / "cache")["b"]
    assert outcome.reason.startswith(type(error).__name__)


def test_what_is_done_so_far_is_found_and_nothing_is_run(make, log, tmp_path):
    a = make("a")
    both = [make("b", needs=(a,)), make("c", needs=(make("b", needs=(a,)),))]
    run_here(both[:1], tmp_path / "cache")
    found = run_jobs(both, lambda: nullcontext(FoundJobs(tmp_path / "cache")), Silent())
    assert (found["a"].found, found["b"].found) == (True, True)
    assert found["c"].reason == NOT_YET
    assert runs(log, "c") == 0


class AtOnce:
    """Workers that say that a job is done as soon as they have it, one at a time."""

    count = 1

    def __init__(self):
        self.names = deque()

    def submit(self, job):
        self.names.append(job.name)

    def wait(self, timeout_s):
        return [Done(self.names.popleft(), "k", "d", 0.0, False, "v")]


def test_steps_of_the_scheduler_do_not_grow_with_the_number_of_jobs():
    """Calls of Python per job, which no other load on this machine changes."""

    def calls(count):
        first = [Job(f"a{k}", "job_stages", {}) for k in range(count)]
        jobs = [Job(f"b{k}", "job_stages", {}, (first[k], first[k - 1])) for k in range(count)]
        profile = cProfile.Profile()
        outcomes = profile.runcall(run_jobs, jobs, lambda: nullcontext(AtOnce()), Silent())
        assert len(outcomes) == 2 * count
        return sum(entry.callcount for entry in profile.getstats()) / count

    assert calls(2000) < 1.05 * calls(200)


# Jobs on a cluster


NO_ADDRESS = ["127.0.0.1:8786", "http://127.0.0.1:1", "tcp://127.0.0.1", "tcp://", "", "tls://x"]
OTHERS = ["10.0.0.1", "head.example", "0.0.0.0", "[2001:db8::1]"]


@pytest.mark.parametrize(("address", "files", "words"), [
    *((one, {}, "needs tcp://ADDRESS:PORT or tls://ADDRESS:PORT") for one in NO_ADDRESS),
    *((f"tcp://{one}:8786", {}, "neither encrypted nor authenticated") for one in OTHERS),
    ("tls://head:8786", {"tls_ca": Path(__file__), "tls_cert": Path(__file__)},
     "needs --tls-key FILE, not None"),
])  # fmt: skip
def test_an_address_that_is_none_is_unsafe_or_lacks_its_files_is_refused(address, files, words):
    assert words in line_of(Cluster(address, **files).check)


def test_another_machine_needs_a_word_this_one_does_not_and_must_answer(tmp_path, monkeypatch):
    Cluster("tcp://10.0.0.1:8786", remote=True).check()
    for host in ("127.0.0.1", "localhost", "[::1]", "127.3.2.1"):
        Cluster(f"tcp://{host}:8786").check()
    monkeypatch.setattr(schedule_dask, "_CONNECT_S", 1)
    assert "not reached" in line_of(dask_workers(Cluster("tcp://127.0.0.1:9"), tmp_path).__enter__)


@pytest.fixture
def start(tmp_path):
    """Starts schedulers and workers in processes of their own, and ends them."""
    search = f"{HELPERS}{os.pathsep}{ROOT}"
    # One job per worker at a time: who dies takes nobody along.
    settings = {"ALLOWED_FAILURES": "2", "WORKER_SATURATION": "1.0"}
    dask = {f"DASK_DISTRIBUTED__SCHEDULER__{name}": value for name, value in settings.items()}
    env = {**os.environ, "PYTHONPATH": search, **dask}
    started = []

    def process(what, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard"]
        options = ["--scheduler-file", str(tmp_path / "scheduler.json"), "--host", "127.0.0.1"]
        started.append(
            subprocess.Popen([*command, *options, *arguments], env=env, stderr=subprocess.DEVNULL)
        )
        return started[-1]

    yield process
    for one in started:
        one.kill()
        one.wait()


def address(tmp_path):
    file = tmp_path / "scheduler.json"
    wait_for(file.exists)
    return json.loads(file.read_text())["address"]


@pytest.fixture
def cluster(start, tmp_path):
    """A scheduler, and a function that starts a worker."""
    start("scheduler", "--port", "0")
    place = Cluster(address(tmp_path))
    return place, lambda: start("worker", "--nthreads", "1", "--no-nanny")


@pytest.mark.slow
def test_the_same_graph_runs_on_a_cluster_whose_worker_joins_late(cluster, make, log, tmp_path):
    place, start_worker = cluster
    threading.Timer(1.0, start_worker).start()
    last = make("c", needs=(make("a"), make("b", "sleep", seconds=0.1)))
    jobs = [last, make("bad", "fail")]
    over = run_jobs(jobs, lambda: dask_workers(place, tmp_path / "cache"), Silent())
    assert (over["c"].text, over["bad"].reason) == ("a+b+c", "ZeroDivisionError: as asked")
    assert {name: runs(log, name) for name in "abc"} == dict.fromkeys("abc", 1)


def test_a_killed_scheduler_is_one_line_and_what_was_done_stays(
    start, make, log, tmp_path, monkeypatch
):
    monkeypatch.setattr(schedule_dask, "FIND_S", 1.0)
    scheduler = start("scheduler", "--port", "0")
    place = Cluster(address(tmp_path))
    start("worker", "--nthreads", "1", "--no-nanny")

    def kill():
        wait_for(lambda: runs(log, "b") == 1)
        scheduler.kill()

    threading.Thread(target=kill).start()
    last = make("b", "sleep", needs=(make("a"),), seconds=60)
    workers = lambda: dask_workers(place, tmp_path / "cache")  # noqa: E731
    assert "the scheduler is gone" in line_of(run_jobs, [last], workers, Silent())
    assert do(make("a"), str(tmp_path / "cache")).found


PARENT = """
import multiprocessing, sys, time
from eventsweep.emvs.utils.processes import end_with_parent

def work(pipe):
    end_with_parent()
    pipe.send("ready")
    time.sleep(60)

if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work, args=(theirs,))
    process.start()
    ours.recv()
    print(process.pid, flush=True)
    time.sleep(60)
"""


def test_a_worker_ends_with_a_killed_parent(tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    wait_for(lambda: not is_running(worker), seconds=2)


def is_running(process):
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.slow
def test_a_cluster_survives_workers_that_die(cluster, make, log, tmp_path):
    place, start_worker = cluster
    for _ in range(5):
        start_worker()
    jobs = [make("once", "die once"), make("always", "die"), make("b"), make("c")]
    over = run_jobs(jobs, lambda: dask_workers(place, tmp_path / "cache"), Silent())
    assert over["once"].text == "once"
    assert over["always"].reason.startswith("KilledWorker")
    assert (over["b"].text, over["c"].text) == ("b", "c")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl for a certificate")
def test_a_cluster_behind_tls(start, make, tmp_path):
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"]
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *subject]
    subprocess.run([*request, "-keyout", key, "-out", cert], check=True, capture_output=True)
    files = ["--tls-ca-file", str(cert), "--tls-cert", str(cert), "--tls-key", str(key)]
    start("scheduler", "--port", "0", "--protocol", "tls", *files)
    place = Cluster(address(tmp_path), tls_ca=cert, tls_cert=cert, tls_key=key)
    start("worker", "--nthreads", "1", "--no-nanny", "--protocol", "tls", *files)
    over = run_jobs([make("a")], lambda: dask_workers(place, tmp_path / "cache"), Silent())
    assert over["a"].text == "a"
    assert place.address.startswith("tls://")
