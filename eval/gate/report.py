"""Verdicts for people and machines: sentences, tables, Markdown, and JUnit XML."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree as xml

from eventsweep.emvs.errors import significant
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.gate.compare import COMPARED, DECIDING, INPUT, Alike, Judgement, is_red
from eventsweep.eval.numbers import display_unit, in_display_unit
from eventsweep.eval.results.table import EVENTS

HEADINGS = ("verdict", "case", "method", "metric", "baseline", "now", "change", "allowed", "why")
CAPTION = "everything that changed; numbers in brackets are shown but do not decide"
MOST_LINES = 25
MOST_METRICS = 8
_ALIKE: dict[Alike, str] = {
    "sequence": "of the same sequences (by hash)",
    "recipe": "of other sequences, made from the same scene and settings by the same simulator",
    "seeds": "of other sequences with the same seeds",
    "nothing": "of other seeds",
}
VerdictLine = tuple[str, ...]
# XML 1.0 has no way at all to write most control characters.
_UNWRITABLE = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def summary(verdicts: Sequence[Judgement]) -> str:
    """How many of each, which metrics decide, and who is to blame."""
    counts = _counts(verdict for verdict in verdicts if verdict.decides)
    beside = _counts(verdict for verdict in verdicts if not verdict.decides)
    counts += f"; not deciding: {beside}" if beside else ""
    red = [verdict for verdict in _shown(verdicts) if verdict.is_red]
    ending = f"{_of_input(verdicts)}{_of_better(verdicts)}. {_of_tolerance(verdicts)}".rstrip()
    if not red:
        return f"gate: green ({counts}){ending}"
    by = Counter(verdict.key.metric for verdict in red if verdict.key.metric)
    most = sorted(by.items(), key=lambda one: (one[0] not in DECIDING, -one[1]))
    metrics = ", ".join(f"{metric} ({count})" for metric, count in most[:MOST_METRICS])
    metrics += f" and {len(most) - MOST_METRICS} more" * (len(most) > MOST_METRICS)
    decided = f"; decided by {metrics}" if metrics else ""
    return f"gate: red ({counts}){decided}; first: {sentence(red[0])}{ending}"


def _counts(verdicts: Iterable[Judgement]) -> str:
    numbers = Counter(verdict.status for verdict in verdicts)
    return ", ".join(f"{count} {status}" for status, count in numbers.items())


def _of_better(verdicts: Sequence[Judgement]) -> str:
    """What is better is a change as well, which the baseline should know of."""
    better = sum(verdict.status == "better" and verdict.decides for verdict in verdicts)
    if not better:
        return ""
    many = "1 number is" if better == 1 else f"{better} numbers are"
    return f". {many} better by more than is allowed: if that is intended, write it with --update"


def _of_tolerance(verdicts: Sequence[Judgement]) -> str:
    """Which tolerance applied, and why."""
    numbers = Counter(verdict.alike for verdict in verdicts if verdict.alike)
    if not numbers:
        return ""
    return "Compared: " + ", ".join(f"{count} {_ALIKE[kind]}" for kind, count in numbers.items())


def _of_input(verdicts: Sequence[Judgement]) -> str:
    """Said loudly: with other events, no depth is better or worse than before."""
    red = [verdict for verdict in verdicts if verdict.is_red and verdict.key.method == EVENTS]
    lost = {verdict.key.case: None for verdict in red if verdict.alike == "sequence"}
    given = {verdict.key.case: None for verdict in red if _is_of_input(verdict)}
    said = ""
    if lost:
        said += (
            f". THE MAPPER TOOK OTHER EVENTS ({', '.join(lost)}) of the same sequence: other "
            "windows, or events lost or counted twice"
        )
    if given:
        said += (
            f". THE INPUT CHANGED ({', '.join(given)}): the mapper received other events than the "
            "baseline's, so these depths cannot judge it; if that is intended, write a new "
            "baseline with the reason"
        )
    return said


def _is_of_input(verdict: Judgement) -> bool:
    is_input = verdict.key.metric in INPUT and verdict.status == "changed"
    return is_input and verdict.alike != "sequence"


def sentence(one: Judgement) -> str:
    """One verdict in words."""
    what = " ".join(part for part in one.key if part)
    if one.why:
        return f"{what} {one.status}: {one.why}"
    value, baseline = _with_unit(one.value, one.unit), _with_unit(one.baseline, one.unit)
    if one.status == "new":
        return f"{what} new: {value}"
    allowed = _with_unit(one.tolerance, one.unit)
    return f"{what} {one.status}: {value} against {baseline}, ± {allowed} allowed"


def lines(verdicts: Sequence[Judgement]) -> list[VerdictLine]:
    """The table's cells: all that is not `same`, the worst first, at most `MOST_LINES`."""
    return [_cells(one) for one in _shown(verdicts)[:MOST_LINES]]


def hidden(verdicts: Sequence[Judgement]) -> int:
    """How many lines the table leaves out."""
    return max(0, len(_shown(verdicts)) - MOST_LINES)


def markdown(verdicts: Sequence[Judgement], name: str) -> str:
    """A summary and the table."""
    colour = "red" if is_red(verdicts) else "green"
    parts = [f"### {name}: {colour}", "", summary(verdicts), ""]
    rows = lines(verdicts)
    if rows:
        parts += [_row(HEADINGS), _row(["---"] * len(HEADINGS)), *map(_row, rows), ""]
        parts += [f"{CAPTION}.", ""]
    if hidden(verdicts):
        parts += [f"and {hidden(verdicts)} more", ""]
    return "\n".join(parts)


def as_json(verdicts: Sequence[Judgement]) -> str:
    """All verdicts for programs; undefined numbers are null."""
    content = [
        {
            **verdict.key._asdict(),
            "status": verdict.status,
            "decides": verdict.decides,
            "is_red": verdict.is_red,
            "unit": verdict.unit,
            "baseline": _defined(verdict.baseline),
            "value": _defined(verdict.value),
            "tolerance": _defined(verdict.tolerance),
            "why": verdict.why,
            "alike": verdict.alike,
        }
        for verdict in verdicts
    ]
    return json.dumps(content, indent=1, ensure_ascii=False)


def _defined(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _shown(verdicts: Sequence[Judgement]) -> list[Judgement]:
    """All that is not `same`; where every number decides, the telling ones come first."""

    def is_minor(one: Judgement) -> bool:
        return one.key.method != EVENTS and one.key.metric not in ("", *DECIDING)

    shown = (verdict for verdict in verdicts if verdict.status != "same")
    return sorted(shown, key=lambda one: (not one.is_red, not one.decides, is_minor(one)))


def _cells(one: Judgement) -> VerdictLine:
    change = f"{in_display_unit(one.change, one.unit):+.3g}" if math.isfinite(one.change) else ""
    allowed = f"± {_number(one.tolerance, one.unit)}" if math.isfinite(one.tolerance) else ""
    numbers = (_with_unit(one.baseline, one.unit), _with_unit(one.value, one.unit))
    status = one.status if one.decides else f"({one.status})"
    return (status, *one.key, *numbers, change, allowed, one.why)


def _with_unit(value: float, unit: str) -> str:
    return f"{_number(value, unit)} {display_unit(unit)}".strip() if math.isfinite(value) else ""


def _number(value: float, unit: str) -> str:
    return significant(in_display_unit(value, unit))


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(_escaped(cells))} |"


def _escaped(cells: Sequence[str]) -> Iterator[str]:
    for cell in cells:
        yield cell.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ")


def write_junit(path: Path, verdicts: Sequence[Judgement]) -> None:
    """One test case per number: failed where it is red, skipped where nothing was compared."""
    red = sum(verdict.is_red for verdict in verdicts)
    skipped = sum(not verdict.is_red and verdict.status not in COMPARED for verdict in verdicts)
    suite = xml.Element("testsuite", name="eventsweep gate", tests=str(len(verdicts)))
    suite.attrib |= {"failures": str(red), "errors": "0", "skipped": str(skipped), "time": "0"}
    for verdict in verdicts:
        names = {
            "classname": verdict.key.case,
            "name": f"{verdict.key.method} {verdict.key.metric}",
        }
        case = xml.SubElement(suite, "testcase", {k: _clean(v) for k, v in names.items()}, time="0")
        message = _clean(sentence(verdict))
        if verdict.is_red:
            xml.SubElement(case, "failure", type=verdict.status, message=message)
        elif verdict.status not in COMPARED:
            xml.SubElement(case, "skipped", message=message)
    root = xml.Element("testsuites")
    root.append(suite)
    xml.indent(root)
    with atomic_path(path) as partial:
        xml.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _clean(text: str) -> str:
    return _UNWRITABLE.sub("\ufffd", text).strip()
