"""A run is made of jobs: kept, taken up, and done by whoever offers workers."""

from functools import partial

import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval import pipeline
from eventsweep.eval.config import Settings
from eventsweep.eval.jobs.job import entry
from eventsweep.eval.stages import simulate as stage
from eventsweep.eval.suite.plan import run_job
from eventsweep.sim.config import SimConfig
from in_process import in_process
from score_rows import texts

SETTINGS = Settings(
    sim=SimConfig(duration_s=0.04), map=MapperConfig(methods=("Alg1/H", "EMVS/cam0"), planes=20)
)


def run(folder, cache, settings=SETTINGS, **how):
    return pipeline.run_cases(["planes"], folder, settings, "rpg", 3, cache=cache, **how)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A finished run, and the cache that has its jobs."""
    folder = tmp_path_factory.mktemp("run")
    return run(folder / "out", folder / "cache"), folder


def files(folder):
    names = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder): path.read_bytes() for path in names}


def test_workers_of_a_cluster_leave_the_same_run(done, tmp_path):
    results, folder = done
    cache = tmp_path / "cache"
    theirs = run(tmp_path / "out", cache, crew=partial(in_process, 1, cache))
    assert texts(theirs.rows) == texts(results.rows)
    mine, other = (files(place / "out/planes/sequence") for place in (folder, tmp_path))
    assert mine == other


def test_what_a_worker_says_of_a_failure_is_the_run_s_line(tmp_path, monkeypatch):
    monkeypatch.setattr(stage, "run", lambda *_: 1 / 0)
    crew = partial(in_process, 1, tmp_path / "cache")
    with pytest.raises(pipeline.InputError, match="simulate/planes: ZeroDivisionError"):
        run(tmp_path / "out", tmp_path / "cache", crew=crew)
    assert not (tmp_path / "out").exists()


def test_another_method_does_not_simulate_again(done, tmp_path, monkeypatch):
    results, folder = done
    monkeypatch.setattr(stage, "run", None)
    again = run(tmp_path / "out", folder / "cache")
    assert texts(again.rows) == texts(results.rows)
    other = SETTINGS.model_copy(update={"map": MapperConfig(methods=("Alg1/min",), planes=20)})
    assert "Alg1/min" in set(run(tmp_path / "other", folder / "cache", other).rows["method"])


def test_whoever_watches_is_told_each_case_when_its_files_are_there(done, tmp_path):
    _, folder = done
    told = []

    class Watch(pipeline.Watch):
        def sequence(self, case, folder):
            told.append(("sequence", case, (folder / "manifest.json").is_file()))

        def maps(self, case, folder):
            told.append(("maps", case, (folder / "map.json").is_file()))

    run(tmp_path / "out", folder / "cache", watch=Watch())
    assert told == [("sequence", "planes", True), ("maps", "planes", True)]


def test_a_controller_runs_again_for_nobody_knows_what_it_imports():
    model = {"motion": "dynamics", "controller": "drive.py:steer"}
    driven = Settings(sim=SimConfig(model=model))
    first, second = (run_job("robot.xml", driven, "rpg", 0, None).needs[0] for _ in range(2))
    assert first.parameters != second.parameters
    alone = Settings(sim=SimConfig(model={"motion": "dynamics"}))
    first, second = (run_job("robot.xml", alone, "rpg", 0, None).needs[0] for _ in range(2))
    assert first.parameters == second.parameters


def test_an_edited_file_of_a_run_does_not_reach_another_run(done, tmp_path):
    """The files of a run may be hard links to those of the cache, whose hashes then tell."""
    results, folder = done
    first = tmp_path / "first"
    run(first, folder / "cache")
    manifest = first / "planes/sequence/cam0/events.h5"
    manifest.write_bytes(b"something else")
    again = run(tmp_path / "second", folder / "cache")
    assert texts(again.rows) == texts(results.rows)


def test_an_interrupted_simulation_of_a_job_goes_on_where_it_was(tmp_path, monkeypatch):
    settings = SETTINGS.model_copy(update={"sim": SimConfig(duration_s=0.3)})
    job, cache = run_job("planes", settings, "rpg", 0, None).needs[0], Cache(tmp_path)
    simulated = stage.simulate_scene
    places = []

    def stopped(scene, out, *rest, **more):
        places.append(out)
        out.parent.joinpath("begun").write_text("")
        raise KeyboardInterrupt

    monkeypatch.setattr(stage, "simulate_scene", stopped)
    with pytest.raises(KeyboardInterrupt):
        entry(job, cache)
    (place,) = places
    assert place.with_name("begun").exists()  # where a simulation keeps what it can go on from
    place.with_name("begun").unlink()
    monkeypatch.setattr(stage, "simulate_scene", simulated)
    assert (entry(job, cache).path / "sequence" / "manifest.json").is_file()
    assert not place.parent.exists()
