"""How a head turns, in a few numbers."""

from typing import NamedTuple

import numpy as np
from scipy.signal import welch

from eventsweep.sim.motion.curves import curve_of

_RATE_HZ = 200.0


class Spread(NamedTuple):
    """Median, 95th percentile and maximum of one quantity over time."""

    median: float
    p95: float
    maximum: float


class Turning(NamedTuple):
    """Speeds of rotation, and the frequency (Hz) with most power in the rotation rate."""

    rate_rad_s: Spread
    rate_hz: float


def statistics(motion, duration_s):
    """How a motion turns over [0, `duration_s`], without the first and last 50 ms.

    There a smoothed recording has ends, which no filter knows well.
    """
    margin_s = min(0.05, 0.1 * duration_s)
    count = max(16, int(duration_s * _RATE_HZ))
    t_s = np.linspace(margin_s, duration_s - margin_s, count)
    rates = curve_of(motion, duration_s).kinematics(t_s).angular_velocity_rad_s
    sampled_hz = (count - 1) / (duration_s - 2 * margin_s)
    # The highest peak of Welch's spectrum, summed over the three axes.
    segment = min(count, int(8 * sampled_hz))
    frequency, power = welch(rates, sampled_hz, nperseg=segment, axis=0)
    spread = Spread(*np.percentile(np.linalg.norm(rates, axis=1), (50, 95, 100)))
    return Turning(spread, frequency[1:][np.argmax(power[1:].sum(axis=1))])
