"""What a check says: findings with a verdict, the evidence as a number, and the cure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Verdict = Literal["good", "doubtful", "wrong"]
VERDICTS: tuple[Verdict, ...] = ("good", "doubtful", "wrong")


@dataclass(frozen=True, eq=False)
class Series:
    """A curve or an image that shows what a finding rests on.

    Attributes:
        y: (N,) the curve, or (H, W) the image.
        x: (N,) where it is known; empty for an image.
        x_label: quantity and unit.
        y_label: quantity and unit.
        limits: levels of y between verdicts, drawn as lines.
    """

    y: NDArray[np.float64]
    x: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    x_label: str = ""
    y_label: str = ""
    limits: tuple[float, ...] = ()

    def to_json(self) -> dict[str, Any] | None:
        """Plain numbers of a curve; None of an image, which a page shows."""
        if self.y.ndim != 1:
            return None
        curve = {"x": _plain(self.x), "y": _plain(self.y)}
        return {**curve, "x_label": self.x_label, "y_label": self.y_label}


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: what was looked at, such as `poses-speed`; the same in every recording.
        verdict: good, doubtful or wrong.
        value: the evidence as a number; None where there is none to give.
        unit: of the value; empty for a share or a ratio.
        evidence: the same in words, with what it is compared with.
        meaning: what it means for a map; empty where all is good.
        cure: what to do; empty where all is good.
        suspect: what is wrong, in a word or two, where the check can tell: `poses inverted`.
        series: what a page draws of it.
    """

    name: str
    verdict: Verdict
    value: float | None
    unit: str
    evidence: str
    meaning: str = ""
    cure: str = ""
    suspect: str = ""
    series: Series | None = None

    def line(self) -> str:
        """The finding in one line, for a warning."""
        named = f"{self.suspect}: " if self.suspect else ""
        return f"{self.name} {self.verdict}: {named}{self.evidence}; {self.cure}"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        series = None if self.series is None else self.series.to_json()
        return {
            "name": self.name, "verdict": self.verdict, "suspect": self.suspect,
            "value": None if self.value is None or not np.isfinite(self.value) else self.value,
            "unit": self.unit, "evidence": self.evidence, "meaning": self.meaning,
            "cure": self.cure, "series": series,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Report:
    """All findings about one recording.

    Attributes:
        name: of the recording.
        findings: what was looked at, in the order in which causes lie.
        unchecked: what could not be looked at, and why.
    """

    name: str
    findings: tuple[Finding, ...]
    unchecked: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(self.of(verdict))} {verdict}" for verdict in VERDICTS)
        return f"Report({self.name!r}: {counts})"

    def of(self, verdict: Verdict) -> tuple[Finding, ...]:
        """The findings with a verdict."""
        return tuple(one for one in self.findings if one.verdict == verdict)

    @property
    def verdict(self) -> Verdict:
        """The worst of all."""
        return worst(one.verdict for one in self.findings)

    @property
    def suspects(self) -> tuple[str, ...]:
        """What is named as wrong, each once; first what comes first."""
        named = [one.suspect or one.name for one in self.of("wrong")]
        return tuple(dict.fromkeys(named))

    def finding(self, name: str) -> Finding | None:
        """The finding of a name, if that was looked at."""
        return next((one for one in self.findings if one.name == name), None)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "recording": self.name,
            "verdict": self.verdict,
            "suspects": list(self.suspects),
            "findings": [one.to_json() for one in self.findings],
            "unchecked": [{"name": name, "reason": reason} for name, reason in self.unchecked],
        }


def worst(verdicts: Any) -> Verdict:
    """The worst of some verdicts; good where there are none."""
    return max(verdicts, key=VERDICTS.index, default="good")


def above(value: float, doubtful: float, wrong: float) -> Verdict:
    """The verdict on a value that should be small; what is no number is wrong."""
    if not value <= wrong:
        return "wrong"
    return "doubtful" if value > doubtful else "good"


def below(value: float, doubtful: float, wrong: float) -> Verdict:
    """The verdict on a value that should be large; what is no number is wrong."""
    if not value >= wrong:
        return "wrong"
    return "doubtful" if value < doubtful else "good"


def judged(
    name: str, verdict: Verdict, value: float | None, unit: str, evidence: str, *,
    meaning: str, cure: str, suspect: str = "", series: Series | None = None,
) -> Finding:  # fmt: skip
    """A finding that says what it means, and how to cure it, only where something is amiss."""
    if verdict == "good":
        return Finding(name, verdict, value, unit, evidence, series=series)
    return Finding(name, verdict, value, unit, evidence, meaning, cure, suspect, series)


def _plain(values: Sequence[float] | NDArray[np.float64]) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
