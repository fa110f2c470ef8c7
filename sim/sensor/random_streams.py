"""Randomness that depends on what it is for and when, never on how the work was cut up."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from eventsweep.emvs.errors import InputError


class Use(IntEnum):
    """What numbers are drawn for; every use has numbers of its own."""

    THRESHOLDS = 0
    LEAK = 1
    HOT_PIXELS = 2
    SHOT_EVENTS = 3
    HOT_EVENTS = 4
    LATENCY = 5
    NOISE_SPREAD = 6


class Randomness:
    """Generators of one camera, counter-based (Philox) and keyed by seed and camera.

    Salmon, Moraes, Dror, Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
    """

    def __init__(self, seed: int, camera: int) -> None:
        if seed < 0 or camera < 0:
            raise InputError(f"seed {seed}, camera {camera}: both must be 0 or greater")
        self._key = np.random.SeedSequence([seed, camera]).generate_state(2, np.uint64)

    def at(self, use: Use, t_us: int = 0) -> np.random.Generator:
        """Numbers for the step that starts at `t_us`, or those that are drawn once per camera."""
        counter = np.array([0, 0, int(use), t_us % 2**64], np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))
