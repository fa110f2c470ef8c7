"""Verdicts for people: a sentence each, a table of what matters, and the same in Markdown."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence

from eval.gate import RED, Verdict

HEADINGS = ("verdict", "case", "method", "metric", "baseline", "now", "change", "allowed", "why")
MOST_LINES = 25

VerdictLine = tuple[str, ...]


def summary(verdicts: Sequence[Verdict]) -> str:
    """How many of each, and who is to blame."""
    counts = Counter(one.status for one in verdicts)
    words = ", ".join(f"{count} {status}" for status, count in counts.items())
    red = [one for one in verdicts if one.status in RED]
    if not red:
        return f"gate: green ({words or 'nothing to compare'})"
    return f"gate: red ({words}); first: {sentence(red[0])}"


def sentence(one: Verdict) -> str:
    """One verdict in words."""
    what = " ".join(part for part in one.key if part)
    if one.why:
        return f"{what} {one.status}: {one.why}"
    unit = f" {one.unit}" if one.unit else ""
    if one.status == "new":
        return f"{what} new: {_number(one.value)}{unit}"
    return (
        f"{what} {one.status}: {_number(one.value)}{unit} against {_number(one.baseline)}{unit}, "
        f"± {_number(one.tolerance)}{unit} allowed"
    )


def lines(verdicts: Sequence[Verdict]) -> list[VerdictLine]:
    """The table's cells: all that is not `same`, the worst first, at most `MOST_LINES`."""
    return [_cells(one) for one in _shown(verdicts)[:MOST_LINES]]


def hidden(verdicts: Sequence[Verdict]) -> int:
    """How many lines the table leaves out."""
    return max(0, len(_shown(verdicts)) - MOST_LINES)


def markdown(verdicts: Sequence[Verdict], name: str) -> str:
    """A summary and the table."""
    parts = [f"### {name}: {'red' if _red(verdicts) else 'green'}", "", summary(verdicts), ""]
    rows = lines(verdicts)
    if rows:
        parts += [_row(HEADINGS), _row(["---"] * len(HEADINGS)), *map(_row, rows), ""]
    if hidden(verdicts):
        parts += [f"and {hidden(verdicts)} more", ""]
    return "\n".join(parts)


def as_json(verdicts: Sequence[Verdict]) -> str:
    """All verdicts for programs; undefined numbers are null."""
    content = [
        {
            **one.key._asdict(),
            "status": one.status,
            "unit": one.unit,
            "baseline": _defined(one.baseline),
            "value": _defined(one.value),
            "tolerance": _defined(one.tolerance),
            "why": one.why,
        }
        for one in verdicts
    ]
    return json.dumps(content, indent=1, ensure_ascii=False)


def _defined(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _red(verdicts: Sequence[Verdict]) -> bool:
    return any(one.status in RED for one in verdicts)


def _shown(verdicts: Sequence[Verdict]) -> list[Verdict]:
    return [one for one in verdicts if one.status != "same"]


def _cells(one: Verdict) -> VerdictLine:
    change = f"{one.change:+.3g}" if math.isfinite(one.change) else ""
    allowed = f"± {_number(one.tolerance)}" if math.isfinite(one.tolerance) else ""
    numbers = (_with_unit(one.baseline, one.unit), _with_unit(one.value, one.unit))
    return (one.status, *one.key, *numbers, change, allowed, one.why)


def _with_unit(value: float, unit: str) -> str:
    return f"{_number(value)} {unit}".strip() if math.isfinite(value) else ""


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(_escaped(cells))} |"


def _escaped(cells: Sequence[str]) -> Iterator[str]:
    for cell in cells:
        yield cell.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ")
