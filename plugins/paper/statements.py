"""A statement of the paper, what was measured of it, and whether they agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from eventsweep.plugins.paper.evidence import Evidence, Missing


class Verdict(Enum):
    """How a measurement stands to a statement."""

    AGREES = "agrees"
    IN_ORDER = "agrees in order, not in size"
    DISAGREES = "disagrees"
    NOT_MEASURED = "not measured"

    @classmethod
    def of(cls, order: bool, size: bool = True) -> Verdict:
        """Whether the order is as stated, and then whether the size is."""
        if not order:
            return cls.DISAGREES
        return cls.AGREES if size else cls.IN_ORDER


class Finding(NamedTuple):
    """What was measured, the verdict, and why it is so."""

    measured: str
    verdict: Verdict
    why: str = ""


Measure = Callable[[Evidence], Finding]


@dataclass(frozen=True)
class Statement:
    """Something that the paper says.

    Attributes:
        place: where, such as `Sec. 2, Eq. 1`.
        claim: what, in our words.
        measure: finds out.
        published: the number that is published, where there is one.
    """

    place: str
    claim: str
    measure: Measure
    published: str = ""

    def found(self, evidence: Evidence) -> Finding:
        """What was measured; where something is missing, that."""
        try:
            return self.measure(evidence)
        except Missing as missing:
            return Finding(str(missing), Verdict.NOT_MEASURED)


@dataclass(frozen=True)
class Chapter:
    """The statements of a section, in their order."""

    title: str
    statements: tuple[Statement, ...]

    def rows(self, evidence: Evidence) -> Iterator[tuple[Statement, Finding]]:
        """Each statement with what was found."""
        for statement in self.statements:
            yield statement, statement.found(evidence)
