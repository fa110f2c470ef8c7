"""What events alone tell: the refractory period, noise, its spread over pixels, hot pixels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import significant
from eventsweep.plugins.diagnose.sensing.estimates import (
    Estimate,
    at_most,
    half_width,
    refused,
    resampled,
)
from eventsweep.plugins.diagnose.sensing.pixel_events import HOT_RATIO, PixelEvents

_FEW, _RANK = 30, 5
# Frames may lead one to expect this share of what is seen in quiet places, at most.
_SCENE_SHARE = 0.25
# Something moves where pixels send so many times as many events as in quiet places.
_BUSY = 2.0
# Shares of the value by which the development sensors were off beyond their scatter.
SYSTEMATIC = {
    "refractory": 0.04, "noise": 0.12, "noise without frames": 0.3, "spread": 0.1,
}  # fmt: skip
Floats = NDArray[np.float64]


def refractory(pixels: PixelEvents, noise_hz: float) -> Estimate:
    """The shortest time between two events of a pixel, if it is an edge.

    Chance makes intervals of every length; beyond a refractory period they begin at once, and under
    it there are none. Where only the scene keeps events apart, intervals set in slowly.
    """
    name, unit = "refractory_period_us", "µs"
    gap_us, pixel, _ = pixels.gaps
    gap_us = np.sort(gap_us[~pixels.hot.ravel()[pixel]]) if len(pixel) else gap_us
    if len(gap_us) < 1000:
        return refused(name, unit, f"{len(gap_us)} intervals; needs 1000")
    least_us = float(gap_us[_RANK - 1])
    if least_us < 50:
        return refused(name, unit, f"intervals go down to {least_us:.0f} µs: none longer than that")
    near, first, beyond = (
        int(np.searchsorted(gap_us, high * least_us) - np.searchsorted(gap_us, low * least_us))
        for low, high in ((1, 2), (1, 1.2), (1.5, 1.7))
    )
    chance = len(pixels) * max(noise_hz, 0.0) * least_us * 1e-6
    if min(chance, near) < _FEW or first < max(8, 0.5 * beyond):
        return refused(
            name, unit,
            f"no interval under {least_us:.0f} µs, but their number rises slowly from there, and "
            f"noise alone would give only {chance:.0f} shorter ones",
        )  # fmt: skip
    density = (first + beyond) / (0.4 * least_us)
    value = max(least_us - _RANK / density, 0.0)
    chance_us = 1.96 * float(np.sqrt(_RANK)) / density
    width = float(np.hypot(chance_us, SYSTEMATIC["refractory"] * value))
    return Estimate(name, unit, value, width)


def quiet_noise(
    pixels: PixelEvents, seen: Callable[[int], tuple[Floats, Floats]] | None = None
) -> tuple[tuple[Estimate, ...], float, float]:
    """Shot noise, leak, and the spread of shot noise over pixels, from quiet places.

    Where frames say how many events the scene makes (`seen`), noise is what is left as that goes to
    zero; where they are as many as those of noise it is refused. Where nobody says and something
    moves, the rates are upper bounds: faint texture that moves looks the same.

    Returns:
        The estimates; the rate of all events there, Hz, whatever made them; the mean light there,
        at which the rates hold, 1 is full scale: NaN without frames.
    """
    sums, own = pixels.quiet(seen)
    names, units = ("shot_rate_hz", "leak_rate_hz", "noise_spread_decades"), ("Hz", "Hz", "decades")
    seconds, count = float(sums[:, 0].sum()), int(sums[:, [3, 5]].sum())
    if count < _FEW or seconds < 10:
        why = f"{count} events in {seconds:.0f} s of quiet pixels; needs {_FEW} in 10 s"
        none = tuple(refused(*each, why) for each in zip(names, units, strict=True))
        return none, count / max(seconds, 1e-9), float("nan")
    rate_hz, scene_hz = count / seconds, float(sums[:, 1].sum()) / seconds
    light = float(sums[:, 7].sum()) / seconds if seen else float("nan")
    if seen and scene_hz > _SCENE_SHARE * rate_hz:
        why = f"the scene makes {scene_hz:.2g} events per second where {rate_hz:.2g} are seen"
        return tuple(refused(*each, why) for each in zip(names, units, strict=True)), rate_hz, light
    value, drawn = resampled(sums, _noise_of)
    busy_hz = float(pixels.counts[~pixels.hot].mean()) / pixels.seconds
    if seen is None and busy_hz > _BUSY * rate_hz:
        why = "noise has an upper bound only: the scene moves"
        return (*_bounds(value, drawn), refused(names[2], units[2], why)), rate_hz, light
    spread = _spread(pixels, own)
    factor = 1.0 if spread.refused else float(np.exp(0.5 * (np.log(10) * spread.value) ** 2))
    systematic = SYSTEMATIC["noise" if seen else "noise without frames"]
    rates = []
    for k, name in enumerate(names[:2]):
        width = half_width(drawn[:, k], value[k], systematic)
        why = f"{value[k]:.2g} ± {width:.2g} Hz in quiet pixels: indistinguishable from none"
        estimate = Estimate(name, "Hz", float(value[k]) / factor, width / factor)
        rates.append(estimate if width < 0.75 * value[k] else refused(name, "Hz", why))
    return (*rates, spread), rate_hz, light


def _bounds(value: Floats, drawn: Floats) -> list[Estimate]:
    """Upper bounds of shot noise and leak, Hz; both are events that something else may have made.

    A leak is what brightens beyond what darkens, and no more than all that brightens.
    """
    shot_hz, leak_hz = value + 1.96 * np.nanstd(drawn, axis=0)
    return [
        at_most("shot_rate_hz", "Hz", float(shot_hz)),
        at_most("leak_rate_hz", "Hz", float(max(leak_hz, 0.0))),
    ]


def _noise_of(sums: Floats) -> Floats:
    """(R, 2) shot and leak rate, Hz, where the scene makes no event: lines through (R, 8) sums."""
    out = []
    seconds, first, second = sums[:, 0], sums[:, 1], sums[:, 2]
    spread = seconds * second - first**2
    for k in (3, 5):
        flat = sums[:, k] / seconds
        with np.errstate(divide="ignore", invalid="ignore"):
            line = (second * sums[:, k] - first * sums[:, k + 1]) / spread
        out.append(np.where(second > 0, line, flat))
    return np.stack([2 * out[0], out[1] - out[0]], 1)


def _spread(pixels: PixelEvents, own: Floats) -> Estimate:
    """Spread of rates over pixels, of (P, 2) quiet seconds and darker events.

    A factor X per pixel gives n (n - 1) events with mean E[X^2] (rate x time)^2, and for a
    log-normal X, E[X^2] / E[X]^2 is exp(s^2).
    """
    name, unit = "noise_spread_decades", "decades"
    seconds, events = own.T
    table = np.stack([seconds, events, events * (events - 1), seconds**2], 1)
    tiles = [np.bincount(pixels.tile, c, pixels.tiles) for c in table.T]
    sums = np.stack(tiles, 1).astype(np.float64)

    def squared(many: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(many[:, 2] * many[:, 0] ** 2 / (many[:, 1] ** 2 * many[:, 3]) - 1)

    value, drawn = resampled(sums, squared)
    error = float(np.nanstd(drawn))
    if not value > 2.5 * error:
        return refused(name, unit, "counts of quiet pixels scatter no more than by chance")
    spread = float(np.sqrt(np.log1p(value)) / np.log(10))
    slope = 1 / (2 * np.log(10) ** 2 * spread * (1 + float(value)))
    width = float(np.hypot(1.96 * error * slope, SYSTEMATIC["spread"] * spread))
    return Estimate(name, unit, spread, width)


def hot_estimates(pixels: PixelEvents, refractory_us: float = 0.0) -> list[Estimate]:
    """How many pixels are hot, and how much they send, where hot pixels would stand out.

    Before a moving scene only the hottest do: their number is then a lower bound, and refused.
    Their rate is that of a counter that is dead for the refractory period after each event: of n
    events per second that are due, n / (1 + n t) are counted (Knoll, Radiation Detection and
    Measurement, section 4.VII). What their neighbours send is taken off.
    """
    hot, number = pixels.hot, pixels.counts.size
    count = int(hot.sum())
    seen_hz = HOT_RATIO * float(np.quantile(pixels.counts, 0.9)) / pixels.seconds
    rates, others_hz = (
        due_hz(pixels.counts[which] / pixels.seconds, refractory_us) for which in (hot, ~hot)
    )
    if not count or rates.mean() < 2 * seen_hz:
        some = f"{count} pixels are, and" if count else "no pixel is hot;"
        why = f"{some} pixels under {significant(seen_hz, 3)} Hz would not be distinguishable from "
        names = ("hot_pixel_fraction", ""), ("hot_pixel_rate_hz", "Hz")
        return [refused(*name, why + "the scene") for name in names]
    share_width = 1.96 * float(np.sqrt(count + 1)) / number
    chance = np.sqrt((rates.var() + others_hz.var() + rates.mean() / pixels.seconds) / count)
    rate_hz, width_hz = float(rates.mean() - others_hz.mean()), 1.96 * float(chance)
    return [
        Estimate("hot_pixel_fraction", "", count / number, share_width),
        Estimate("hot_pixel_rate_hz", "Hz", rate_hz, width_hz),
    ]


def due_hz(counted_hz: Floats, dead_us: float) -> Floats:
    """The rate of a Poisson process of which a counter with a dead time sees `counted_hz`."""
    return counted_hz / np.maximum(1 - counted_hz * dead_us * 1e-6, 0.05)
