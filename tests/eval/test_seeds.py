"""Many seeds of a scene: the bytes of one at a time, and none simulated twice."""

from contextlib import nullcontext

import pytest

from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.cli.main import main
from eventsweep.eval.jobs import dask as schedule_dask
from eventsweep.eval.jobs.job import NOT_YET
from eventsweep.eval.jobs.local import FoundJobs
from eventsweep.eval.seeds import simulate_seeds
from eventsweep.sim.config import SimConfig
from refusals import command_refused, line_of

SHORT = ("simulate", "planes", "--rig", "rpg", "--seconds", "0.03", "--quiet")


def contents(folder):
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != ".eventsweep.json"
    }


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Two seeds, and the cache that has them."""
    folder = tmp_path_factory.mktemp("many")
    words = ["--seeds", "3,5", "--out", folder / "many", "--cache", folder / "cache"]
    assert main([*SHORT, *map(str, words)]) == 0
    return folder


def test_each_seed_has_the_bytes_of_its_own_simulation(many):
    assert sorted(path.name for path in (many / "many").iterdir() if path.is_dir()) == [
        "seed3", "seed5",
    ]  # fmt: skip
    assert main([*SHORT, "--seed", "5", "--out", str(many / "one")]) == 0
    assert contents(many / "one") == contents(many / "many" / "seed5")
    assert contents(many / "many" / "seed3") != contents(many / "many" / "seed5")


def test_what_is_done_is_never_simulated_again_and_what_is_not_leaves_no_output(many, tmp_path):
    """The workers here do nothing: they only find."""
    config, cache = SimConfig(duration_s=0.03), many / "cache"

    def found(*seeds):
        crew = lambda: nullcontext(FoundJobs(Cache(cache).folder))  # noqa: E731
        return simulate_seeds(
            "planes", tmp_path / "out", config, "rpg", seeds, crew=crew, cache=cache
        )

    assert NOT_YET in line_of(found, 3, 4)
    assert "1 of 2 seeds failed" in line_of(found, 3, 4)
    assert not (tmp_path / "out").exists()
    folders = found(5, 3)
    assert list(folders) == [5, 3]
    assert contents(folders[5]) == contents(many / "many" / "seed5")
    assert "exists" in line_of(found, 3)


@pytest.mark.parametrize(("words", "line"), [
    (["--seeds", "1-x"], "--seeds 1-x: needs numbers such as 0,1,5 or 100-109"),
    (["--seeds", "1,1"], "without repeats"),
    (["--seeds", "0-9", "--seed", "0"], "--seeds with --seed"),
    (["--seeds", "0-9", "--fresh"], "--seeds with --fresh"),
    (["--scheduler", "tcp://127.0.0.1:9"], "add --seeds, such as --seeds 0-9"),
    (["--cache", "x"], "add --seeds, such as --seeds 0-9"),
    (["--seeds", "0-9", "--remote"], "without --scheduler"),
    (["--seeds", "0-9", "--scheduler", "tcp://127.0.0.1:9"], "not reached"),
    (["--seeds", "0-9", "--sim.light.renderer", "none"], "none"),
])  # fmt: skip
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, words, line
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(schedule_dask, "_CONNECT_S", 1)
    assert line in command_refused(capsys, *SHORT, "--out", "out", *words)
    assert not (tmp_path / "out").exists()


def test_with_force_an_output_is_replaced(many, tmp_path, capsys):
    words = [*SHORT, "--cache", str(many / "cache"), "--out", str(tmp_path / "out"), "--seeds"]
    assert main([*words, "3,5"]) == 0
    assert "exists" in command_refused(capsys, *words, "3")
    assert main([*words, "3", "--force"]) == 0
    assert not (tmp_path / "out" / "seed5").exists()
