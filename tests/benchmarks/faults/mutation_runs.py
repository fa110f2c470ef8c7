"""Judges the mutations that `mutations` draws: does `quick` with its gate see them, or a unit test?

`python tests/benchmarks mutation_runs` plants one after the other in a copy of the packages and
runs `quick` with its first seed and the strict gate, the cheap cases first, until one is red. What
all of them leave green meets the unit tests of the folder that belongs to the changed file. What
passes those as well was missed, unless `mutation_reasons.json` says why nothing could see it. Each
verdict is a line of `mutation_verdicts.jsonl`: a run that was stopped goes on where it was.
`--table` prints them by area.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import fault_runs
from mutations import AREAS, SEED, drawn
from planted_faults import ROOT, broken_copy

HERE = Path(__file__).parent
VERDICTS, REASONS = HERE / "mutation_verdicts.jsonl", HERE / "mutation_reasons.json"
ROUNDS = (("oblique", "plain", "low-texture"), ("boxes",), ("planes", "desk"), ("boxes-ranked",))
"""Cases of `quick`, the cheap ones first: what is red there needs no others."""
RANKED = ("emvs/baselines/", "plugins/learned/networks/")
"""What only the last of them runs."""
NEEDED = ("tests", "docs", "reports", "pyproject.toml", "README.md", "Makefile", "CONTRIBUTING.md")
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
KINDS = ("quick", "tests", "equivalent", "unreachable", "missed")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, help="folder for copies and the cache; kept")
    parser.add_argument("--limit-s", type=float, default=900, help="for one run, s")
    parser.add_argument("--table", action="store_true", help="print the table, and run nothing")
    asked = parser.parse_args()
    if asked.table:
        verdicts, names = read(VERDICTS), {one.digest for _, one in drawn()}
        of_today = {name: one for name, one in verdicts.items() if name in names}
        sys.stdout.write(table(of_today, json.loads(REASONS.read_text())))
        return
    if asked.work is None:
        parser.error("needs --work or --table")
    fault_runs.LIMIT_S = asked.limit_s
    judge_all(drawn(), Judge(asked.work, asked.work / "cache"))


def judge_all(order, judge):
    """First everything by `quick`, then what is left, but for what has its reason, by tests."""
    for area, mutation in order:
        if mutation.digest not in read(VERDICTS):
            note(area, mutation, *judge.by_quick(mutation))
    known = json.loads(REASONS.read_text(encoding="utf-8"))
    for area, mutation in order:
        if mutation.digest in known:
            continue
        if read(VERDICTS)[mutation.digest]["seen"] == "green":
            note(area, mutation, *judge.by_tests(mutation))


def note(area, mutation, seen, by):
    """Adds a verdict: the last line about a mutation holds."""
    about = {"digest": mutation.digest, "area": area, "file": mutation.file}
    change = {"line": mutation.number, "before": mutation.before.strip()}
    text = json.dumps({**about, **change, "after": mutation.after.strip(), "seen": seen, "by": by})
    with VERDICTS.open("a", encoding="utf-8") as stream:
        stream.write(text + "\n")
    sys.stdout.write(f"{time.strftime('%H:%M:%S')} {text}\n")
    sys.stdout.flush()


def read(path):
    """The verdicts by digest."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {one["digest"]: one for one in map(json.loads, lines)}


class Judge:
    """Runs what a mutation may break, in one place: compiled kernels are kept by path."""

    def __init__(self, work, cache):
        self.copy, self.cache, self.whole = work / "run" / "copy", cache, work / "whole"
        os.environ["NUMBA_CACHE_DIR"] = str(work / "kernels")

    def by_quick(self, mutation):
        """`red` and what the gate names first, or `green`."""
        for cases in ROUNDS[:: -1 if mutation.file.startswith(RANKED) else 1]:
            broken_copy(self.copy, mutation)
            try:
                some = ("--seeds", "0", "--workers", "1")
                code, verdicts = fault_runs.gate(self.copy, self.cache, *some, cases=cases)
            except fault_runs.TooSlow:
                return "red", "does not end"
            except AssertionError as error:
                return "red", "ends with an error: " + str(error).strip().splitlines()[-1][:90]
            if code:
                return "red", first_of(verdicts)
        return "green", ""

    def by_tests(self, mutation):
        """`tests` and the one that fails with the mutation and not without, or `none`."""
        broken_copy(self.copy, mutation, more=NEEDED)
        broken_copy(self.whole, more=NEEDED)
        known = []
        for what in tests_of(mutation.file):
            while (failed := self._first_failure(self.copy, what, known)) not in ("", *known):
                if not self._first_failure(self.whole, failed, []):
                    return "tests", failed
                known.append(failed)
        return "none", ""

    def _first_failure(self, copy, what, known):
        skipped = [word for one in known for word in ("--deselect", one)]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
        try:
            done = subprocess.run(
                [*command, *what.split(), *skipped],
                cwd=copy,
                env={**os.environ, "PYTHONPATH": str(copy)},
                capture_output=True,
                text=True,
                timeout=fault_runs.LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"{what} (does not end)"
        if done.returncode in (0, 5):
            return ""
        found = _FAILED.search(done.stdout)
        return found[1] if found else f"{what} (ends with {done.returncode})"


def first_of(verdicts):
    """What the gate names first; nothing where only its exit code is red."""
    red = fault_runs.red(verdicts)
    return " ".join(red[0][part] for part in ("case", "method", "metric")) if red else "exit code"


def tests_of(file):
    """What to run, the nearest first: named after the file, its folder's, and wider and wider."""
    top, *inside = Path(file).parts[:-1]
    home = ROOT / "tests" / top if top != "plugins" else ROOT / top / inside.pop(0) / "tests"
    folder = home.joinpath(*inside)
    while not folder.is_dir():
        folder = folder.parent
    own, every = (
        " ".join(sorted(path.relative_to(ROOT).as_posix() for path in folder.glob(pattern)))
        for pattern in (f"test_{Path(file).stem.removesuffix('_kernels')}*.py", "test_*.py")
    )
    package = home.joinpath(*inside[:1])
    whole = package if package.is_dir() else folder
    wider = (path.relative_to(ROOT).as_posix() for path in (whole, home))
    return [what for what in dict.fromkeys((own, every, *wider)) if what]


def kind(verdict, reasons):
    """One of `KINDS`; None while it is not judged."""
    seen = verdict["seen"]
    if seen in ("red", "tests"):
        return {"red": "quick", "tests": "tests"}[seen]
    said = reasons.get(verdict["digest"])
    if said is not None:
        return said["kind"]
    return "missed" if seen == "none" else None


def table(verdicts, reasons):
    """Counts by area, shares of those that change anything, and what was missed."""
    by_area = {area: Counter() for area in AREAS}
    for one in verdicts.values():
        by_area[one["area"]][kind(one, reasons)] += 1
    total = sum(by_area.values(), Counter())
    lines = [
        "| Area | Drawn | Red in `quick` | Red in unit tests | Equivalent | Unreachable | Missed |",
        "|---|--:|--:|--:|--:|--:|--:|",
        *(row(area, counts) for area, counts in (*by_area.items(), ("together", total))),
        "",
        shares(total),
    ]
    if missing := sum(count for count, _ in AREAS.values()) - sum(total.values()):
        lines += ["", f"{missing} of those that are drawn were not run yet."]
    missed = [one for one in verdicts.values() if kind(one, reasons) == "missed"]
    if missed:
        lines += ["", "Missed:", "", *map(told, missed)]
    return "\n".join(lines) + "\n"


def row(area, counts):
    cells = [area, str(sum(counts.values())), *(str(counts[one]) for one in KINDS)]
    return f"| {' | '.join(cells)} |"


def shares(total):
    """In per cent of the mutations that change anything."""
    seen, changing = total["quick"] + total["tests"], sum(total.values())
    changing -= total["equivalent"] + total["unreachable"]
    if not changing:
        return "Nothing was judged yet."
    quick, both = 100 * total["quick"] / changing, 100 * seen / changing
    if left := total[None]:
        return (
            f"Seed {SEED}. Of {changing} that may change something, `quick` sees {quick:.0f} %; "
            f"{left} of the others have not met the unit tests yet."
        )
    return (
        f"Seed {SEED}. Of {changing} that change anything, `quick` sees {quick:.0f} %, with the "
        f"unit tests {both:.0f} %."
    )


def told(one):
    return f"- `{one['file']}`: `{one['before']}` → `{one['after']}`"


if __name__ == "__main__":
    main()
