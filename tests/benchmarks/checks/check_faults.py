"""How often `eventsweep check` names a planted fault, and accuses a recording that is right.

    python tests/benchmarks check_faults --out FOLDER [--page PAGE]

Sequences and verdicts are kept in the folder: the same command takes up what is done, and checks
again what other code checked. The campaign is the last one, which was opened once: it plants each
new kind and every other known one. Earlier ones, which chose the rules, are in commit 77cd9c78.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta

import check_cases
import eventsweep as es
import eventsweep.plugins.diagnose.check
import planting
from check_cases import FAULTS, NEW, UNSPOILT, Base
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.plugins.diagnose.check.recording import check
from markdown_blocks import show
from planting import UNKNOWN, Planter
from table_code import Code, of_scenes

_METHOD, _STARTS_S, _WINDOW_S = "Alg1/H", (0.05, 0.2, 0.35), 0.2
_HARMLESS = 0.1


def harm(right: Recording, spoilt: Recording) -> dict[str, Any]:
    """By how many times error and points change: `error`, `points` and whether `harmless`.

    The rule was stated before any campaign was opened under it: a fault is harmless if, over three
    windows, the mean relative error of the depth (`Alg1/H`) grows by less than a tenth and the
    points fall by less than a tenth. The studies call a property harmful where the error doubles.

    Args:
        right: the recording as simulated, which knows the depth.
        spoilt: the same with a fault.
    """
    before, after = (np.mean([_scores(r, right, s) for s in _STARTS_S], axis=0)
                     for r in (right, spoilt))  # fmt: skip
    error, points = map(float, after / before)
    harmless = error < 1 + _HARMLESS and points > 1 - _HARMLESS
    return {"error": error, "points": points, "harmless": harmless}


def _scores(recording: Recording, right: Recording, start_s: float) -> tuple[float, float]:
    """Relative error, %, and points of a window's map; a window that cannot be mapped is harmed."""
    config = es.MapperConfig(methods=(_METHOD,), start_s=start_s, duration_s=_WINDOW_S)
    try:
        rows = es.score(es.map_window(recording, config), right).rows
    except InputError:
        return np.inf, 0.0
    own = rows[(rows.method == _METHOD) & (rows.window == "w000") & (rows.region == "all")]
    values = dict(zip(own.metric, own.value, strict=True))
    return float(values["abs_rel"]), float(values["points"])


SECONDS = 0.6


@dataclass(frozen=True)
class Case:
    """One recording to check.

    Attributes:
        base: the sequence that it is made from.
        kind: what is planted, or how it is told.
        named: what `check` may call it; empty where nothing is wrong.
        plant: makes it, in memory.
    """

    base: Base
    kind: str
    named: tuple[str, ...]
    plant: Planter

    @property
    def name(self) -> str:
        """Of its verdict's file."""
        spoilt = "fault" if self.named else "right"
        return f"{spoilt} {self.kind} {self.base.name}".replace(" ", "_").replace("/", "-")


# Scenes on which faults are not planted: bodies that move by themselves, empty walls. Nothing must
# be accused there all the same.
_HARD = ("low-texture", "moving-objects")


def cases() -> list[Case]:
    """All recordings to check, in an order that never changes: the first are a fair sample."""
    kinds = [*UNSPOILT] * len(NEW)  # two ways to describe each, the next one in those that follow
    every = [
        Case(base, kind, (), UNSPOILT[kind])
        for k, base in enumerate(NEW) for kind in kinds[2 * k : 2 * k + 2]
    ]  # fmt: skip
    stereo = [base for base in NEW if base.scene not in _HARD]
    new, known = ([f for f in FAULTS if f.is_new == is_new] for is_new in (True, False))
    for k, fault in enumerate((*new, *known[::2])):
        every.append(Case(stereo[k % len(stereo)], fault.kind, fault.named, fault.plant))
    return sorted(every, key=lambda case: zlib.crc32(case.name.encode()))


def sequence(base: Base, out: Path) -> Path:
    """The simulated sequence, kept if it is there."""
    path: Path = out / "sequences" / base.name
    if not (path / "manifest.json").exists():
        config = es.SimConfig(duration_s=SECONDS, sensor={"preset": base.sensor})
        es.simulate(base.scene, path, config, seed=base.seed, rig=base.rig)
    return path


def verdict(case: Case, out: Path, code: str) -> dict[str, Any]:
    """What `check` says of a case: kept if the same code said it."""
    file = out / "verdicts" / f"{case.name}.json"
    kept: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {}
    if kept.get("code") == code:
        return kept
    path = sequence(case.base, out)
    began = time.process_time()
    report = check(_spoilt(case, path))
    answer = {
        "code": code, "kind": case.kind, "base": case.base.name, "named": list(case.named),
        "suspects": list(report.suspects),
        "cures": [finding.suspect for finding in report.of("wrong") if finding.cure],
        "cpu_s": time.process_time() - began,
        "doubtful": [finding.suspect or finding.name for finding in report.of("doubtful")],
        "lines": [finding.line() for finding in report.findings if finding.verdict != "good"],
        "unchecked": list(map(list, report.unchecked)),
    }  # fmt: skip
    if outcome(answer) == "unnoticed":
        answer["harm"] = harm(es.open_recording(path), _spoilt(case, path))
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(file) as partial:
        partial.write_text(json.dumps(answer, indent=1))
    return answer


def _spoilt(case: Case, path: Path) -> Recording:
    rng = np.random.default_rng(zlib.crc32(case.name.encode()))
    spoilt: Recording = case.plant(es.open_recording(path), rng)
    return spoilt


def checks_version() -> str:
    """A hash of the code whose verdicts these are."""
    folder = Path(str(eventsweep.plugins.diagnose.check.__file__)).parent
    files = [*sorted(folder.glob("*.py")), *sorted(folder.parent.glob("sharpness*.py"))]
    files += [Path(str(module.__file__)) for module in (planting, check_cases)]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


OUTCOMES = ("named", "unknown", "wrong cure", "unnoticed", "harmless")


def outcome(answer: dict[str, Any]) -> str:
    """What a check came to: one of `OUTCOMES`.

    A fault is named if it is the first thing that is called wrong, alone or as one of several
    causes that the check cannot tell apart; of two faults both must be, or one that is to be cured
    before the check goes on. It is unknown if no cause is named, or something else is called odd,
    without a cure. One that is not noticed is harmless if it changes the map by less than
    `harm` says. Of a recording that is right,
    `named` is that nothing is called wrong, and `wrong cure` the rest.
    """
    if not answer["suspects"]:
        if not answer["named"] or set(UNKNOWN) & set(answer["doubtful"]):
            return "unknown" if answer["named"] else "named"
        return "harmless" if answer.get("harm", {}).get("harmless") else "unnoticed"
    first, right = answer["suspects"][0], set(answer["named"])
    if not answer["lines"][0].startswith("mapping"):  # a certain one, to be cured first
        right |= {name for both in right for name in both.split(" and ")}
    if right & set(first.split(" or ")):
        return "named"
    return "wrong cure" if first in answer["cures"] or not right else "unknown"


def table(answers: Sequence[dict[str, Any]]) -> str:
    """The confusion table of what was checked, as Markdown."""
    rows = pd.DataFrame(answers).assign(outcome=list(map(outcome, answers)))
    new = {fault.kind for fault in FAULTS if fault.is_new}
    is_fault, accused = (rows[column].str.len() > 0 for column in ("named", "suspects"))
    is_new = rows.kind.isin(new)
    faults, right = rows[is_fault], rows[~is_fault]
    bad, cured = int(accused[~is_fault].sum()), int((faults.outcome == "wrong cure").sum())
    doubted = int((~accused & (rows.doubtful.str.len() > 0))[~is_fault].sum())
    known = rows[is_fault & ~is_new]
    lines = [
        *([_summary("known kinds", known)] if len(known) else []),
        _summary("new kinds", rows[is_fault & is_new]),
        f"Of {len(right)} unspoilt ones {bad} ({bad / len(right):.1%}) are accused; "
        f"{doubted} more have a doubtful finding.",
        f"With 95 % confidence, at most {_at_most(cured, len(faults)):.1%} of such faults get a "
        f"wrong cure, and at most {_at_most(bad, len(right)):.1%} of unspoilt ones are accused.",
        "",
        f"| Planted | cases | {' | '.join(OUTCOMES)} | called instead |",
        "|---|--:|--:|--:|--:|--:|--:|---|",
    ]
    is_sure = (faults.outcome == "named").groupby(faults.kind).transform("all")
    kinds = sorted(faults[~is_sure].kind.unique(), key=lambda kind: (kind in new, kind))
    lines += [_line(kind + " *" * (kind in new), faults[faults.kind == kind]) for kind in kinds]
    named = faults[is_sure]
    lines += [
        _line(f"the other {named.kind.nunique()} kinds", named),
        _line("nothing (unspoilt)", right),
        "", "\\* of a new kind.", "",
        f"A check took {rows.cpu_s.mean():.1f} s of CPU time on average, "
        f"{rows.cpu_s.median():.1f} s in the median, {rows.cpu_s.max():.0f} s at most.", "",
    ]  # fmt: skip
    return "\n".join(lines)


def _at_most(count: int, of: int) -> float:
    """The upper limit of a share, one-sided, 95 % (Clopper and Pearson, Biometrika 1934)."""
    return float(beta.ppf(0.95, count + 1, of - count)) if count < of else 1.0


def _summary(kinds: str, faults: pd.DataFrame) -> str:
    count, all_of = Counter(faults.outcome), max(1, len(faults))
    return (
        f"Of {len(faults)} recordings with a planted fault of {kinds}, {count['named']} "
        f"({count['named'] / all_of:.1%}) are named first and rightly, {count['unknown']} are "
        f"called wrong or doubtful without a cause, {count['wrong cure']} "
        f"({count['wrong cure'] / all_of:.1%}) get a wrong cure, {count['unnoticed']} are not "
        f"noticed; {count['harmless']} more are not noticed, but harmless. So "
        f"{(count['named'] + count['unknown']) / max(1, all_of - count['harmless']):.1%} of the "
        "others are named rightly or said to be unknown."
    )


def _line(kind: str, rows: pd.DataFrame) -> str:
    count = Counter(rows.outcome)
    instead = Counter(rows[rows.outcome == "wrong cure"].suspects.str[0])
    words = ", ".join(f"{name} ({count})" for name, count in instead.items())
    cells = " | ".join(str(count[name]) for name in OUTCOMES)
    return f"| {kind} | {len(rows)} | {cells} | {words} |"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "plugins/diagnose/check.md#check-faults": Code(
            ("check_faults:verdict", "check_faults:table", "check_faults:cases"),
        )
        + of_scenes(base.scene for base in NEW)
    }


def main() -> None:
    """Checks every recording, and writes the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for what is kept")
    parser.add_argument("--page", type=Path, help="page whose table is rewritten")
    flags = parser.parse_args()
    version, answers, chosen = checks_version(), [], cases()
    for k, case in enumerate(chosen, 1):
        answers.append(answer := verdict(case, flags.out, version))
        sys.stderr.write(
            f"{k}/{len(chosen)} {outcome(answer)}: {case.kind} | {case.base.name} | "
            f"{answer['suspects']} {answer['doubtful']} {answer['cpu_s']:.1f} s\n"
        )
    show(table(answers), flags.page, "check-faults", code)


if __name__ == "__main__":
    main()
