"""What a gyroscope on the body has reported lately."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.errors import InputError

Matrix = NDArray[np.float64]
SIGMA_RAD_S = 0.05
"""Of a rate: noise, a bias that nobody has calibrated, and what lies between two samples."""
_MOST_APART_US = 20_000


class Gyroscope:
    """Rates of turn of the body, in its own frame; a bounded stretch of them."""

    def __init__(self) -> None:
        self._t_us = np.empty(0, np.int64)
        self._rates = np.empty((0, 3))

    def __len__(self) -> int:
        return len(self._t_us)

    def push(self, samples: ImuSamples) -> None:
        """Takes samples that are later than all before.

        Raises:
            InputError: out of order.
        """
        t_us = np.concatenate([self._t_us, samples.t_us])
        if not (np.diff(t_us[max(len(self) - 1, 0) :]) > 0).all():
            raise InputError(
                f"inertial samples from {samples.t_us[0]} µs: times must rise, and be later than "
                "those pushed before"
            )
        self._t_us = t_us
        rates = samples.gyro_rad_s @ samples.T_body_imu[:3, :3].T
        self._rates = np.concatenate([self._rates, rates])

    def drop_before(self, t_us: int) -> None:
        """Lets go of older samples."""
        k = int(np.searchsorted(self._t_us, t_us))
        self._t_us, self._rates = self._t_us[k:], self._rates[k:]

    def rate_at(self, t_us: int, known_us: int) -> Matrix | None:
        """The rate (3,) at a time by the samples before `known_us`, rad/s; None in a gap."""
        k = int(np.searchsorted(self._t_us, t_us, side="right"))
        last = int(np.searchsorted(self._t_us, known_us))
        around = slice(max(k - 1, 0), min(k + 1, last))
        times, rates = self._t_us[around], self._rates[around]
        if not len(times) or np.abs(times - t_us).max() > _MOST_APART_US:
            return None
        return np.array([np.interp(t_us, times, column) for column in rates.T])
