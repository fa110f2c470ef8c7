"""What a map folder says of itself: as plain values for programs, as tables for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from emvs.maps.folder import StoredMap, StoredWindow

_MOST_SKIPPED_SHOWN = 5


def facts(stored: StoredMap) -> dict[str, Any]:
    """Every window with its counts and points, and what was left out."""
    info = stored.info
    return {
        "windows": [
            {
                **window.info.model_dump(mode="json", exclude={"methods", "points"}),
                "points": _points_of(window),
            }
            for window in stored.windows
        ],
        "skipped": [window.model_dump(mode="json") for window in info.skipped],
        "hot_pixels": {
            camera: {"pixels": len(hot.pixels), "events": hot.events}
            for camera, hot in info.hot_pixels.items()
        },
        "without_pose": info.without_pose,
        "complete": info.complete,
    }


def tables(stored: StoredMap) -> Iterator[Table | str]:
    """One window in full; of several, sums and ranges, and which were skipped and why."""
    info, windows = stored.info, stored.windows
    points = [_points_of(window) for window in windows]
    counts = [window.info.counts for window in windows]
    title = "event statistics"
    if info.config.slides:
        title += f", summed over {len(windows)} windows"
    yield _counts(title, counts)
    yield _points(points)
    for camera, hot in info.hot_pixels.items():
        yield f"{camera}: {len(hot.pixels)} hot pixels dropped, with {hot.events:,} events"
    for camera, events in info.without_pose.items():
        if events:
            yield f"{camera}: {events:,} events before the first or after the last pose left out"
    yield from _skipped(stored)


def _points_of(window: StoredWindow) -> dict[str, int]:
    """Points per method; maps of older versions do not say it in their index."""
    methods = window.info.methods
    return window.info.points or {name: window.depth_map(name).points for name in methods}


def _skipped(stored: StoredMap) -> Iterator[str]:
    skipped = stored.info.skipped
    if not skipped:
        return
    total = len(skipped) + len(stored.windows)
    yield f"[bold]{len(skipped)} of {total} windows could not be mapped:"
    for window in skipped[:_MOST_SKIPPED_SHOWN]:
        yield f"{window.name}: {escape(window.reason)}"
    if len(skipped) > _MOST_SKIPPED_SHOWN:
        yield f"and {len(skipped) - _MOST_SKIPPED_SHOWN} more, see map.json"


def _counts(title: str, windows: Sequence[Mapping[str, Mapping[str, int]]]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("")
    for camera in windows[0]:
        table.add_column(camera, justify="right")
    for name in next(iter(windows[0].values())):
        cells = (f"{sum(counts[camera][name] for counts in windows):,}" for camera in windows[0])
        table.add_row(name.replace("_", " "), *cells)
    return table


def _points(windows: Sequence[Mapping[str, int]]) -> Table:
    table = Table(title="points", title_justify="left")
    table.add_column("method")
    if len(windows) == 1:
        table.add_column("pixels with depth", justify="right")
        for name, count in windows[0].items():
            table.add_row(name, f"{count:,}")
        return table
    for name in ("fewest", "median", "most"):
        table.add_column(f"{name} pixels\nwith depth", justify="right")
    for name in windows[0]:
        counts = sorted(points[name] for points in windows)
        shown = (counts[0], counts[len(counts) // 2], counts[-1])
        table.add_row(name, *(f"{count:,}" for count in shown))
    return table
