"""A simulated recording beside a real one: distributions, and how well they can be told apart.

Statistics of events in windows of time and place go to a simple classifier; how well it tells the
two recordings apart is the area under its ROC curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import beginning, camera_occupied, closed_up, length_of
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents

NAMES = (
    "rate", "ON share", "active pixels", "interval 10 %", "interval 50 %", "interval 90 %",
    "equal polarity in a row", "short intervals", "isolated events", "rate at edges",
    "spread in x", "spread in y",
)  # fmt: skip
WINDOWS, FOLDS = 40, 5
_FEW, _FEW_ROWS, _GRID = 50, 20, 3  # events in a part of a window, such parts, parts per axis
_BURST_US, _SHORT_US = 10_000, 10_000
_PENALTY, _STEPS = 1.0, 50  # of the logistic regression
Floats = NDArray[np.float64]
Windows = NDArray[np.int64]


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
    features, window = window_features(events, shape, span_us)
    if len(features) < _FEW_ROWS:
        raise InputError(
            f"{name}: {len(events)} events make {len(features)} windows of 50; needs {_FEW_ROWS}: "
            "take a longer recording"
        )
    pixels = PixelEvents.of(events, shape, span_us)
    gap_us, _, alike = pixels.gaps
    burst, edge_hz = _bursts(pixels), pixels.edge_hz
    rate_hz = pixels.counts.ravel() / pixels.seconds
    statistics = {
        "events per pixel and second": float(rate_hz.mean()),
        "share of events that brighten": float(pixels.on.mean()),
        "share of pixels that are active": float((rate_hz > 0).mean()),
        "shortest interval (0.1 %), ms": float(np.quantile(gap_us, 0.001)) / 1e3,
        "median interval, ms": float(np.median(gap_us)) / 1e3,
        "equal polarity in a row": float(alike.mean()),
        "events per burst": float(burst.mean()),
        "share of isolated events": float(pixels.alone.mean()),
        "median rate at edges, 1/s": float(np.median(edge_hz)) if len(edge_hz) else 0.0,
        "spread of pixels' rates (standard deviation of ln)": float(
            np.log(rate_hz[rate_hz > 0]).std()
        ),
    }
    return Portrait(name, statistics, gap_us, burst, edge_hz, rate_hz, features, window)


def window_features(
    events: Events, shape: tuple[int, int], span_us: tuple[int, int]
) -> tuple[Floats, Windows]:
    """Statistics, (N, F), of 3 x 3 parts of the sensor in each window, and their windows, (N,).

    Parts with fewer than 50 events are left out.
    """
    length_us = span_us[1] + 1 - span_us[0]
    edges = (span_us[0] + np.linspace(0, length_us, WINDOWS + 1).astype(np.int64)).tolist()
    rows, windows = [], []
    for k, (t0_us, t1_us) in enumerate(pairwise(edges)):
        inside = events.between(t0_us, t1_us)
        row, column = (
            at.astype(int) * _GRID // size
            for at, size in zip((inside.y, inside.x), shape, strict=True)
        )
        for part in range(_GRID * _GRID):
            chosen = inside.take(row * _GRID + column == part)
            if len(chosen) >= _FEW:
                rows.append(_features(chosen, shape, (t0_us, t1_us)))
                windows.append(k)
    return np.array(rows).reshape(-1, len(NAMES)), np.array(windows, np.int64)


def _features(events: Events, shape: tuple[int, int], span_us: tuple[int, int]) -> list[float]:
    pixels = PixelEvents.of(events, shape, span_us)
    gap_us, _, alike = pixels.gaps
    area, some, edge_hz = shape[0] * shape[1] / _GRID**2, len(gap_us) > 0, pixels.edge_hz
    quantiles = np.quantile(gap_us, (0.1, 0.5, 0.9)) if some else [span_us[1] - span_us[0]] * 3
    return [
        float(np.log(len(events) / area / pixels.seconds)),
        float(events.p.mean()),
        float(np.log(np.count_nonzero(pixels.counts) / len(events))),
        *np.log(np.maximum(quantiles, 1)).tolist(),
        float(alike.mean()) if some else 0.5,
        float((gap_us < _SHORT_US).mean()) if some else 0.0,
        float(pixels.alone.mean()),
        float(np.log(np.median(edge_hz))) if len(edge_hz) else 0.0,
        float(events.x.std()) / shape[1],
        float(events.y.std()) / shape[0],
    ]


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
    windows, features = (real.window, simulated.window), (real.features, simulated.features)
    columns = zip(NAMES, *(each.T for each in features), strict=True)
    areas = {name: area_under_curve(*both) for name, *both in columns}
    single = {name: max(area, 1 - area) for name, area in areas.items()}
    return Realism(real, simulated, separability(*features, windows), single)


def area_under_curve(first: Floats, second: Floats) -> float:
    """Chance that a score of the second exceeds one of the first, ties counting half: 0 to 1."""
    ranks = rankdata(np.concatenate([first, second]))
    above = ranks[len(first) :].sum() - len(second) * (len(second) + 1) / 2
    return float(above / (len(first) * len(second)))


def logistic(features: Floats, second: NDArray[np.bool_]) -> Floats:
    """(F + 1,) weights of a logistic regression with a ridge penalty, the last the intercept.

    Both classes weigh the same, however many rows they have. Newton's method.
    """
    rows = np.concatenate([features, np.ones((len(features), 1))], 1)
    balance = np.where(second, 0.5 / max(second.sum(), 1), 0.5 / max((~second).sum(), 1))
    balance *= len(rows)
    penalty = np.full(rows.shape[1], _PENALTY)
    penalty[-1] = 1e-6
    weights = np.zeros(rows.shape[1])
    for _ in range(_STEPS):
        p = 1 / (1 + np.exp(-np.clip(rows @ weights, -30, 30)))
        gradient = rows.T @ (balance * (p - second)) + penalty * weights
        curvature = (rows * (balance * p * (1 - p))[:, None]).T @ rows + np.diag(penalty)
        step = np.linalg.solve(curvature, gradient)
        weights -= step
        if np.abs(step).max() < 1e-9:
            break
    return weights


def separability(first: Floats, second: Floats, windows: tuple[Windows, Windows]) -> float:
    """Cross-validated area under the ROC curve, 0.5 where nothing tells the two apart.

    Held out are whole stretches of time, of both at once, so that no classifier is asked about a
    window whose neighbours it has learnt.

    Args:
        first: (N, F) statistics of the one.
        second: (M, F) of the other.
        windows: the window of each row, (N,) and (M,), on a common count.
    """
    features = np.concatenate([first, second])
    is_second = np.arange(len(features)) >= len(first)
    window = np.concatenate(windows)
    fold = window * FOLDS // (int(window.max()) + 1)
    areas, weights = [], []
    for k in range(FOLDS):
        test, learn = fold == k, fold != k
        sides = [np.count_nonzero(test & (is_second == side)) for side in (False, True)]
        if min(sides) == 0 or len(np.unique(is_second[learn])) < 2:
            continue
        middle, scale = features[learn].mean(0), features[learn].std(0) + 1e-9
        fitted = logistic((features[learn] - middle) / scale, is_second[learn])
        score = ((features - middle) / scale) @ fitted[:-1]
        areas.append(area_under_curve(score[test & ~is_second], score[test & is_second]))
        weights.append(sides[0] * sides[1])
    return float(np.average(areas, weights=weights)) if areas else float("nan")


def compare_realism(real: Recording, simulated: Recording, camera: int = 0) -> Realism:
    """Compares one camera of each, over the length of the shorter; long silences are left out.

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
    spans = [camera_occupied(r, camera) for r in (real, simulated)]
    length_us = min(map(length_of, spans)) - 1
    portraits = []
    for recording, parts in zip((real, simulated), spans, strict=True):
        first_us, some = parts[0][0], beginning(parts, length_us + 1)
        events = Events.concat([recording.events(camera, *part) for part in some])
        events = replace(events, t_us=closed_up(events.t_us, parts))
        span_us = first_us, first_us + length_us
        portraits.append(portrait(recording.name, events, sizes[0], span_us))
    return compared(*portraits)
