"""The gate against planted faults: each turns it red on `quick`, and other seeds do not.

The slow ones run `quick` 21 times, a quarter of an hour on two free cores. Each run has a limit
of time, and what it made lies in the cache: with `EVENTSWEEP_CACHE` set, a test that was stopped or
ran out of time goes on where it was.
"""

import os
from pathlib import Path

import pytest

from fault_runs import gate, red
from planted_faults import FAULTS, ROOT, Fault, broken_copy

RUNS = 10
MORE = ("plugins",)  # `quick` has methods of theirs, and one draws


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One cache for all copies: a fault of the mapper needs no new sequences."""
    kept = os.environ.get("EVENTSWEEP_CACHE")
    return Path(kept) if kept else tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_can_be_planted(fault):
    """The line is still there, once: else the test below would test nothing."""
    assert (ROOT / fault.file).read_text(encoding="utf-8").count(fault.old) == 1


def test_a_copy_is_broken_in_one_line(tmp_path):
    fault = FAULTS[0]
    copy = broken_copy(tmp_path / "copy", fault)
    before = (ROOT / fault.file).read_text(encoding="utf-8").splitlines()
    imported = copy / "eventsweep" / fault.file
    after = imported.read_text(encoding="utf-8").splitlines()
    assert len([1 for a, b in zip(before, after, strict=True) if a != b]) == 1
    assert imported.samefile(copy / fault.file)
    with pytest.raises(ValueError, match="has 0 such lines"):
        broken_copy(tmp_path / "again", Fault("none", fault.file, "no such line", ""))


@pytest.mark.slow
@pytest.mark.parametrize("first_seed", [None, *range(100, 100 + 3 * RUNS, 3)])
def test_unbroken_code_is_green_with_other_seeds_too(tmp_path, cache, first_seed):
    seeds = () if first_seed is None else ("--seeds", f"{first_seed}-{first_seed + 2}")
    code, verdicts = gate(broken_copy(tmp_path / "copy", more=MORE), cache, *seeds)
    assert red(verdicts) == []
    assert code == 0
    assert seeds or {one["status"] for one in verdicts} == {"same"}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_gate_sees_the_fault(tmp_path, cache, fault):
    code, verdicts = gate(broken_copy(tmp_path / "copy", fault, more=MORE), cache)
    assert code == 1
    assert [one for one in red(verdicts) if one["status"] == "worse"]
