"""A simulated recording beside a real one: distributions, and how well they can be told apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.plugins.diagnose.sensing.separability import area_under_curve, separability
from eventsweep.plugins.diagnose.sensing.window_features import (
    NAMES,
    edge_rates_hz,
    isolated,
    window_features,
)

WINDOWS = 40
_FEW_ROWS = 10 * 2
_BURST_US = 10_000
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Portrait:
    """What one recording's events are like.

    Attributes:
        name: of the recording.
        statistics: numbers by name.
        gap_us: times between two events of a pixel, µs.
        burst: events per burst, of one polarity and pixel with less than 10 ms in between.
        edge_hz: how fast events follow each other at edges, see `edge_rates_hz`.
        per_pixel: (P,) events per second of each pixel.
        features: (N, F) of parts of windows; `window`, (N,), says of which.
    """

    name: str
    statistics: dict[str, float]
    gap_us: NDArray[np.int64]
    burst: NDArray[np.int64]
    edge_hz: Floats
    per_pixel: Floats
    features: Floats
    window: NDArray[np.int64]


@dataclass(frozen=True)
class Realism:
    """Two recordings side by side.

    Attributes:
        real, simulated: what each is like.
        auc: how well a classifier tells them apart, 0.5 where it cannot, see `separability`.
        single: the same by each statistic alone, without a classifier: at least 0.5.
    """

    real: Portrait
    simulated: Portrait
    auc: float
    single: dict[str, float]

    def facts(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "auc": self.auc, "real": self.real.statistics, "simulated": self.simulated.statistics,
            "single": self.single,
        }  # fmt: skip


def portrait(
    name: str, events: Events, shape: tuple[int, int], span_us: tuple[int, int]
) -> Portrait:
    """What a stretch of events of one camera is like.

    Raises:
        InputError: too few events to be told from others.
    """
    features, window = window_features(events, shape, span_us, WINDOWS)
    if len(features) < _FEW_ROWS:
        raise InputError(
            f"{name}: {len(events)} events make {len(features)} windows of 50; needs {_FEW_ROWS}: "
            "take a longer recording"
        )
    pixels = PixelEvents.of(events, shape, span_us)
    gap_us, _, alike = pixels.gaps
    burst = _bursts(pixels)
    alone = isolated(events, shape)
    edge_hz = edge_rates_hz(events, shape, alone)
    rate_hz = pixels.counts.ravel() / pixels.seconds
    statistics = {
        "events per pixel and second": float(rate_hz.mean()),
        "share of events that brighten": float(pixels.on.mean()),
        "share of pixels that are active": float((rate_hz > 0).mean()),
        "shortest interval (0.1 %), ms": float(np.quantile(gap_us, 0.001)) / 1e3,
        "median interval, ms": float(np.median(gap_us)) / 1e3,
        "equal polarity in a row": float(alike.mean()),
        "events per burst": float(burst.mean()),
        "share of isolated events": float(alone.mean()),
        "median rate at edges, 1/s": float(np.median(edge_hz)) if len(edge_hz) else 0.0,
        "spread of pixels' rates (standard deviation of ln)": float(
            np.log(rate_hz[rate_hz > 0]).std()
        ),
    }
    return Portrait(name, statistics, gap_us, burst, edge_hz, rate_hz, features, window)


def _bursts(pixels: PixelEvents) -> NDArray[np.int64]:
    """Events in each run of one pixel and polarity with less than 10 ms from one to the next."""
    goes_on = (
        (np.diff(pixels.pixel) == 0) & (pixels.on[1:] == pixels.on[:-1])
        & (np.diff(pixels.t_us) < _BURST_US)
    )  # fmt: skip
    starts = np.flatnonzero(np.concatenate([[True], ~goes_on]))
    return np.diff(np.append(starts, len(pixels)))


def compared(real: Portrait, simulated: Portrait) -> Realism:
    """Two portraits side by side."""
    windows = real.window, simulated.window
    auc = separability(real.features, simulated.features, windows)
    single = {}
    for k, name in enumerate(NAMES):
        area = area_under_curve(real.features[:, k], simulated.features[:, k])
        single[name] = max(area, 1 - area)
    return Realism(real, simulated, auc, single)


def compare_realism(real: Recording, simulated: Recording, camera: int = 0) -> Realism:
    """Compares one camera of each, over the length of the shorter.

    Raises:
        InputError: another sensor size, or too few events.
    """
    sizes = [(r.rig.cameras[camera].height_px, r.rig.cameras[camera].width_px)
             for r in (real, simulated)]  # fmt: skip
    if sizes[0] != sizes[1]:
        raise InputError(
            f"{simulated.name}: a sensor of {sizes[1][1]} x {sizes[1][0]} px beside one of "
            f"{sizes[0][1]} x {sizes[0][0]} px: simulate with the real camera's calibration"
        )
    spans = [r.event_span_us(camera) for r in (real, simulated)]
    length_us = min(last - first for first, last in spans)
    portraits = []
    for recording, (first, _) in zip((real, simulated), spans, strict=True):
        span_us = first, first + length_us
        events = recording.events(camera, first, first + length_us + 1)
        portraits.append(portrait(recording.name, events, sizes[0], span_us))
    return compared(*portraits)
