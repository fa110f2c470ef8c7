"""Where a recording has events: what bins or windows by time steps over the rest.

A clock that is set after the start jumps by decades, takes in one file lie hours apart, a single
stray stamp lies anywhere: work by time would never end.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording

LONGEST_SILENCE_US = 10_000_000
"""Longer ones are stepped over. Real pixels send noise many times a second, and ideal ones are
silent only while nothing moves: bodies rest for seconds."""
Span = tuple[int, int]
_PROBE_US = 10_000


def occupied_spans(recording: Recording, t0_us: int, t1_us: int) -> tuple[Span, ...]:
    """The parts of `t0_us <= t < t1_us` without the long silences of all cameras, half-open, µs.

    Without a long silence that is one, the whole. Where no event comes near there is none.
    """
    cameras = range(len(recording.rig))
    return joined([s for k in cameras for s in camera_spans(recording, k)], t0_us, t1_us)


def camera_occupied(recording: Recording, camera: int) -> tuple[Span, ...]:
    """One camera's time without its long silences, half-open, µs; of a silent one its begin."""
    first_us, last_us = recording.event_span_us(camera)
    spans = joined(camera_spans(recording, camera), first_us, last_us + 1)
    return spans or ((first_us, first_us + 1),)


def camera_spans(recording: Recording, camera: int) -> Iterable[Span]:
    """First and last event of each stretch of a camera without a long silence, µs.

    Recordings that know have a method `occupied_us`; others are asked for their events here and
    there.
    """
    known = getattr(recording, "occupied_us", None)
    return _probed(recording, camera) if known is None else known(camera)


def joined(spans: Iterable[Span], t0_us: int, t1_us: int) -> tuple[Span, ...]:
    """Spans, whose ends are included, as half-open ones within bounds; short silences join them."""
    out: list[Span] = []
    before_us = t0_us
    for first_us, last_us in sorted(spans):
        if last_us < t0_us or first_us >= t1_us:
            continue
        begin_us = max(first_us, t0_us)
        if begin_us - before_us < LONGEST_SILENCE_US:
            begin_us = out.pop()[0] if out else t0_us
        before_us = max(before_us, min(last_us, t1_us - 1))
        out.append((begin_us, before_us + 1))
    if t1_us - before_us <= LONGEST_SILENCE_US and t0_us < t1_us:
        out = [*out[:-1], (out[-1][0] if out else t0_us, t1_us)]
    return tuple(out)


def spans_of(t_us: NDArray[np.int64]) -> list[Span]:
    """First and last of each run of (N,) times, µs, in any order, without a long silence."""
    if not len(t_us):
        return []
    if int(t_us.max()) - int(t_us.min()) < LONGEST_SILENCE_US:
        return [(int(t_us.min()), int(t_us.max()))]
    t_us = np.sort(t_us)
    cut = np.flatnonzero(np.diff(t_us) >= LONGEST_SILENCE_US)
    firsts, lasts = t_us[np.append(0, cut + 1)], t_us[np.append(cut, len(t_us) - 1)]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def silences(spans: Sequence[Span]) -> list[Span]:
    """Begin and end of what lies between half-open spans, µs."""
    return [(before[1], after[0]) for before, after in pairwise(spans)]


def length_of(spans: Iterable[Span]) -> int:
    """How long spans are together, µs."""
    return sum(end_us - first_us for first_us, end_us in spans)


def beginning(spans: Iterable[Span], length_us: int) -> Iterator[Span]:
    """The first so many µs of half-open spans."""
    for first_us, end_us in spans:
        if length_us > 0:
            yield first_us, min(end_us, first_us + length_us)
        length_us -= end_us - first_us


def closed_up(t_us: NDArray[np.int64], spans: Sequence[Span]) -> NDArray[np.int64]:
    """(N,) times on a clock that stands still between half-open spans, µs; it begins as they do."""
    if len(spans) < 2:
        return t_us
    firsts, ends = np.array(spans, np.int64).T
    k = np.maximum(np.searchsorted(firsts, t_us, side="right") - 1, 0)
    since_us = np.minimum(t_us, ends[k] - 1) - firsts[k]
    before_us = np.cumsum(np.append(0, (ends - firsts)[:-1]))
    return np.asarray(firsts[0] + before_us[k] + since_us)


def steps(spans: Iterable[Span], length_us: int) -> Iterator[Span]:
    """Cuts each span into stretches of a length; its last one may be shorter."""
    for first_us, end_us in spans:
        for t_us in range(first_us, end_us, length_us):
            yield t_us, min(t_us + length_us, end_us)


def spread(spans: Sequence[Span], length_us: int, count: int) -> NDArray[np.int64]:
    """(N,) begins of `count` windows of a length, µs, evenly over half-open spans; all lie inside.

    Spans that are too short for one have none, unless all are.
    """
    long = [span for span in spans if span[1] - span[0] >= length_us] or list(spans[:1])
    rooms = [(first_us, max(end_us - length_us, first_us)) for first_us, end_us in long]
    ends = np.cumsum([last_us - first_us for first_us, last_us in rooms])
    at = np.linspace(0, ends[-1], count).astype(np.int64)
    which = np.searchsorted(ends[:-1], at, side="right")
    before = np.append(0, ends[:-1])[which]
    return np.asarray(np.array([first_us for first_us, _ in rooms])[which] + at - before)


class Silence:
    """Says of events that are still coming whether a time lies in a long silence.

    By the events before that time alone: it is the same however they come in packets.
    """

    def __init__(self) -> None:
        self.spans: list[Span] = []

    def push(self, packets: Iterable[NDArray[np.int64]]) -> None:
        """Takes the times, µs, of packets that are not earlier than those before."""
        for first_us, last_us in sorted(span for t_us in packets for span in spans_of(t_us)):
            if self.spans and first_us - self.spans[-1][1] < LONGEST_SILENCE_US:
                first_us, before_us = self.spans.pop()
                last_us = max(last_us, before_us)
            self.spans.append((first_us, last_us))

    def end_us(self, t_us: int, until_us: int) -> int | None:
        """When the next event has come, at most `until_us`, where none did for long; else None.

        Times asked for must not fall: what lies before them is forgotten.
        """
        while len(self.spans) > 1 and self.spans[1][0] < t_us:
            del self.spans[0]
        if not self.spans or t_us - self.spans[0][1] <= LONGEST_SILENCE_US:
            return None
        return self.spans[1][0] + 1 if len(self.spans) > 1 else until_us


def _probed(recording: Recording, camera: int) -> Iterator[Span]:
    """By events at times so close to each other that no long silence lies between unseen."""
    first_us, last_us = recording.event_span_us(camera)
    begin_us = before_us = _next(recording, camera, first_us, last_us + 1)
    while before_us is not None and begin_us is not None:
        probe_us = before_us + LONGEST_SILENCE_US // 2
        next_us = _next(recording, camera, probe_us, last_us + 1)
        if next_us is None or next_us - probe_us >= LONGEST_SILENCE_US // 2:
            end_us = _last(recording, camera, before_us, probe_us)
            if next_us is None or next_us - end_us >= LONGEST_SILENCE_US:
                yield begin_us, end_us
                begin_us = next_us
        before_us = next_us


def _next(recording: Recording, camera: int, t_us: int, end_us: int) -> int | None:
    """When the first event from a time on comes, µs: looks ever farther."""
    width_us = _PROBE_US
    while t_us < end_us:
        events = recording.events(camera, t_us, min(t_us + width_us, end_us))
        if len(events):
            return int(events.t_us.min())
        t_us, width_us = t_us + width_us, 2 * width_us
    return None


def _last(recording: Recording, camera: int, t_us: int, end_us: int) -> int:
    """When the last event before a time comes, µs, where there is one at `t_us`: looks back."""
    width_us = _PROBE_US
    while end_us > t_us:
        events = recording.events(camera, max(end_us - width_us, t_us), end_us)
        if len(events):
            return int(events.t_us.max())
        end_us, width_us = end_us - width_us, 2 * width_us
    return t_us
