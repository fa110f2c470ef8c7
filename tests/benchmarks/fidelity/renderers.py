"""What another graphics library changes: the same cases and seeds, rendered anew with each.

Run a suite once with each library (`MUJOCO_GL`, another version of Mesa, a GPU), then
`python tests/benchmarks renderers EGL=out/egl OSMesa=out/osmesa ... --page plugins/ranking/ranking.md`: every
result is compared with the first of its suite. Errors are mean errors, pooled over a sequence; the
short suite is `renderers.toml`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.results import POOLED
from eventsweep.eval.suite.results import EVENTS, SuiteResult, read_suite
from markdown_blocks import show

MARK = "renderers"
ERROR = "mean_error"
_COLUMNS = (
    "renderer", "equal sequences", "error in a sequence: median, largest change \\[%\\]",
    "mean error of a method: largest change \\[%\\]", "the same for another seed \\[%\\]",
)  # fmt: skip
Key = tuple[str, str, int]


@dataclass(frozen=True, slots=True)
class Change:
    """How far numbers move from the first renderer to another, as shares.

    Attributes:
        equal: sequences with the same hash.
        sequences: all that both have.
        each: (N,) change of a method's error in a sequence, absolute.
        means: (M,) change of a method's geometric mean error over all sequences, absolute.
    """

    equal: int
    sequences: int
    each: NDArray[np.float64]
    means: NDArray[np.float64]


def errors_of(result: SuiteResult) -> dict[Key, float]:
    """(case, method, seed) -> mean error, m, where it is positive."""
    rows = result.rows
    kept = rows[(rows["window"] == POOLED) & (rows["metric"] == ERROR) & (rows["method"] != EVENTS)]
    found = zip(kept["case"], kept["method"], kept["seed"], kept["value"], strict=True)
    return {(case, method, int(seed)): value for case, method, seed, value in found if value > 0}


def compare(first: SuiteResult, other: SuiteResult) -> Change:
    """What changes from one renderer to another.

    Raises:
        InputError: no case, method and seed in common.
    """
    before, after = errors_of(first), errors_of(other)
    common = [key for key in before if key in after]
    if not common:
        raise InputError("no case, method and seed in common: run the same suite with each")
    hashes = [{(s.case, s.seed): s.facts.sequence for s in one.samples} for one in (first, other)]
    sequences = [key for key in hashes[0] if key in hashes[1]]
    equal = sum(hashes[0][key] == hashes[1][key] for key in sequences)
    logs = {key: float(np.log(after[key] / before[key])) for key in common}
    return Change(equal, len(sequences), *_changes(logs))


def seed_change(result: SuiteResult) -> NDArray[np.float64]:
    """(M,) how far the methods' mean errors move from the first seed to each other one."""
    errors, (first, *others) = errors_of(result), result.seeds
    found = []
    for seed in others:
        logs = {
            (case, method, seed): float(np.log(errors[case, method, seed] / value))
            for (case, method, at), value in errors.items()
            if at == first and (case, method, seed) in errors
        }
        found.append(_changes(logs)[1])
    return np.concatenate(found) if found else np.array([np.nan])


def _changes(logs: Mapping[Key, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    methods = dict.fromkeys(method for _, method, _ in logs)
    means = [np.mean([log for key, log in logs.items() if key[1] == m]) for m in methods]
    return np.abs(np.expm1(list(logs.values()))), np.abs(np.expm1(means))


def rows_of(results: Mapping[str, SuiteResult]) -> Iterator[tuple[str, ...]]:
    """A line for each result: what rendered it, and what changes from the first of its suite."""
    bases: dict[str, SuiteResult] = {}
    for label, result in results.items():
        name = f"{label}: {result.samples[0].facts.renderer}"
        if result.suite not in bases:
            bases[result.suite] = result
            seeds = 100 * seed_change(result).max()
            count = f"{len(result.samples)} of `{result.suite}`"
            yield name, count, "–", "–", "–" if np.isnan(seeds) else f"{seeds:.2g}"
            continue
        found = compare(bases[result.suite], result)
        equal, each, means = f"{found.equal} of {found.sequences}", 100 * found.each, found.means
        sizes = f"{np.median(each):.2g}, {each.max():.2g}"
        yield name, equal, sizes, f"{100 * means.max():.2g}", ""


def text(results: Mapping[str, SuiteResult]) -> str:
    """The table, and what it was measured on."""
    lines = [f"| {' | '.join(_COLUMNS)} |", "|---|--:|--:|--:|--:|"]
    lines += [f"| {' | '.join(row)} |" for row in rows_of(results)]
    about = [_about(one) for one in {one.suite: one for one in results.values()}.values()]
    return "\n".join([*lines, "", *about]) + "\n"


def _about(result: SuiteResult) -> str:
    methods = {method for _, method, _ in errors_of(result)}
    cases = ", ".join(f"`{case}`" for case in result.cases)
    seeds = ", ".join(map(str, result.seeds))
    return f"`{result.suite}`: {cases}; seeds {seeds}; {len(methods)} methods."


def main() -> int:
    """Prints and writes the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="+", help="LABEL=FOLDER that `suite` wrote")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args()
    with exit_code() as code:
        parts = [one.partition("=") for one in asked.results]
        found = {label: read_suite(Path(place), lambda one: one) for label, _, place in parts}
        show(text(found), asked.page, MARK)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
