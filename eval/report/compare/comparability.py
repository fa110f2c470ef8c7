"""Whether numbers of two results are of one kind and of the same data, and what only one has."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from eventsweep.eval.report.compare.results import WHOLE, CaseResult, ComparedResult, Number
from eventsweep.eval.scoring.metrics import GEOMETRY_METRICS
from eventsweep.eval.scoring.pairing import OF_ALL_METHODS
from eventsweep.eval.scoring.trajectories.metrics import TRAJECTORY_METRICS

_OF_ALL_METHODS = tuple(f"{region}_" for region in OF_ALL_METHODS)
Lacking = Callable[[ComparedResult, ComparedResult, str], list[str]]


def not_comparable(
    number: Number,
    results: tuple[ComparedResult, ComparedResult],
    cases: tuple[CaseResult, CaseResult],
) -> str:
    """Why two numbers are not of one kind; empty where they are."""
    (first, other), (one, two) = results, cases
    versions = [case.metrics.get(number.metric) for case in cases]
    if None not in versions and versions[0] != versions[1]:
        return "the metric computes something else"
    made = [result.versions.get("eventsweep", "unknown") for result in (first, other)]
    if None in versions and made[0] != made[1]:
        return f"scored by eventsweep {made[0]} and {made[1]}"
    if one.units[number] != two.units[number]:
        return "another unit or direction"
    differing = _differing_scores(one.settings, two.settings)
    if differing:
        what = (
            "scored otherwise"
            if number.metric in {**TRAJECTORY_METRICS, **GEOMETRY_METRICS}
            else "other pixels are scored"
        )
        return f"{what}: {', '.join(differing)}"
    if number.metric.startswith(_OF_ALL_METHODS) and set(one.methods) != set(two.methods):
        return "beside other methods"
    return ""


def other_sequences(
    case: str, first: ComparedResult, other: ComparedResult, seeds: Sequence[int | None]
) -> str:
    """Whether sequences of an archive stand against others, drawn anew; empty where not."""
    if first.archive == other.archive:
        return ""
    pairs = ((first.cases[case, seed], other.cases[case, seed]) for seed in seeds)
    if all(one.sequence == two.sequence for one, two in pairs):
        return ""
    sources = (f"archive {one.archive}" if one.archive else "drawn anew" for one in (first, other))
    return f"other sequences: {' against '.join(sources)}"


def _differing_scores(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[str]:
    a, b = (
        group if isinstance(group, dict) else {} for group in (one.get("score"), two.get("score"))
    )
    names = [name for name in {**a, **b} if a.get(name) != b.get(name)]
    return [f"score.{name}" for name in names if name != "ranking_metric"]


def same_time(one: CaseResult, two: CaseResult, window: str) -> bool:
    """Whether the reference views are of one moment, as far as that is known."""
    if window not in one.times or window not in two.times:
        return True
    return math.isclose(one.times[window].reference_s, two.times[window].reference_s, abs_tol=2e-6)


def same_data(case: str, first: ComparedResult, other: ComparedResult) -> str:
    """What is to be said about the data of a case; empty where they are the same."""
    seeds = [seed for seed in first.seeds(case) if seed in other.seeds(case)]
    if not seeds:
        texts = (_few(map(_seed_text, result.seeds(case))) for result in (first, other))
        return f"{case}: not the same data, seeds {' against '.join(texts)}: nothing is paired."
    pairs = [(first.cases[case, seed], other.cases[case, seed]) for seed in seeds]
    sentences = dict.fromkeys(text for one, two in pairs if (text := _data_differ(one, two)))
    return f"{case}: {'; '.join(sentences)}." if sentences else ""


def _seed_text(seed: int | None) -> str:
    return "none" if seed is None else str(seed)


def _data_differ(one: CaseResult, two: CaseResult) -> str:
    if one.sequence and one.sequence == two.sequence:
        return ""
    if not (one.sequence and two.sequence):
        return "no hash shows whether the data are the same; pairs are matched by name"
    events, truth = (
        _hashes_differ(a, b) for a, b in ((one.events, two.events), (one.truth, two.truth))
    )
    if events is False and truth is False:
        return ""
    windows = any(same_time(one, two, w) for w in one.times if w in two.times) or not one.times
    paired = f"seeds {'and windows ' if windows else ''}are paired, pixels are not"
    if truth is False:
        return f"not the same events, the same true depth; {paired}"
    if events is False:
        return f"the same events, another true depth; {paired}"
    return f"not the same data (other events{' and another true depth' if truth else ''}); {paired}"


def _hashes_differ(a: str, b: str) -> bool | None:
    """Whether two hashes differ; None where one is not known."""
    return a != b if a and b else None


def other_truth(
    case: str, first: ComparedResult, other: ComparedResult, seeds: Sequence[int | None]
) -> bool:
    """Whether one of the common seeds has another true depth, as far as that is known."""
    truths = ((first.cases[case, seed].truth, other.cases[case, seed].truth) for seed in seeds)
    return any(_hashes_differ(a, b) for a, b in truths)


def only_in_one(first: ComparedResult, other: ComparedResult) -> Iterator[str]:
    """What only one of two results has: it is not compared."""
    for one, two in ((first, other), (other, first)):
        lacking = [case for case in one.names if case not in two.names]
        if lacking:
            yield f"Only {one.name} has the case{'s' * (len(lacking) > 1)} {', '.join(lacking)}."
        yield from _grouped(one, two, "method", _only_methods)
        yield from _grouped(one, two, "seed", _only_seeds)
        yield from _grouped(one, two, "window", _only_windows)
        for job, reason in one.failures.items():
            yield f"Failed in {one.name}: {job}: {reason}"


def _grouped(
    one: ComparedResult, two: ComparedResult, noun: str, lacking: Lacking
) -> Iterator[str]:
    groups: dict[tuple[str, ...], list[str]] = {}
    shared = [case for case in one.names if case in two.names]
    for case in shared:
        if found := tuple(lacking(one, two, case)):
            groups.setdefault(found, []).append(case)
    for found, cases in groups.items():
        where = "" if len(cases) == len(shared) else f" in {', '.join(cases)}"
        yield f"Only {one.name} has the {noun}{'s' * (len(found) > 1)} {', '.join(found)}{where}."


def _only_methods(one: ComparedResult, two: ComparedResult, case: str) -> list[str]:
    known = two.first(case).methods
    return [method for method in one.first(case).methods if method not in known]


def _only_seeds(one: ComparedResult, two: ComparedResult, case: str) -> list[str]:
    return [_seed_text(seed) for seed in one.seeds(case) if seed not in two.seeds(case)]


def _only_windows(one: ComparedResult, two: ComparedResult, case: str) -> list[str]:
    a, b = one.first(case), two.first(case)
    names = dict.fromkeys(w for values in a.values.values() for w in values if w != WHOLE)
    known = {w for values in b.values.values() for w in values}
    return [_at(a, w) for w in names if w not in known or not same_time(a, b, w)]


def _at(case: CaseResult, window: str) -> str:
    time = case.times.get(window)
    return f"{window} at {time.reference_s:.6g} s" if time else window


def nothing_in_common(first: ComparedResult, other: ComparedResult, metric: str) -> str:
    """Why two results cannot be compared, and what could, such as `metric`."""
    texts = []
    for result in (first, other):
        methods = dict.fromkeys(m for case in result.names for m in result.first(case).methods)
        texts.append(f"{result.name} has {_few(result.names)} with {_few(methods)}")
    return (
        f"nothing to compare: {'; '.join(texts)}; give results that share a case, a method and a "
        f"metric such as {metric}"
    )


def _few(names: Iterable[str]) -> str:
    found = list(names)
    more = f" and {len(found) - 4} more" if len(found) > 4 else ""
    return ", ".join(found[:4]) + more if found else "nothing"
