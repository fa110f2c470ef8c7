"""What is known of one parameter: a value with its uncertainty, or why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import significant

REPLICATES = 200
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter of the sensor.

    Attributes:
        name: of `SensorConfig` or `PixelConfig`.
        unit: empty for natural logarithms and shares.
        value: NaN where it is refused.
        uncertainty: half the width of the 95 % interval; NaN where unknown.
        refused: why the recording does not determine it.
        bounds: whether the truth may be anything from 0 to `value`, in 95 of 100 recordings.
    """

    name: str
    unit: str
    value: float
    uncertainty: float
    refused: str = ""
    bounds: bool = False

    @property
    def words(self) -> tuple[str, str]:
        """Value and uncertainty as text; empty where there is none."""
        if self.refused:
            return "", ""
        if self.bounds:
            return f"≤ {significant(self.value)}", ""
        return significant(self.value), significant(self.uncertainty, 2)

    def facts(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        known = None if self.refused else self.value
        width = None if not np.isfinite(self.uncertainty) else self.uncertainty
        return {"name": self.name, "unit": self.unit, "value": known, "uncertainty": width,
                "refused": self.refused or None, "is_upper_bound": self.bounds}  # fmt: skip


def at_most(name: str, unit: str, value: float) -> Estimate:
    """A parameter of which only an upper bound is known; it may be 0."""
    return Estimate(name, unit, value, float("nan"), bounds=True)


def refused(name: str, unit: str, why: str) -> Estimate:
    """A parameter that the recording does not determine."""
    return Estimate(name, unit, float("nan"), float("nan"), why)


def resampled(sums: Floats, statistic: Callable[[Floats], NDArray[Any]], seed: int = 0) -> Any:
    """A statistic of sums over blocks, and of blocks drawn again with replacement.

    Args:
        sums: (B, ...) what each block adds.
        statistic: of (R, ...) sums, (R, ...).
        seed: of the draws.

    Returns:
        The statistic of all blocks, and those of `REPLICATES` draws, (R, ...).
    """
    blocks = sums.reshape(len(sums), -1)
    weight = np.random.default_rng(seed).multinomial(
        len(sums), np.full(len(sums), 1 / len(sums)), REPLICATES
    )
    drawn = (weight @ blocks).reshape(REPLICATES, *sums.shape[1:])
    return statistic(sums.sum(0)[None])[0], statistic(drawn)


def half_width(drawn: NDArray[Any], value: float, systematic: float) -> float:
    """95 % half-width from replicates, (R,), and a share of the value that no replicate shows."""
    spread = 1.96 * float(np.std(drawn[np.isfinite(drawn)]))
    return float(np.hypot(spread, systematic * abs(value)))
