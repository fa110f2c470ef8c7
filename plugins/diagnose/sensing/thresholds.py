"""Thresholds, their spread and the bandwidth, from frames and events together.

At the moment of an event a pixel's reference is its photoreceptor's level, with nothing left over.
So between two events s and e of a pixel, both of them near a frame, the level moves by exactly
C+ N+ - C- N-. (Between frames themselves it moves by more: a rise begins below the reference and
ends above it, a share of a threshold that would be counted as a larger threshold.) A photoreceptor
of one pole with time constant tau q(I) has light L = V + tau q V', q(I) = (1 + d) / (I + d), and so

    C+ N+ - C- N- + tau [q V']_s^e + a (t_e - t_s) = L_e - L_s + noise,

where L is interpolated between frames, V' the rate of events around, and a what leak and noise add.
Noise makes the counts uncertain, not the light: least squares on the counts would give thresholds
too low (errors in variables). The equation is therefore multiplied by functions of the frames alone
(instrumental variables: Reiersol, Ark. Mat. Astr. Fys. 1945), and summed over all pairs. These
frames are others than those that give L: a frame's own noise, on both sides, would be a threshold
too large.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from eventsweep.plugins.diagnose.sensing.estimates import (
    Estimate,
    at_most,
    half_width,
    refused,
    resampled,
)
from eventsweep.plugins.diagnose.sensing.frames import FrameStack
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.sim.sensor_presets import SensorParameters

# An event counts as near a frame; the slope of the level there takes events before and after.
_NEAR_US = 5_000
_CLOSEST_S, _FARTHEST_S = 1e-3, 0.03
_LONGEST_US = 500_000
# Frames so many before and after an event's own give the instruments.
_APART = 2
# A pixel whose events come closer than so many refractory periods may have lost some in between.
_GUARD = 3.0
_USUAL_REFRACTORY_US = 1000.0
_FEW_PAIRS, _MOST_RELATIVE = 2000, 0.25
# Of a threshold: ideal sensors, whose pixels are all alike, seem to scatter by up to 0.015 of it.
_LEAST_SIGMA = 0.025
# Shares of the value by which the development sensors were off beyond their scatter
# (`python tests/benchmarks sensor_fit` of commit 77cd9c78).
SYSTEMATIC = {"threshold": 0.07, "bandwidth": 0.15, "sigma": 0.25}
THRESHOLDS = (
    ("contrast_threshold_pos", ""), ("contrast_threshold_neg", ""), ("threshold_sigma", ""),
    ("bandwidth_hz", "Hz"),
)  # fmt: skip
"""What frames and events determine together: names and units."""
_DARK_LEVEL = SensorParameters().dark_level
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pairs:
    """Sums over pairs of events, one row per tile, and what spreads need.

    Attributes:
        moments: (B, 4, 6) instruments times (N+, N-, lag of N+, lag of N-, time, change of light).
        halves: (2, 2, P, 2) per half of the time and polarity: change of light, net events.
        number: of pairs.
        sample: (N, 3) some pairs' change of light, N+ and N-.
    """

    moments: Floats
    halves: Floats
    number: int
    sample: Floats


def pairs_of(
    pixels: PixelEvents, frames: FrameStack, log_eps: float, threshold: float,
    refractory_us: float = 0.0,
) -> Pairs:  # fmt: skip
    """Sums over pairs of events that no lost events spoil.

    Events that come nearly as close as the refractory period may have lost some between them. Of an
    edge that passes within it a single event is left, and only frames show that: pairs are left out
    as well where the light changes by more than a `threshold` in the guard's time, or in that of a
    usual sensor where the period is not known (0).
    """
    guard_us = _GUARD * refractory_us
    anchors = _anchors(pixels, frames, log_eps)
    halves = _halves(pixels, anchors)
    rates = _rates(pixels, anchors.event.to_numpy()) * anchors.lag.to_numpy()
    sloped = np.isfinite(rates[0])
    anchors, rates = anchors[sloped], rates[:, sloped]
    start, end, good = _neighbours(pixels, anchors)
    pixel, t_us = pixels.pixel, pixels.t_us
    fast = np.zeros(len(pixels) + 1, np.int64)
    fast[2:] = np.cumsum((np.diff(pixel) == 0) & (np.diff(t_us) < guard_us))
    good &= fast[end + 1] == fast[start + 1]
    steep = _steep(frames, log_eps, threshold / (guard_us or _GUARD * _USUAL_REFRACTORY_US))
    first, last = (np.searchsorted(frames.t_us, t_us[k]) for k in (start, end))
    first, last = np.maximum(first - 1, 0), np.minimum(last, len(frames.t_us) - 1)
    good &= steep[first, pixel[start]] == steep[last, pixel[start]]
    start, end = start[good], end[good]
    ons = np.cumsum(pixels.on)
    plus: Floats = (ons[end] - ons[start]).astype(float)
    minus = (end - start) - plus
    lags = np.diff(rates, axis=1)[:, good]
    steps = np.diff(anchors[["log", "slope", "apart"]].to_numpy(), axis=0)[good].T
    change, turned, moved = map(np.ascontiguousarray, steps)
    seconds = (t_us[end] - t_us[start]) * 1e-6
    tile, moments = pixels.tile[pixel[start]], np.zeros((pixels.tiles, 4, 6))
    known = (plus, minus, *lags, seconds, change)
    for i, z in enumerate((np.maximum(moved, 0), np.maximum(-moved, 0), turned, seconds)):
        for j, x in enumerate(known):
            moments[:, i, j] = np.bincount(tile, z * x, pixels.tiles)
    keep = slice(None, None, max(1, len(start) // 20_000))
    sample = np.stack([change[keep], plus[keep], minus[keep]], 1)
    return Pairs(moments, halves, len(start), sample)


def _neighbours(
    pixels: PixelEvents, anchors: pd.DataFrame
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """First and second event of each two in a row, and whether they are of a pixel and near."""
    event = anchors.event.to_numpy()
    start, end = event[:-1], event[1:]
    near = pixels.t_us[end] - pixels.t_us[start] < _LONGEST_US
    return start, end, (pixels.pixel[start] == pixels.pixel[end]) & near


def _steep(frames: FrameStack, log_eps: float, most_per_us: float) -> NDArray[np.int32]:
    """(T, P) number of intervals before a frame in which a pixel's light changed faster."""
    log = np.log(frames.light.reshape(len(frames.t_us), -1) + log_eps)
    steep = np.abs(np.diff(log, axis=0)) > most_per_us * np.diff(frames.t_us)[:, None]
    return np.cumsum(np.pad(steep, ((1, 0), (0, 0))), axis=0, dtype=np.int32)


def _halves(pixels: PixelEvents, anchors: pd.DataFrame) -> Floats:
    """Change of light and net events of every pixel, rising and falling, in both halves of time.

    Of all events near frames, also those that noise may have made: what it does in one half of the
    time has nothing to do with the other.
    """
    start, end, good = _neighbours(pixels, anchors)
    start, end, change = start[good], end[good], np.diff(anchors.log.to_numpy())[good]
    steps = np.cumsum(2 * pixels.on.astype(np.int64) - 1)
    net = (steps[end] - steps[start]).astype(float)
    late = pixels.t_us[start] > np.mean(pixels.span_us)
    number = pixels.counts.size
    out = np.zeros((2, 2, number, 2))
    for half in range(2):
        for side, rising in enumerate((change > 0, change < 0)):
            chosen = rising & (late == bool(half))
            sign = 1 - 2 * side
            for k, values in enumerate((change, net)):
                out[half, side, :, k] = np.bincount(
                    pixels.pixel[start[chosen]], sign * values[chosen], number
                )
    return out


def _anchors(pixels: PixelEvents, frames: FrameStack, log_eps: float) -> pd.DataFrame:
    """The event nearest to each frame of each pixel, if near enough, in order of pixel and time.

    Columns: `event`, its index among the events; `log`, its log light; `slope` of that, times the
    lag's factor, 1/s; `lag`, that factor; `apart`, log light of other frames, around those that
    give `log`.
    """
    at_us, count = frames.t_us, len(frames.t_us)
    k = np.searchsorted((at_us[1:] + at_us[:-1]) // 2, pixels.t_us)
    away_us = pixels.t_us - at_us[k]
    number = pixels.counts.size
    usable = frames.usable.reshape(count, number)
    near = (np.abs(away_us) <= _NEAR_US) & (k >= _APART) & (k < count - _APART)
    near &= ~pixels.hot.ravel()[pixels.pixel]
    event = np.flatnonzero(near)
    reach = range(-_APART, _APART + 1)
    around = np.stack([usable[k[event] + d, pixels.pixel[event]] for d in reach])
    event = event[around.all(0)]
    order = np.lexsort([np.abs(away_us[event]), k[event], pixels.pixel[event]])
    event = event[order]
    cell = pixels.pixel[event] * count + k[event]
    event = event[np.flatnonzero(np.diff(cell, prepend=-1))]
    frame, pixel, away = k[event], pixels.pixel[event], away_us[event] * 1e-6
    light = frames.light.reshape(count, number)
    before, here, after = (np.log(light[frame + d, pixel] + log_eps) for d in (-1, 0, 1))
    gap_before, gap_after = ((at_us[frame + d] - at_us[frame]) * 1e-6 for d in (-1, 1))
    # The parabola through three frames: exact where light bends evenly.
    first, second = (before - here) / gap_before, (after - here) / gap_after
    bend = (second - first) / (gap_after - gap_before)
    level = first - bend * gap_before
    log = here + away * (level + bend * away)
    lag = (1 + _DARK_LEVEL) / (np.exp(log) - log_eps + _DARK_LEVEL)
    slope = level + 2 * bend * away
    apart = sum(np.log(light[frame + d, pixel] + log_eps) for d in (-_APART, _APART)) / 2
    return pd.DataFrame(
        {"event": event, "log": log, "slope": lag * slope, "lag": lag, "apart": apart}
    )


def _rates(pixels: PixelEvents, event: NDArray[np.int64]) -> Floats:
    """(2, N) slope of the level at some events, 1/s, as factors of C+ and of -C-.

    The slope of the parabola through an event and those of its pixel before and after. NaN where
    they are too far or too close for it, or of another polarity: within a run of equal events few
    are noise, which leaves a share of a threshold behind.
    """
    before, after = np.maximum(event - 1, 0), np.minimum(event + 1, len(pixels) - 1)
    seconds = [pixels.t_us[k] * 1e-6 for k in (before, event, after)]
    steps = np.diff(seconds, axis=0)
    good = ((steps > _CLOSEST_S) & (steps < _FARTHEST_S)).all(axis=0)
    for column in (pixels.pixel, pixels.on):
        good &= (column[before] == column[event]) & (column[after] == column[event])
    h1, h2 = steps[:, good]
    slope = (h2 / h1 + h1 / h2) / (h1 + h2)
    out = np.full((2, len(event)), np.nan)
    for row, polarity in enumerate((pixels.on, ~pixels.on)):
        out[row, good] = slope * polarity[event][good]
    return out


def solved(sums: Floats) -> Floats:
    """(R, 4) C+, C-, time constant in s and drift, from (R, 4, 6) sums: Newton in the lag."""
    out = np.full((len(sums), 4), np.nan)
    for r, s in enumerate(sums):
        tau, three = 0.0, np.full(3, np.nan)
        for _ in range(50):
            left = np.stack([s[:, 0] + tau * s[:, 2], -(s[:, 1] + tau * s[:, 3]), s[:, 4]], 1)
            try:
                three = np.linalg.solve(left[[0, 1, 3]], s[[0, 1, 3], 5])
            except np.linalg.LinAlgError:
                break
            c_pos, c_neg, drift = three
            lagging = c_pos * s[2, 2] - c_neg * s[2, 3]
            moved = c_pos * s[2, 0] - c_neg * s[2, 1] + drift * s[2, 4]
            new = (s[2, 5] - moved) / lagging if lagging else np.nan
            done = abs(new - tau) < 1e-9
            tau = 0.5 * (tau + new)
            if done or not np.isfinite(tau):
                break
        out[r] = three[0], three[1], tau, three[2]
    return out


def threshold_estimates(pairs: Pairs) -> list[Estimate]:
    """C+, C-, their spread and the bandwidth."""
    if pairs.number < _FEW_PAIRS:
        why = f"{pairs.number} pairs of events lie near frames; needs {_FEW_PAIRS}"
        return [refused(*each, why) for each in THRESHOLDS]
    value, drawn = resampled(pairs.moments, solved)
    relative = _spread(pairs.halves, value[:2])
    thresholds = []
    for k, (name, unit) in enumerate(THRESHOLDS[:2]):
        # Counts tell of 1 / C, whose mean over unlike pixels is larger than that of C.
        factor = 1 + (relative[0] if np.isfinite(relative[0]) else 0.0)
        c = float(value[k] * factor)
        width = half_width(drawn[:, k] * factor, c, SYSTEMATIC["threshold"])
        sure = c > 0.01 and width < _MOST_RELATIVE * c
        why = f"{c:.3g} ± {width:.2g}: frames and events do not agree"
        thresholds.append(Estimate(name, unit, c, width) if sure else refused(name, unit, why))
    return [*thresholds, _sigma(relative, value[:2]), _bandwidth(value[2], drawn[:, 2])]


def _sigma(relative: tuple[float, float], thresholds: Floats) -> Estimate:
    squared, error = relative
    if not np.isfinite(squared) or squared < 2 * error:
        return refused("threshold_sigma", "", "too few pixels with many events in both halves of "
                       "the recording, or no spread beyond chance")  # fmt: skip
    c = float(np.mean(thresholds))
    sigma = c * float(np.sqrt(squared))
    width = 1.96 * c * error / (2 * float(np.sqrt(squared)))
    if sigma < _LEAST_SIGMA * c:
        return at_most("threshold_sigma", "", max(sigma + width, _LEAST_SIGMA * c))
    return Estimate(
        "threshold_sigma", "", sigma, float(np.hypot(width, SYSTEMATIC["sigma"] * sigma))
    )


def _bandwidth(tau_s: float, drawn: NDArray[Any]) -> Estimate:
    spread = float(np.nanstd(drawn))
    if not tau_s > 4 * spread or not tau_s > 1e-4:
        bound = 1 / (2 * np.pi * max(tau_s + 2 * spread, 1e-5))
        return refused(
            "bandwidth_hz", "Hz",
            f"events lag {1e6 * tau_s:.0f} ± {2e6 * spread:.0f} µs at full scale: no significant "
            f"cut-off below {bound:.0f} Hz",
        )  # fmt: skip
    value = 1 / (2 * np.pi * tau_s)
    width = half_width(
        1 / (2 * np.pi * np.maximum(drawn, tau_s / 4)), value, SYSTEMATIC["bandwidth"]
    )
    return Estimate("bandwidth_hz", "Hz", float(value), width)


def _spread(halves: Floats, thresholds: Floats) -> tuple[float, float]:
    """(sigma / C)^2, and its standard error: what both halves of time say alike of a pixel."""
    products = []
    for side, c in enumerate(thresholds):
        change, events = halves[:, side, :, 0], halves[:, side, :, 1]
        enough = (change > 2 * c).all(0)
        if enough.sum() < 100:
            continue
        slow = c * events[:, enough] / change[:, enough]
        off = slow - np.median(slow, axis=1, keepdims=True)
        inside = (np.abs(off) < 0.8).all(0)
        products.append(off[0, inside] * off[1, inside])
    if not products:
        return float("nan"), float("nan")
    product = np.concatenate(products)
    return float(product.mean()), float(product.std() / np.sqrt(len(product)))
