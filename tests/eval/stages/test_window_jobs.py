"""Sliding windows as jobs: the same bytes, wherever they are mapped."""

import json
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest

import eventsweep as es
from dataset_world import write_sequence
from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.main import main
from eventsweep.eval.jobs.scheduler import JobBoard
from refusals import command_refused, contents, line_of

pytestmark = pytest.mark.usefixtures("blank_figures")
WINDOWS = 20


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("recording") / "plane", "pinhole")


@pytest.fixture(scope="module")
def config(recording):
    """Twenty windows; the last few have no events, or poses that lie too far apart."""
    first_us, last_us = es.open_recording(recording).event_span_us(0)
    length_s = (last_us - first_us) * 1e-6 / (WINDOWS + 0.5)
    return es.MapperConfig(window_s=length_s, methods=("Alg1/H",), planes=10, hot_pixels=8.0)


@pytest.fixture(scope="module")
def here(recording, config, tmp_path_factory):
    """The map of one process."""
    out = tmp_path_factory.mktemp("here") / "map"
    stored = es.map_windows(recording, out, config)
    assert len(stored.windows) + len(stored.info.skipped) == WINDOWS
    return out


def same(one, other):
    """Whether two map folders hold the same bytes, but for where the recording is seen from."""
    files = [
        {path.relative_to(folder): data for path, data in contents(folder).items()}
        for folder in (one, other)
    ]
    assert files[0].keys() == files[1].keys()
    return [name for name in files[0] if files[0][name] != files[1][name]] == []


def loky():
    return pytest.importorskip("loky").get_reusable_executor(2)


def dask():
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(4, threads_per_worker=1, dashboard_address=None)
    return distributed.Client(cluster).get_executor()


@pytest.mark.parametrize("executor", [
    pytest.param(lambda: ThreadPoolExecutor(2), id="threads"),
    pytest.param(lambda: ProcessPoolExecutor(2, get_context("spawn")), id="processes",
                 marks=pytest.mark.slow),
    pytest.param(loky, id="loky", marks=pytest.mark.slow),
    pytest.param(dask, id="dask", marks=pytest.mark.slow),
])  # fmt: skip
def test_twenty_windows_have_the_bytes_of_one_process(recording, config, here, tmp_path, executor):
    out, cache = tmp_path / "map", tmp_path / "cache"
    with executor() as pool:
        es.map_windows(recording, out, config, executor=pool, cache=cache)
    assert same(out, here)


@pytest.mark.usefixtures("jobs_in_this_process")
def test_the_command_maps_by_workers_and_finds_what_is_done(recording, config, tmp_path):
    words = ["map", recording, "--cache", tmp_path / "cache", "--workers", "2", "--quiet"]
    words += ["--method", "Alg1/H", "--map.planes", "10", "--map.window-s", config.window_s]
    for name in ("one", "two"):
        assert main([*map(str, words), "--out", str(tmp_path / name)]) == 0
    entries = list((tmp_path / "cache").glob("??/*/entry.json"))
    made = json.loads((tmp_path / "one" / "map.json").read_text())
    assert len(entries) == len(made["windows"])
    assert same(tmp_path / "one", tmp_path / "two")


def test_a_run_that_was_stopped_goes_on_and_only_there(
    recording, config, here, tmp_path, monkeypatch
):
    out, cache = tmp_path / "map", tmp_path / "cache"
    take, taken = JobBoard.take, []

    def stopped(self, outcome):
        if len(taken) == 5:
            raise KeyboardInterrupt
        taken.append(outcome.name)
        return take(self, outcome)

    with ThreadPoolExecutor(1) as pool:
        monkeypatch.setattr(JobBoard, "take", stopped)
        with pytest.raises(KeyboardInterrupt):
            es.map_windows(recording, out, config, executor=pool, cache=cache)
        assert not es.read_map(out).info.complete
        monkeypatch.setattr(JobBoard, "take", take)
        es.map_windows(recording, out, config, executor=pool, cache=cache)
    assert same(out, here)


def test_a_worker_that_sees_another_recording_maps_none(recording, config, tmp_path, monkeypatch):
    moved = tmp_path / "plane"
    shutil.copytree(recording, moved)
    monkeypatch.setattr(
        "eventsweep.eval.stages.window.open_recording",
        lambda _path: es.open_recording(write_sequence(tmp_path / "other", "pinhole", steps=9)),
    )
    with ThreadPoolExecutor(1) as pool, pytest.raises(InputError, match="another recording lies"):
        es.map_windows(moved, tmp_path / "map", config, executor=pool, cache=tmp_path / "cache")


def test_workers_for_one_window_or_of_an_object_are_refused(recording, config, tmp_path, capsys):
    line = command_refused(capsys, "map", recording, "--out", tmp_path / "o", "--workers", "2")
    assert "--workers maps sliding windows: add --map.window-s" in line
    with ThreadPoolExecutor(1) as pool:
        words = recording, tmp_path / "o"
        assert "set window_s" in line_of(lambda: es.map_windows(*words, executor=pool))
