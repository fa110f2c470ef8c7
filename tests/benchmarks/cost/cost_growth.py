"""How the mapper's cost grows with events, planes, pixels, cameras and windows."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from cost_stream import WINDOW_US, MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window


@dataclass(frozen=True)
class Load:
    """What is mapped: by all methods of Algorithm 1, on one thread.

    Attributes:
        events: events per camera and window.
        planes: depth planes.
        width_px: columns of a camera; rows are three quarters of them.
        cameras: number of cameras.
        windows: number of windows.
    """

    events: int = 1_000_000
    planes: int = 50
    width_px: int = 640
    cameras: int = 2
    windows: int = 1

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of a camera."""
        return self.width_px, self.width_px * 3 // 4

    @property
    def pixels(self) -> int:
        """Pixels of a camera."""
        return self.size_px[0] * self.size_px[1]


@dataclass(frozen=True)
class Growth:
    """Times as one quantity grows and the others stay.

    Attributes:
        quantity: what grows, an attribute of `Load`.
        amounts: how much of it there is.
        seconds: processor time of the mapper, s.
    """

    quantity: str
    amounts: tuple[int, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Exponent e of the power law `seconds = c amount^e` that fits best in logarithms."""
        return self.line[0]

    @property
    def last_exponent(self) -> float:
        """The exponent between the last two measurements, where fixed costs weigh least."""
        (a0, a1), (s0, s1) = self.amounts[-2:], self.seconds[-2:]
        return float(np.log(s1 / s0) / np.log(a1 / a0))

    @property
    def line(self) -> tuple[float, float]:
        """Slope and intercept of ln(seconds) over ln(amount)."""
        slope, intercept = np.polyfit(np.log(self.amounts), np.log(self.seconds), 1)
        return float(slope), float(intercept)


SERIES: dict[str, tuple[int, ...]] = {
    "events": (125_000, 250_000, 500_000, 1_000_000, 2_000_000, 4_000_000),
    "planes": (12, 25, 50, 100, 200),
    "pixels": (160, 320, 640, 1280),
    "cameras": (1, 2, 3, 4),
    "windows": (1, 2, 4, 8),
}
_FIELD = {"pixels": "width_px"}


def growth(base: Load, series: dict[str, tuple[int, ...]], rounds: int) -> list[Growth]:
    """Measures every series around one load; of each measurement the best round counts."""
    return [_series(base, quantity, amounts, rounds) for quantity, amounts in series.items()]


def _series(base: Load, quantity: str, values: tuple[int, ...], rounds: int) -> Growth:
    loads = [replace(base, **{_FIELD.get(quantity, quantity): value}) for value in values]
    seconds = tuple(_seconds(load, rounds) for load in loads)
    return Growth(quantity, tuple(getattr(load, quantity) for load in loads), seconds)


def _seconds(load: Load, rounds: int) -> float:
    recording = MovingEdges(load.size_px, load.events, cameras=load.cameras, windows=load.windows)
    recording.event_span_us(0)  # makes the events now
    _map(recording, load, 1)  # and this compiles what is not compiled yet
    best_s = np.inf
    for _ in range(rounds):
        begin = time.process_time()
        _map(recording, load, load.windows)
        best_s = min(best_s, time.process_time() - begin)
    return float(best_s)


def _map(recording: MovingEdges, load: Load, windows: int) -> None:
    for window in range(windows):
        map_window(
            recording,
            MapperConfig(
                planes=load.planes, start_s=1e-6 * WINDOW_US * window,
                duration_s=1e-6 * WINDOW_US, threads=1,
            ),
        )  # fmt: skip
