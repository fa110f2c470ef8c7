"""The gate against planted faults: each turns it red on `quick`, and other seeds do not.

The slow ones run `quick` 21 times, a quarter of an hour on two free cores. Each run has a limit
of time, and what it made lies in the cache: with `EVENTSWEEP_CACHE` set, a test that was stopped or
ran out of time goes on where it was.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from planted_faults import FAULTS, ROOT, Fault, broken_copy

from eval.gate_series import SPEED_METRIC

BASELINE = ROOT / "reports" / "baseline.json"
RUNS = 10
LIMIT_S = 1800
"""For one run of `quick` and its gate: about a minute where nobody else works."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One cache for all copies: a fault of the mapper needs no new sequences."""
    kept = os.environ.get("EVENTSWEEP_CACHE")
    return Path(kept) if kept else tmp_path_factory.mktemp("cache")


def eventsweep(copy, *arguments):
    """Runs the command of a copy of the packages, and ends it and its workers after `LIMIT_S`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "eval.cli", *map(str, arguments)],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "GITHUB_STEP_SUMMARY": ""},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, said = process.communicate(timeout=LIMIT_S)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            pytest.fail(f"not done after {LIMIT_S} s; set EVENTSWEEP_CACHE to go on from here")
        raise
    assert process.returncode in (0, 1), said
    return process.returncode, out


def gate(copy, cache, *arguments):
    """The gate's exit code in a copy of the packages, and its verdicts.

    Without the mapper's speed: others at work on this machine must not decide a test.
    """
    place = copy.parent / "result"
    eventsweep(copy, "suite", "quick", "--out", place, "--cache", cache, "--no-speed", *arguments)
    told = ("--baseline", copy.parent / "baseline.json", "--result", place, "--json")
    timeless(BASELINE, copy.parent / "baseline.json")
    code, text = eventsweep(copy, "gate", *told)
    return code, json.loads(text)


def timeless(baseline, path):
    """Copies a baseline without its series of speed."""
    content = json.loads(baseline.read_text(encoding="utf-8"))
    series = [one for one in content["series"] if one["metric"] != SPEED_METRIC]
    path.write_text(json.dumps({**content, "series": series}), encoding="utf-8")


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
    code, verdicts = gate(broken_copy(tmp_path / "copy"), cache)
    assert red(verdicts) == []
    assert code == 0
    assert {one["status"] for one in verdicts} == {"same"}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_gate_sees_the_fault(tmp_path, cache, fault):
    code, verdicts = gate(broken_copy(tmp_path / "copy", fault), cache)
    assert code == 1
    assert [one for one in red(verdicts) if one["status"] == "worse"]


@pytest.mark.slow
@pytest.mark.parametrize("first_seed", range(100, 100 + 3 * RUNS, 3))
def test_unbroken_code_is_green_with_other_seeds(tmp_path, cache, first_seed):
    copy = broken_copy(tmp_path / "copy")
    code, verdicts = gate(copy, cache, "--seeds", f"{first_seed}-{first_seed + 2}")
    assert red(verdicts) == []
    assert code == 0
