"""Checks of the events: unit, order and resolution of their times, rates, polarity, pixels."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import significant
from eventsweep.emvs.hot_pixels import hot_mask
from eventsweep.plugins.diagnose.check.findings import (
    TIME,
    Finding,
    Series,
    Verdict,
    above,
    below,
    judged,
    worst,
)
from eventsweep.plugins.diagnose.check.streams import BIN_US, Stream

# Events per second and pixel. Moving heads before textured rooms send 1 to 60 on the twins, and
# 1 to 30 in the recordings of MVSEC and TUM-VIE; a unit of time that is wrong is wrong by 1000.
USUAL_RATE_HZ = (0.02, 1000.0)
_DOUBTFUL_RATE_HZ = (0.1, 300.0)
_TYPICAL_RATE_HZ = 10.0
# Share of events that brighten. Thresholds of DAVIS346 twins (0.143 against 0.225) give 0.61.
_POLARITY_DOUBTFUL, _POLARITY_WRONG = 0.2, 0.02
# Share of a recording's events that hot pixels send, and how many times their surroundings.
_HOT_RATIO, _HOT_DOUBTFUL, _HOT_WRONG = 10.0, 0.02, 0.3
# Steps of time stamps. 5 ms between two cameras make stereo worse than one (page `studies`).
_STEP_DOUBTFUL_US, _STEP_WRONG_US = 500, 5000
# A camera that is silent while the other is not, or longer than moving heads are still.
_SILENCE_BINS, _SILENCE_DOUBTFUL, _SILENCE_WRONG = 20, 0.05, 0.3
# Columns or rows that a calibration has and no event ever reaches.
_UNUSED_DOUBTFUL, _UNUSED_WRONG = 0.1, 0.2
_ENOUGH_EVENTS = 1000
# A bus at its limit sends the same number of events in every millisecond.
_CEILING_HZ, _CEILING_WITHIN, _CEILING_SHARE = 1e6, 0.02, 0.2
_REFRACTORY_DOUBTFUL_US = 10_000


def check_events(recording: Recording, streams: tuple[Stream, ...]) -> list[Finding]:
    """Checks that need only the events.

    Args:
        recording: names of the cameras.
        streams: statistics of each camera's events.
    """
    names = recording.rig.camera_names
    empty = [name for name, stream in zip(names, streams, strict=True) if not stream.events]
    if empty:
        return [_silent(empty)]
    if any(stream.is_off_sensor for stream in streams):
        return [_off_sensor(names, streams)]
    gaps = partial(_gaps, _busy(streams))
    checks = (
        _order, _rate, _time_step, _polarity, _sensor, _hot_pixels, gaps, _ceiling, _refractory,
    )  # fmt: skip
    return [worst_camera(list(map(check, streams)), names) for check in checks]


def _silent(cameras: list[str]) -> Finding:
    return judged(
        "events", "wrong", 0.0, "events", f"{', '.join(cameras)}: no event at all",
        meaning="a camera without events has no votes: is it the right file and stream?",
        suspect="camera silent",
    )  # fmt: skip


def _off_sensor(names: tuple[str, ...], streams: tuple[Stream, ...]) -> Finding:
    """Events beyond the last column or row; do they fit the sensor of another camera?"""
    k = [stream.is_off_sensor for stream in streams].index(True)
    (x_px, y_px), (height, width) = streams[k].largest_px, streams[k].pixels.shape
    fits = [
        j for j, other in enumerate(streams)
        if j != k and x_px < other.pixels.shape[1] and y_px < other.pixels.shape[0]
    ]  # fmt: skip
    hint = f", but on that of {names[fits[0]]}" if fits else ""
    return judged(
        "events-sensor", "wrong", None, "",
        f"{names[k]}: events reach column {x_px} and row {y_px}, off its sensor of {width} x "
        f"{height} px{hint}",
        meaning="they come from another camera, the calibration is for another sensor or "
        "resolution, or x and y are exchanged",
        suspect="events off the sensor",
    )  # fmt: skip


def worst_camera(findings: list[Finding], names: tuple[str, ...]) -> Finding:
    """The worst of the cameras' findings, with its camera's name."""
    verdicts = [finding.verdict for finding in findings]
    at = verdicts.index(worst(verdicts))
    return replace(findings[at], evidence=f"{names[at]}: {findings[at].evidence}")


def _order(stream: Stream) -> Finding:
    return judged(
        "events-order", "wrong" if stream.backwards else "good", float(stream.backwards), "steps",
        f"time runs backwards at {stream.backwards:,} of {stream.events:,} events",
        meaning="windows are cut by time: events out of order are lost or mapped twice, unless "
        "they are sorted (stable)",
        suspect="events not sorted",
    )  # fmt: skip


def _rate(stream: Stream) -> Finding:
    per_pixel_hz = stream.rate_hz / stream.pixels.size
    low, high = USUAL_RATE_HZ
    verdict: Verdict = "wrong" if not low <= per_pixel_hz <= high else "good"
    if verdict == "good" and not _DOUBTFUL_RATE_HZ[0] <= per_pixel_hz <= _DOUBTFUL_RATE_HZ[1]:
        verdict = "doubtful"
    unit = "" if verdict != "wrong" else time_unit(per_pixel_hz / _TYPICAL_RATE_HZ, "event")
    rates_hz = np.concatenate(stream.rates).astype(np.float64) * (1e6 / BIN_US)
    at_s = np.concatenate(
        [(t_us + BIN_US * np.arange(len(r))) for t_us, r in zip(stream.begins_us, stream.rates,
                                                               strict=True)]
    ) / 1e6  # fmt: skip
    return judged(
        "events-rate", verdict, per_pixel_hz, "Hz per pixel",
        f"{significant(per_pixel_hz, 3)} events per second and pixel; {low:g} to {high:g} is "
        f"usual{unit and f'; as if {unit}'}",
        meaning="times in a unit other than µs make rates 1000 times too high or too low "
        "(time_unit in recording.toml, --time-unit); or the sensor is too sensitive, or not enough",
        suspect="unusual event rate",
        series=Series(_thinned(rates_hz), _thinned(at_s), TIME, "events per second"),
    )  # fmt: skip


def time_unit(too_fast: float, whose: str) -> str:
    """Which unit was read as µs, if rates are this many times too high."""
    power = round(np.log10(max(too_fast, 1e-12)) / 3)
    units = {-2: "ps", -1: "ns", 1: "ms", 2: "s"}
    return f"{whose} times in {units[power]}, read as µs" if power in units else ""


def _thinned(values: NDArray[np.float64], most: int = 500) -> NDArray[np.float64]:
    """Every n-th value, few enough for a picture."""
    return np.asarray(values[:: -(-len(values) // most) or 1], np.float64)


def _time_step(stream: Stream) -> Finding:
    step_us = max(stream.step_us, 1)
    return judged(
        "events-time-step", above(step_us, _STEP_DOUBTFUL_US, _STEP_WRONG_US), float(step_us), "µs",
        f"time stamps are whole multiples of {step_us} µs",
        meaning="events in one step share a pose, and clocks cannot be compared more finely; were "
        "they stamped per packet?",
        suspect="coarse time stamps",
    )  # fmt: skip


def _polarity(stream: Stream) -> Finding:
    share = stream.brighter / stream.events
    least = min(share, 1 - share)
    return judged(
        "events-polarity", below(least, _POLARITY_DOUBTFUL, _POLARITY_WRONG), share, "",
        f"{share:.1%} of the events brighten",
        meaning="one polarity is missing or drowned in noise: half of the edges are lost; look at "
        "its column, its code (0 and 1, or -1 and 1) and the sensor's biases",
        suspect="one polarity missing",
    )  # fmt: skip


def _sensor(stream: Stream) -> Finding:
    height, width = stream.pixels.shape
    columns = np.flatnonzero(stream.pixels.any(axis=0))
    rows = np.flatnonzero(stream.pixels.any(axis=1))
    used = (columns[-1] + 1) / width, (rows[-1] + 1) / height
    unused = 1 - min(used)
    enough = stream.events >= _ENOUGH_EVENTS
    return judged(
        "events-sensor", above(unused, _UNUSED_DOUBTFUL, _UNUSED_WRONG) if enough else "good",
        unused, "",
        f"events reach column {columns[-1]} and row {rows[-1]} of {width} x {height} px",
        meaning="the calibration is for another sensor or resolution, x and y are exchanged, or a "
        "part of the sensor is silent",
        suspect="sensor not filled",
        series=Series(stream.pixels.astype(np.float64), y_label="events per pixel"),
    )  # fmt: skip


def _hot_pixels(stream: Stream) -> Finding:
    hot = hot_mask(stream.pixels, _HOT_RATIO)
    share = float(stream.pixels[hot].sum() / stream.events)
    return judged(
        "hot-pixels", above(share, _HOT_DOUBTFUL, _HOT_WRONG), share, "",
        f"{hot.sum():,} pixels fire over {_HOT_RATIO:g} times as often as their neighbours, with "
        f"{share:.1%} of the events",
        meaning="their rays make streaks in the volume; --map.hot-pixels 10 leaves them out",
        suspect="hot pixels",
        series=Series(np.where(hot, stream.pixels, 0.0), y_label="events of hot pixels")
        if hot.any() else None,
    )  # fmt: skip


def _busy(streams: tuple[Stream, ...]) -> list[slice]:
    """The bins of each stretch from the first to the last with an event of any camera."""
    ends = [np.flatnonzero(sum(rates))[[0, -1]] if np.any(rates) else (0, -1)
            for rates in zip(*(stream.rates for stream in streams), strict=True)]  # fmt: skip
    return [slice(first, last + 1) for first, last in ends]


def _gaps(busy: list[slice], stream: Stream) -> Finding:
    """Silences of 20 ms and more, while any camera sends events or between two that it sends."""
    silent = sum(_silent_bins(rates[bins]) for rates, bins in zip(stream.rates, busy, strict=True))
    share = silent / max(sum(map(len, stream.rates)), 1)
    return judged(
        "events-gaps", above(share, _SILENCE_DOUBTFUL, _SILENCE_WRONG), share, "",
        f"{silent} ms in gaps of {_SILENCE_BINS} ms or longer, {share:.1%} of the time",
        meaning="packets were lost, a camera began later or ended earlier, or nothing moved: "
        "windows there hold fewer rays (--map.start-s, --map.duration-s choose others)",
        suspect="gaps in the events",
    )  # fmt: skip


def _silent_bins(rates: NDArray[np.int64]) -> int:
    """Bins in runs of at least `_SILENCE_BINS` empty ones."""
    busy = np.flatnonzero(rates)
    runs = np.diff(busy, prepend=-1, append=len(rates)) - 1
    return int(runs[runs >= _SILENCE_BINS].sum())


def _ceiling(stream: Stream) -> Finding:
    rates = np.concatenate(stream.rates)
    top = int(rates.max())
    busy = rates[rates > 0]
    share = float(np.mean(busy >= (1 - _CEILING_WITHIN) * top))
    # Counts of a steady rate scatter by their root: only what is steadier than chance is a limit.
    steady = np.sqrt(top) < _CEILING_WITHIN * top / 2 and top * 1e6 / BIN_US >= _CEILING_HZ
    verdict: Verdict = "doubtful" if steady and share > _CEILING_SHARE else "good"
    return judged(
        "events-ceiling", verdict, share, "",
        f"{share:.1%} of the milliseconds are within {_CEILING_WITHIN:.0%} of the busiest, "
        f"{significant(top * 1e3 / BIN_US, 3)} kev/s" if top else "no events",
        meaning="the sensor's bus, its event rate controller or the driver is at its limit: events "
        "are late or lost",
        suspect="event rate at its limit",
    )  # fmt: skip


def _refractory(stream: Stream) -> Finding:
    if len(stream.intervals_us) < _ENOUGH_EVENTS:
        return Finding("events-refractory", "good", None, "µs", "too few events for a verdict")
    least_us = float(np.percentile(stream.intervals_us, 1))
    return judged(
        "events-refractory", above(least_us, _REFRACTORY_DOUBTFUL_US, np.inf), least_us, "µs",
        f"99 % of a pixel's events are {least_us:.0f} µs or more apart",
        meaning="pixels stay silent long after each event (a bias): fast edges leave few events",
        suspect="long refractory period",
    )  # fmt: skip
