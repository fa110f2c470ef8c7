"""The gate against planted faults: each turns it red on `quick`, and other seeds do not."""

import json
import os
import subprocess
import sys

import pytest
from planted_faults import FAULTS, ROOT, Fault, broken_copy

from eval.gate_series import SPEED_METRIC

BASELINE = ROOT / "reports" / "baseline.json"


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One cache for all copies: a fault of the mapper needs no new sequences."""
    return tmp_path_factory.mktemp("cache")


def gate(copy, cache, *arguments):
    """The exit code of the gate in a copy of the packages, and its verdicts but that of speed."""
    command = [sys.executable, "-m", "eval.cli", "gate", "--baseline", str(BASELINE), "--json"]
    done = subprocess.run(
        [*command, "--cache", str(cache), *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "GITHUB_STEP_SUMMARY": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in (0, 1), done.stderr
    verdicts = json.loads(done.stdout)
    # Others at work on this machine must not decide a test.
    return done.returncode, [one for one in verdicts if one["metric"] != SPEED_METRIC]


def red(verdicts):
    return [one for one in verdicts if one["status"] in ("worse", "failed", "gone")]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_can_be_planted(fault):
    """The line is still there, once: else the test below would test nothing."""
    assert (ROOT / fault.file).read_text(encoding="utf-8").count(fault.old) == 1


def test_a_copy_is_broken_in_one_line(tmp_path):
    fault = FAULTS[0]
    copy = broken_copy(tmp_path / "copy", fault)
    before = (ROOT / fault.file).read_text(encoding="utf-8").splitlines()
    after = (copy / fault.file).read_text(encoding="utf-8").splitlines()
    assert len([1 for a, b in zip(before, after, strict=True) if a != b]) == 1
    with pytest.raises(ValueError, match="has 0 such lines"):
        broken_copy(tmp_path / "again", Fault("none", fault.file, "no such line", ""))


@pytest.mark.slow
def test_unbroken_code_is_green(tmp_path, cache):
    _, verdicts = gate(broken_copy(tmp_path / "copy"), cache)
    assert red(verdicts) == []
    assert {one["status"] for one in verdicts} == {"same"}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_gate_sees_the_fault(tmp_path, cache, fault):
    code, verdicts = gate(broken_copy(tmp_path / "copy", fault), cache)
    assert code == 1
    assert [one for one in red(verdicts) if one["status"] == "worse"]


@pytest.mark.slow
@pytest.mark.parametrize("run", range(10))
def test_unbroken_code_is_green_with_other_seeds(tmp_path, cache, run):
    first = 100 + 3 * run
    copy = broken_copy(tmp_path / "copy")
    _, verdicts = gate(copy, cache, "--seeds", f"{first}-{first + 2}")
    assert red(verdicts) == []
