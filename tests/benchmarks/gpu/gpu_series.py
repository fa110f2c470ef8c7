"""How the GPU's time grows, and how fast a long sequence streams through it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from cost_growth import Growth
from cost_stream import WINDOW_US, MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import RecordingInfo
from eventsweep.emvs.maps.sliding import map_windows
from gpu_calls import call
from gpu_plan import BenchmarkPlan


@dataclass(frozen=True)
class WindowedStream:
    """A recording mapped in windows of half a second.

    Attributes:
        events: events of all cameras and windows.
        windows: how many there were.
        mapped_s: mapping alone, nothing written, s.
        written_s: with everything written to a map folder, as `eventsweep map` does, s.
    """

    events: int
    windows: int
    mapped_s: float
    written_s: float


def grow(base: MovingEdges, plan: BenchmarkPlan, device: str) -> list[Growth]:
    """Times as events, planes and pixels grow, each from the load of the whole call."""
    return [
        _grown("events", plan.grow_events, plan, device,
               lambda n: (MovingEdges(plan.size_px, n), plan)),
        _grown("planes", plan.grow_planes, plan, device, lambda n: (base, replace(plan, planes=n))),
        _grown("pixels", [w * h for w, h in plan.grow_sizes], plan, device,
               lambda n: (MovingEdges(_of(plan.grow_sizes, n), plan.events), plan)),
    ]  # fmt: skip


def _of(sizes: Iterable[tuple[int, int]], pixels: int) -> tuple[int, int]:
    return next((width, height) for width, height in sizes if width * height == pixels)


def _grown(
    quantity: str, amounts: Iterable[int], plan: BenchmarkPlan, device: str,
    load: Callable[[int], tuple[MovingEdges, BenchmarkPlan]],
) -> Growth:  # fmt: skip
    seconds = []
    for amount in amounts:
        recording, sized = load(amount)
        recording.event_span_us(0)  # makes the events now
        done, _ = call(recording, sized.config(device), plan.grow_rounds)
        seconds.append(done.median_s)
    return Growth(quantity, tuple(amounts), tuple(seconds))


def stream(plan: BenchmarkPlan, device: str, windows: int) -> WindowedStream:
    """Maps a sequence window by window, without and with writing."""
    recording = MovingEdges(plan.size_px, plan.window_events, windows=windows)
    recording.event_span_us(0)
    config = plan.config(device)
    _map(recording, config, 1)  # compiles what is not compiled yet
    begin = time.perf_counter()
    _map(recording, config, windows)
    mapped_s = time.perf_counter() - begin
    sliding = config.model_copy(update={"duration_s": None, "window_s": 1e-6 * WINDOW_US})
    about = RecordingInfo(name=recording.name, path="memory")
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        written = map_windows(recording, Path(folder) / "map", sliding, about, clouds=False)
        written_s = time.perf_counter() - begin
    events = 2 * plan.window_events * windows
    return WindowedStream(events, len(written.windows), mapped_s, written_s)


def _map(recording: MovingEdges, config: MapperConfig, windows: int) -> None:
    for k in range(windows):
        start_s = 1e-6 * WINDOW_US * k
        map_window(recording, config.model_copy(update={"start_s": start_s}))
