"""Checks of the events: unit, order and resolution of their times, rates, polarity, pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import length_of, occupied_spans, silences, spread, steps
from eventsweep.emvs.data.recording import Recording, events_span_us
from eventsweep.emvs.errors import significant
from eventsweep.emvs.hot_pixels import hot_mask
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.findings import TIME, Finding, Series, judged, worst
from eventsweep.plugins.diagnose.check.limits import BIN_US, LIMITS

Counts = NDArray[np.int64]
Piece = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Stream:
    """Statistics of one camera's events in the stretches that were read.

    Attributes:
        events: how many.
        brighter: how many of polarity 1.
        pixels: (H, W) int64 events per pixel.
        rates: per stretch, (N,) int64 events in each millisecond.
        begins_us: when each stretch begins.
        step_us: the greatest step that all time stamps are multiples of, µs.
        backwards: events with an earlier time than the one before.
        intervals_us: a sample of times between two events of one pixel and polarity, µs.
        largest_px: largest column and row of any event.
    """

    events: int
    brighter: int
    pixels: Counts
    rates: tuple[Counts, ...]
    begins_us: tuple[int, ...]
    step_us: int
    backwards: int
    intervals_us: Counts
    largest_px: tuple[int, int]

    @property
    def is_off_sensor(self) -> bool:
        """Whether there are events off the sensor."""
        height, width = self.pixels.shape
        return bool(self.largest_px[0] >= width or self.largest_px[1] >= height)

    @property
    def rate_hz(self) -> float:
        """Mean events per second."""
        seconds = sum(map(len, self.rates)) * BIN_US / 1e6
        return self.events / seconds if seconds else 0.0


def occupied(recording: Recording) -> tuple[Piece, ...]:
    """The time from first to last event without the long silences of all cameras; never empty."""
    first_us, last_us = events_span_us(recording)
    return occupied_spans(recording, first_us, last_us + 1) or ((first_us, first_us + 1),)


def pieces(spans: Sequence[Piece], *, thorough: bool) -> list[Piece]:
    """The stretches to read: everything a second at a time, or ten of 0.1 s spread over it.

    Args:
        spans: what has events.
        thorough: whether to read everything.
    """
    count, length_us = limits.QUICK_PIECES, limits.QUICK_US
    if thorough or length_of(spans) <= count * length_us:
        return list(steps(spans, 1_000_000))
    begins = spread(spans, length_us, count)
    return [(int(t_us), int(t_us) + length_us) for t_us in begins]


def read_streams(
    recording: Recording, stretches: list[Piece], progress: Progress = silent
) -> tuple[Stream, ...]:
    """Reads the stretches of every camera once, in bounded memory.

    Args:
        recording: any.
        stretches: half-open, µs.
        progress: called with the stage `events`, the stretches done, and their number.

    Raises:
        InputError: what the recording refuses to read: damaged or unsorted events, events off the
            sensor.
    """
    streams, total = [], len(stretches) * len(recording.rig)
    for camera, sensor in enumerate(recording.rig.cameras):
        pixels, parts = np.zeros((sensor.height_px, sensor.width_px), np.int64), []
        for k, (t0_us, t1_us) in enumerate(stretches):
            progress("events", camera * len(stretches) + k, total)
            parts.append(_part(recording.events(camera, t0_us, t1_us), t0_us, t1_us, pixels))
        count, brighter, rates, steps_us, backwards, intervals, x, y = zip(*parts, strict=True)
        step_us = int(np.gcd.reduce(steps_us))
        begins_us, intervals_us = tuple(t0_us for t0_us, _ in stretches), np.concatenate(intervals)
        streams.append(Stream(sum(count), sum(brighter), pixels, rates, begins_us, step_us,
                              sum(backwards), intervals_us, (max(x), max(y))))  # fmt: skip
    return tuple(streams)


def _part(events: Events, t0_us: int, t1_us: int, pixels: Counts) -> tuple[Any, ...]:
    """A stretch's part of a stream; its events are added to the (H, W) `pixels`.

    Of events off the sensor only their number, rates and largest pixel are taken.
    """
    bins = -(-(t1_us - t0_us) // BIN_US)
    rates = np.bincount(np.clip((events.t_us - t0_us) // BIN_US, 0, bins - 1), minlength=bins)
    brighter = int(np.count_nonzero(events.p))
    x_px, y_px = (int(px.astype(int).max(initial=-1)) for px in (events.x, events.y))
    height, width = pixels.shape
    known = events if x_px < width and y_px < height else events.slice(0, 0)
    cell = known.y.astype(np.int64) * width + known.x
    pixels += np.bincount(cell, minlength=pixels.size).reshape(pixels.shape)
    steps_us = np.diff(known.t_us)
    few = slice(0, limits.MOST_TIMED)
    which, t_us = cell[few] * 2 + (known.p[few] > 0), known.t_us[few]
    order = np.lexsort((t_us, which))
    intervals_us = np.diff(t_us[order])[np.diff(which[order]) == 0]
    return (len(events), brighter, rates, np.gcd.reduce(np.append(steps_us, 0)),
            int(np.count_nonzero(steps_us < 0)), intervals_us, x_px, y_px)  # fmt: skip


def check_events(
    recording: Recording, streams: tuple[Stream, ...], spans: Sequence[Piece] = ()
) -> list[Finding]:
    """Checks that need only the events.

    Args:
        recording: names of the cameras.
        streams: statistics of each camera's events.
        spans: what has events; what lies between is silent for long.
    """
    names = recording.rig.camera_names
    empty = [name for name, stream in zip(names, streams, strict=True) if not stream.events]
    if empty:
        return [judged("events", 0.0, f"{', '.join(empty)}: no event at all")]
    if any(stream.is_off_sensor for stream in streams):
        return [_off_sensor(names, streams)]
    checks = (
        _order, _rate, _time_step, _polarity, _sensor, _hot_pixels,
        partial(_gaps, _busy(streams), spans), _ceiling, _refractory,
    )  # fmt: skip
    return [worst_camera(list(map(check, streams)), names) for check in checks]


def _off_sensor(names: tuple[str, ...], streams: tuple[Stream, ...]) -> Finding:
    """Events beyond the last column or row; do they fit the sensor of another camera?"""
    k = [stream.is_off_sensor for stream in streams].index(True)
    (x_px, y_px), (height, width) = streams[k].largest_px, streams[k].pixels.shape
    fits = [
        j for j, other in enumerate(streams)
        if j != k and x_px < other.pixels.shape[1] and y_px < other.pixels.shape[0]
    ]  # fmt: skip
    hint = f", but on that of {names[fits[0]]}" if fits else ""
    return Finding(
        "events-sensor", "wrong", None, "",
        f"{names[k]}: events reach column {x_px} and row {y_px}, off its sensor of {width} x "
        f"{height} px{hint}",
        "they come from another camera, the calibration is for another sensor or resolution, or x "
        "and y are exchanged",
        suspect="events off the sensor",
    )  # fmt: skip


def worst_camera(findings: list[Finding], names: tuple[str, ...]) -> Finding:
    """The worst of the cameras' findings, with its camera's name."""
    verdicts = [finding.verdict for finding in findings]
    at = verdicts.index(worst(verdicts))
    return replace(findings[at], evidence=f"{names[at]}: {findings[at].evidence}")


def _order(stream: Stream) -> Finding:
    count = stream.backwards
    words = f"time runs backwards at {count:,} of {stream.events:,} events"
    return judged("events-order", float(count), words)


def _rate(stream: Stream) -> Finding:
    per_pixel_hz = stream.rate_hz / stream.pixels.size
    low, high = LIMITS["events-rate"].possible
    is_possible = low <= per_pixel_hz <= high
    unit = "" if is_possible else time_unit(per_pixel_hz / limits.TYPICAL_RATE_HZ, "event")
    rates_hz = np.concatenate(stream.rates).astype(np.float64) * (1e6 / BIN_US)
    begins = zip(stream.begins_us, stream.rates, strict=True)
    at_s = np.concatenate([t_us + BIN_US * np.arange(len(rates)) for t_us, rates in begins]) / 1e6
    few = slice(None, None, -(-len(at_s) // limits.PICTURED) or 1)
    return judged(
        "events-rate", per_pixel_hz,
        f"{significant(per_pixel_hz, 3)} events per second and pixel; {low:g} to {high:g} is "
        f"usual{unit and f'; as if {unit}'}",
        series=Series(rates_hz[few], at_s[few], TIME, "events per second"),
    )  # fmt: skip


def time_unit(too_fast: float, whose: str) -> str:
    """Which unit was read as µs, if rates are this many times too high."""
    power = round(np.log10(max(too_fast, 1e-12)) / 3)
    units = {-2: "ps", -1: "ns", 1: "ms", 2: "s"}
    return f"{whose} times in {units[power]}, read as µs" if power in units else ""


def _time_step(stream: Stream) -> Finding:
    step_us = max(stream.step_us, 1)
    words = f"time stamps are whole multiples of {step_us} µs"
    return judged("events-time-step", float(step_us), words)


def _polarity(stream: Stream) -> Finding:
    share = stream.brighter / stream.events
    verdict = LIMITS["events-polarity"].verdict(min(share, 1 - share))
    return judged("events-polarity", share, f"{share:.1%} of the events brighten", verdict=verdict)


def _sensor(stream: Stream) -> Finding:
    height, width = stream.pixels.shape
    column, row = (int(np.flatnonzero(stream.pixels.any(axis=axis))[-1]) for axis in (0, 1))
    return judged(
        "events-sensor", 1 - min((column + 1) / width, (row + 1) / height),
        f"events reach column {column} and row {row} of {width} x {height} px",
        verdict=None if stream.events >= limits.ENOUGH_EVENTS else "good",
        series=Series(stream.pixels.astype(np.float64), y_label="events per pixel"),
    )  # fmt: skip


def _hot_pixels(stream: Stream) -> Finding:
    hot = hot_mask(stream.pixels, limits.HOT_RATIO)
    share = float(stream.pixels[hot].sum() / stream.events)
    return judged(
        "hot-pixels", share,
        f"{hot.sum():,} pixels fire over {limits.HOT_RATIO:g} times as often as their neighbours, "
        f"with {share:.1%} of the events",
        series=Series(np.where(hot, stream.pixels, 0.0), y_label="events of hot pixels")
        if hot.any() else None,
    )  # fmt: skip


def _busy(streams: tuple[Stream, ...]) -> list[slice]:
    """The bins of each stretch from the first to the last with an event of any camera."""
    ends = [np.flatnonzero(sum(rates))[[0, -1]] if np.any(rates) else (0, -1)
            for rates in zip(*(stream.rates for stream in streams), strict=True)]  # fmt: skip
    return [slice(first, last + 1) for first, last in ends]


def _gaps(busy: list[slice], spans: Sequence[Piece], stream: Stream) -> Finding:
    """Silences of 20 ms and more, while any camera sends events or between two that it sends.

    The long ones of all cameras are added.
    """
    silent_bins = 0
    for rates, bins in zip(stream.rates, busy, strict=True):
        runs = np.diff(np.flatnonzero(rates[bins]), prepend=-1, append=len(rates[bins])) - 1
        silent_bins += int(runs[runs >= limits.SILENCE_BINS].sum())
    share = silent_bins / max(sum(map(len, stream.rates)), 1)
    words = (
        f"{silent_bins} ms in gaps of {limits.SILENCE_BINS} ms or longer, {share:.1%} of the time"
    )
    if not (long := silences(spans)):
        return judged("events-gaps", share, words)
    occupied_us, long_us = length_of(spans), length_of(long)
    share = (share * occupied_us + long_us) / (occupied_us + long_us)
    first_us, end_us = max(long, key=lambda silence: silence[1] - silence[0])
    words = (
        f"no event of any camera for {significant((end_us - first_us) / 1e6, 4)} s, from "
        f"{first_us - 1} to {end_us} µs; {len(long)} such silences, {share:.1%} of the time; "
        f"beside them {words}"
    )
    more = ". The clock was set while it ran, or these are several takes"
    return judged("events-gaps", share, words, more=more)


def _ceiling(stream: Stream) -> Finding:
    rates, within = np.concatenate(stream.rates), limits.CEILING_WITHIN
    top = int(rates.max())
    share = float(np.mean(rates[rates > 0] >= (1 - within) * top))
    # Counts of a steady rate scatter by their root: only what is steadier than chance is a limit.
    steady = np.sqrt(top) < within * top / 2 and top * 1e6 / BIN_US >= limits.CEILING_HZ
    return judged(
        "events-ceiling", share,
        f"{share:.1%} of the milliseconds are within {within:.0%} of the busiest, "
        f"{significant(top * 1e3 / BIN_US, 3)} kev/s",
        verdict=None if steady else "good",
    )  # fmt: skip


def _refractory(stream: Stream) -> Finding:
    if len(stream.intervals_us) < limits.ENOUGH_EVENTS:
        return Finding("events-refractory", "good", None, "µs", "too few events for a verdict")
    least_us = float(np.percentile(stream.intervals_us, 1))
    words = f"99 % of a pixel's events are {least_us:.0f} µs or more apart"
    return judged("events-refractory", least_us, words)
