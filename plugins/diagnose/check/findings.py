"""Findings of a check: verdict, evidence as a number, cure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.diagnose.check.limits import LIMITS, Verdict

VERDICTS: tuple[Verdict, ...] = ("good", "doubtful", "wrong")


TIME = "time, s"
"""The label of a curve over the recording's times."""


@dataclass(frozen=True, eq=False)
class Series:
    """A curve, bars or an image that shows the evidence of a finding.

    Attributes:
        y: (N,) the curve or bars, or (H, W) the image.
        x: (N,) of the curve; else empty.
        x_label: quantity and unit.
        y_label: quantity and unit.
        limits: levels of y between verdicts, drawn as lines.
        names: of the bars, which lie; empty for a curve.
    """

    y: NDArray[np.float64]
    x: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    x_label: str = ""
    y_label: str = ""
    limits: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any] | None:
        """Plain numbers of a curve; None for an image, which only pages show."""
        if self.y.ndim != 1:
            return None
        x = list(self.names) or _plain(self.x)
        curve = {"x": x, "y": _plain(self.y)}
        return {**curve, "x_label": self.x_label, "y_label": self.y_label}


@dataclass(frozen=True, eq=False)
class Finding:
    """The result of one check.

    Attributes:
        name: of the check, such as `poses-speed`; the same in every recording.
        verdict: good, doubtful or wrong.
        value: the evidence as a number; None if there is none.
        unit: of the value; empty for a share or a ratio.
        evidence: in words, beside what is usual.
        meaning: for a map, and what may be the reason; empty if good.
        cure: of a cause; empty where none is named. Faults look alike in events, poses or
            calibration alone: these findings say what is odd, and only mapping names a cause.
        suspect: what is odd, or the cause, in a word or two: `poses inverted`.
        series: for a plot.
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
        parts = (f"{self.name} {self.verdict}: {named}{self.evidence}", self.cure or self.meaning)
        return "; ".join(filter(None, parts))

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
        findings: causes before their consequences.
        unchecked: checks that were impossible, and why.
    """

    name: str
    findings: tuple[Finding, ...]
    unchecked: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(self.of(verdict))} {verdict}" for verdict in VERDICTS)
        return f"Report({self.name!r}: {counts})"

    def of(self, verdict: Verdict) -> tuple[Finding, ...]:
        """The findings with a verdict."""
        return tuple(finding for finding in self.findings if finding.verdict == verdict)

    @property
    def verdict(self) -> Verdict | Literal["unchecked"]:
        """The worst of all; `unchecked` if nothing is odd, but not all was looked at."""
        verdict = worst(finding.verdict for finding in self.findings)
        return "unchecked" if verdict == "good" and self.unchecked else verdict

    @property
    def suspects(self) -> tuple[str, ...]:
        """What is wrong, without repetition: causes first, else in the order of the findings."""
        causes_first = sorted(self.of("wrong"), key=lambda finding: not finding.cure)
        return tuple(dict.fromkeys(f.suspect or f.name for f in causes_first))

    def finding(self, name: str) -> Finding | None:
        """The finding of a name; None if that was not checked."""
        return next((finding for finding in self.findings if finding.name == name), None)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "recording": self.name,
            "verdict": self.verdict,
            "suspects": list(self.suspects),
            "findings": [finding.to_json() for finding in self.findings],
            "unchecked": [{"name": name, "reason": reason} for name, reason in self.unchecked],
        }


def worst(verdicts: Any) -> Verdict:
    """The worst of some verdicts; good if there are none."""
    return max(verdicts, key=VERDICTS.index, default="good")


def judged(
    name: str, value: float | None, evidence: str, *, verdict: Verdict | None = None,
    suspect: str = "", more: str = "", series: Series | None = None,
) -> Finding:  # fmt: skip
    """A finding of what is odd, without a cure; of what is good, without a meaning.

    Args:
        name: of the check, which has limits.
        value: the evidence as a number.
        evidence: in words.
        verdict: if it is not the limits' on the value.
        suspect: what is odd, if not what the limits say.
        more: added to the meaning.
        series: for a plot.
    """
    limits = LIMITS[name]
    if verdict is None:
        verdict = limits.verdict(float("nan") if value is None else value)
    if verdict == "good":
        return Finding(name, verdict, value, limits.unit, evidence, series=series)
    meaning, suspect = limits.meaning + more, suspect or limits.suspect
    return Finding(name, verdict, value, limits.unit, evidence, meaning, "", suspect, series)


def _plain(values: Sequence[float] | NDArray[np.float64]) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
