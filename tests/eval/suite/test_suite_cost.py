"""What a method alone costs: each of the speed case is measured in a process of its own."""

import os

from eval.cli.main import main
from eval.jobs.local import ONE_THREAD
from eval.ranking.entries import of_suite
from eval.suite.results import read_suite

SUITE = """
name = "priced"
summary = "one short case"
seeds = [0]
spread_seeds = [0]
metrics = ["points", "mean_error"]
speed_case = "wall"

[mappers.default]
methods = ["EMVS/cam0", "Alg1/H"]
planes = 30

[mappers.more]
methods = ["SGM/ts"]
planes = 30

[cases.wall]
scene = "planes"
rig = "rpg"
seconds = 0.04
windows = [{ start_s = 0.0, duration_s = 0.04 }]
mappers = ["default", "more"]
sim = { contrast_threshold_pos = 0.4, contrast_threshold_neg = 0.5 }
"""


def run(folder, *more):
    arguments = ["--cache", str(folder / "cache"), "--workers", "1", "--no-speed", "--quiet"]
    return main(["suite", str(folder / "priced.toml"), *arguments, *more])


def test_every_method_is_measured_alone_and_only_when_asked(tmp_path):
    (tmp_path / "priced.toml").write_text(SUITE)
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    assert run(tmp_path, "--out", str(tmp_path / "out"), "--cost") == 0
    assert {name: os.environ.get(name) for name in ONE_THREAD} == before
    result = read_suite(tmp_path / "out")
    assert set(result.cost) == {"EMVS/cam0", "Alg1/H", "SGM/ts more"}
    for one in result.cost.values():
        assert one.case == "wall"
        assert 0 < one.cpu_seconds < 60
        assert 50 < one.peak_memory_mb < 4000
    # What this process holds is not theirs: two methods need not the same.
    assert len({one.peak_memory_mb for one in result.cost.values()}) > 1
    assert set(of_suite(result, "here").cost) == {"EMVS/cam0", "Alg1/H", "SGM/ts"}
    assert run(tmp_path, "--out", str(tmp_path / "plain")) == 0
    assert read_suite(tmp_path / "plain").cost == {}
