"""What caused an event, and what became of those that were never sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events


class Label(IntEnum):
    """Cause of an event that left the sensor."""

    SIGNAL = 0
    """The scene's brightness changed by a threshold."""
    LEAK = 1
    """Since its pixel's event before, the reference drifted more than brightness rose."""
    SHOT = 2
    """Shot noise."""
    HOT = 3
    """A defective pixel."""


class Drop(IntEnum):
    """Why an event did not leave the sensor."""

    REFRACTORY = 0
    """Its pixel was still silent after the event before."""
    OVERFLOW = 1
    """The read-out's queue was full."""
    AFTER_END = 2
    """It would have come out after the recording's end."""


def count_names() -> tuple[str, ...]:
    """Names of all counters: events out by cause, then events dropped by reason."""
    sent = tuple(label.name.lower() for label in Label)
    return sent + tuple(f"dropped_{drop.name.lower()}" for drop in Drop)


@dataclass(frozen=True, slots=True)
class LabelledEvents:
    """Events, sorted by time, and their causes, (N,) uint8 values of `Label`."""

    events: Events
    label: NDArray[np.uint8]

    @classmethod
    def joined(cls, parts: Sequence[LabelledEvents]) -> LabelledEvents:
        """Parts that follow one another."""
        events = Events.concat([part.events for part in parts])
        return cls(events, np.concatenate([part.label for part in parts]))

    def __len__(self) -> int:
        return len(self.label)
