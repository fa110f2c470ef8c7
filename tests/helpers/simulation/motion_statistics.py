"""How a head moves, in a few numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import curve_of

Array = NDArray[np.float64]
_RATE_HZ = 200.0


@dataclass(frozen=True)
class Spread:
    """Median, 95th percentile and maximum of one quantity over time."""

    median: float
    p95: float
    maximum: float


@dataclass(frozen=True)
class HeadStatistics:
    """How a head moves.

    Attributes:
        speed_m_s: of the body's origin.
        acceleration_m_s2: of the body's origin, without gravity.
        rate_rad_s: rotation.
        angular_acceleration_rad_s2: rotation.
        acceleration_hz: frequency with most power in the acceleration.
        rate_hz: frequency with most power in the rotation rate.
    """

    speed_m_s: Spread
    acceleration_m_s2: Spread
    rate_rad_s: Spread
    angular_acceleration_rad_s2: Spread
    acceleration_hz: float
    rate_hz: float


def statistics(motion: Motion, duration_s: float) -> HeadStatistics:
    """Statistics of a motion over [0, `duration_s`]; the first and last 50 ms are left out.

    There a smoothed recording has ends, which no filter knows well.
    """
    smooth = curve_of(motion, duration_s)
    margin_s = min(0.05, 0.1 * duration_s)
    count = max(16, int(duration_s * _RATE_HZ))
    moving = smooth.kinematics(np.linspace(margin_s, duration_s - margin_s, count))
    rate_hz = (count - 1) / (duration_s - 2 * margin_s)
    return HeadStatistics(
        _spread(moving.velocity_m_s),
        _spread(moving.acceleration_m_s2),
        _spread(moving.angular_velocity_rad_s),
        _spread(moving.angular_acceleration_rad_s2),
        _dominant_hz(moving.acceleration_m_s2, rate_hz),
        _dominant_hz(moving.angular_velocity_rad_s, rate_hz),
    )


def _spread(vectors: Array) -> Spread:
    sizes = np.linalg.norm(vectors, axis=1)
    return Spread(*(float(value) for value in np.percentile(sizes, (50, 95, 100))))


def _dominant_hz(vectors: Array, rate_hz: float) -> float:
    """Frequency of the highest peak of Welch's spectrum, summed over the three axes."""
    from scipy.signal import welch

    segment = min(len(vectors), int(8 * rate_hz))
    frequency, power = welch(vectors, rate_hz, nperseg=segment, axis=0)
    return float(frequency[1:][np.argmax(power[1:].sum(axis=1))])
