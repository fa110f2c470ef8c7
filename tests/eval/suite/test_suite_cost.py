"""What a method alone costs: each of the speed case is measured in a process of its own."""

import os

import pytest

from eventsweep.eval.cli.main import main
from eventsweep.eval.jobs.local import ONE_THREAD
from eventsweep.eval.results.results import read_results, shown_name
from small_suite import WHOLE, case, suite_text

MAPPERS = {
    "default": {"methods": ["EMVS/cam0", "Alg1/H"], "planes": 30},
    "more": {"methods": ["SGM/ts"], "planes": 30},
}
SUITE = 'speed_case = "wall"\n' + suite_text(
    case("wall", WHOLE, mappers=["default", "more"]), mappers=MAPPERS
)


def run(folder, *more):
    arguments = ["--cache", str(folder / "cache"), "--workers", "1", "--no-speed", "--quiet"]
    return main(["suite", str(folder / "priced.toml"), *arguments, *more])


@pytest.mark.slow
def test_every_method_is_measured_alone_and_only_when_asked(tmp_path):
    (tmp_path / "priced.toml").write_text(SUITE)
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    assert run(tmp_path, "--out", str(tmp_path / "out"), "--cost") == 0
    assert {name: os.environ.get(name) for name in ONE_THREAD} == before
    result = read_results(tmp_path / "out")
    assert set(result.cost) == {"EMVS/cam0", "Alg1/H", "SGM/ts more"}
    for one in result.cost.values():
        assert one.case == "wall"
        assert 0 < one.cpu_seconds < 60
        assert 50 < one.peak_memory_mb < 4000
    # What this process holds is not theirs: two methods need not the same.
    assert len({one.peak_memory_mb for one in result.cost.values()}) > 1
    assert {shown_name(name, MAPPERS) for name in result.cost} == {"EMVS/cam0", "Alg1/H", "SGM/ts"}
    assert run(tmp_path, "--out", str(tmp_path / "plain")) == 0
    assert read_results(tmp_path / "plain").cost == {}
