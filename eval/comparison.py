"""Results held against the first of them, number by number, where that means something."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from emvs.errors import InputError
from eval.gate import Tolerances, Verdict, compare
from eval.gate_series import Key, Measured, read_measured

JUDGED = ("better", "worse", "same")
"""Verdicts of two numbers that can be compared."""


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """A result, and what the page calls it."""

    name: str
    measured: Measured


@dataclass(frozen=True)
class RunComparison:
    """Results, each held against the first.

    Attributes:
        runs: the results, the first one is the reference.
        verdicts: per further result, what it says of each number.
    """

    runs: tuple[ComparedRun, ...]
    verdicts: tuple[Mapping[Key, Verdict], ...]


def read_runs(paths: Sequence[Path]) -> tuple[ComparedRun, ...]:
    """Reads results and names them after their folders.

    Raises:
        InputError: fewer than two, or one is missing or damaged.
    """
    if len(paths) < 2:
        raise InputError(f"{len(paths)} result given, needs two or more to compare")
    folders = [path.resolve() if path.is_dir() else path.resolve().parent for path in paths]
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [f"{k + 1}: {'/'.join(folder.parts[-2:])}" for k, folder in enumerate(folders)]
    read = (read_measured(path) for path in paths)
    return tuple(ComparedRun(name, one) for name, one in zip(names, read, strict=True))


def compare_runs(runs: Sequence[ComparedRun]) -> RunComparison:
    """Judges every number of each further run against the first, as the gate would."""
    first, *others = runs
    verdicts = tuple(_verdicts(first.measured, other.measured) for other in others)
    return RunComparison(tuple(runs), verdicts)


def _verdicts(first: Measured, other: Measured) -> dict[Key, Verdict]:
    judged = compare(first.series, other, Tolerances())
    strange = {one.key.case for one in judged if one.status == "not comparable"}
    strange -= {one.key.case for one in judged if one.status in JUDGED}
    # What is missing on another sequence is no loss.
    verdicts = (
        Verdict(one.key, "not comparable", one.unit)
        if one.status == "gone" and one.key.case in strange else one
        for one in judged
    )  # fmt: skip
    directed = (one for one in verdicts if _has_direction(one, first, other))
    return {one.key: _with_versions(one, first, other) for one in directed}


def _has_direction(verdict: Verdict, first: Measured, other: Measured) -> bool:
    """Whether more or less is better: of what has no direction, no change is for the worse."""
    series = first.series.get(verdict.key) or other.series.get(verdict.key)
    return series is None or series.better != "none"


def _with_versions(verdict: Verdict, first: Measured, other: Measured) -> Verdict:
    """A plain run says nothing of its metrics' code, so another version is another yardstick."""
    if verdict.status == "not comparable":
        return replace(verdict, why="other sequences, another definition or another metric")
    versions = [one.versions.get("eventsweep", "") for one in (first, other)]
    suites = first.name != "results" and other.name != "results"
    if suites or versions[0] == versions[1] or verdict.status not in JUDGED:
        return verdict
    why = f"scored by eventsweep {versions[0]} and {versions[1]}"
    return Verdict(verdict.key, "not comparable", verdict.unit, why=why)
