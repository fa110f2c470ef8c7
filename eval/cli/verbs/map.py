"""`eventsweep map`: a recording to depth maps."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from eventsweep.emvs.errors import one_line
from eventsweep.eval.cli.app import (
    CONFIGURED,
    MAP,
    AllowSkipped,
    Configured,
    DeviceName,
    Force,
    MapFlags,
    Methods,
    app,
    check_skipping,
    with_values,
)
from eventsweep.eval.cli.help import RARE
from eventsweep.eval.cli.job_flags import MAP_JOB_FLAGS, MapJobFlags

if TYPE_CHECKING:
    from rich.table import Table

    from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
    from eventsweep.eval.cli.console import Part

_MOST_SKIPPED_SHOWN = 5


@app.command
def map(  # noqa: A001 - the verb's name
    recording: Path,
    /,
    *,
    out: Path,
    method: Methods = (),
    device: DeviceName = None,
    allow_skipped: AllowSkipped = False,
    check: Annotated[bool, Parameter(negative="--no-check"), RARE] = True,
    force: Force = False,
    job_flags: MapJobFlags = MAP_JOB_FLAGS,
    common: Configured = CONFIGURED,
    map: MapFlags = MAP,  # noqa: A002 - the name is the flag's prefix
) -> int:
    """Map a recording: depth, confidence and point cloud per method.

    With --map.window-s or --map.window-events it maps sliding windows over the whole recording; the
    same command continues where it was stopped.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag or a recording.toml.
        out: Folder to write: map.json, report.html and a folder per window and method.
        method: Method to map with, repeatable; `eventsweep list methods`.
        device: Where the sweep runs; same as --map.device.
        allow_skipped: Exit with 0 even if some of the sliding windows could not be mapped.
        check: Warn about likely faults of the recording, one line each, as `eventsweep check` finds
            them.
    """
    from eventsweep.eval.cli.exit_codes import incomplete
    from eventsweep.eval.cli.flag_names import with_flags
    from eventsweep.eval.cli.verbs.report import report_stage
    from eventsweep.eval.pipeline import map_recording

    flags = with_values(map, methods=method or None, device=device)
    wanted = common.settings(map=flags)
    check_skipping(wanted.map, allowed=allow_skipped)
    crew = job_flags.crew(slides=wanted.map.slides)
    console = common.console()
    finish = report_stage(console.progress)
    stored = map_recording(
        recording, out, wanted, force=force, finish=finish, progress=console.progress,
        warn=_warn if check else None, note=lambda doubt: console.warn(with_flags(doubt)),
        crew=crew, cache=job_flags.cache_folder() if crew else None,
    )  # fmt: skip
    console.result({"map": str(stored.path), **_facts(stored)}, _tables(stored))
    console.wrote(out / "report.html")
    return incomplete([stored.info], allowed=allow_skipped)


def _warn(doubt: str) -> None:
    from eventsweep.eval.cli.flag_names import with_flags

    sys.stderr.write(f"check: {one_line(with_flags(doubt))}\n")


def _facts(stored: StoredMap) -> dict[str, Any]:
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


def _tables(stored: StoredMap) -> Iterator[Part]:
    """One window in full; of several, sums and ranges, and which were skipped and why."""
    info, windows = stored.info, stored.windows
    title = "event statistics"
    if info.config.slides:
        title += f", summed over {len(windows)} windows"
    yield _counts(title, [window.info.counts for window in windows])
    yield _points([_points_of(window) for window in windows])
    for camera, hot in info.hot_pixels.items():
        yield f"{camera}: {len(hot.pixels):,} hot pixels dropped, with {hot.events:,} events"
    for camera, events in info.without_pose.items():
        if events:
            yield (
                f"{camera}: {events:,} events before the first or after the last pose were left out"
            )
    yield from _skipped(stored)


def _points_of(window: StoredWindow) -> dict[str, int]:
    """Points per method; maps of older versions do not say it in their index."""
    methods = window.info.methods
    return window.info.points or {name: window.depth_map(name).points for name in methods}


def _skipped(stored: StoredMap) -> Iterator[Part]:
    from rich.text import Text

    skipped = stored.info.skipped
    if not skipped:
        return
    total = len(skipped) + len(stored.windows)
    yield Text(f"{len(skipped)} of {total} windows could not be mapped:", style="bold")
    for window in skipped[:_MOST_SKIPPED_SHOWN]:
        yield f"{window.name}: {window.reason}"
    if len(skipped) > _MOST_SKIPPED_SHOWN:
        yield f"and {len(skipped) - _MOST_SKIPPED_SHOWN} more, see map.json"


def _counts(title: str, windows: Sequence[Mapping[str, Mapping[str, int]]]) -> Table:
    from eventsweep.eval.cli.console import table

    cameras = list(windows[0])
    rows = (
        (
            name.replace("_", " "),
            *(f"{sum(counts[camera][name] for counts in windows):,}" for camera in cameras),
        )
        for name in windows[0][cameras[0]]
    )
    return table(title, ("", *(f">{camera}" for camera in cameras)), rows)


def _points(windows: Sequence[Mapping[str, int]]) -> Table:
    from eventsweep.eval.cli.console import table

    counts = {name: sorted(points[name] for points in windows) for name in windows[0]}
    if len(windows) == 1:
        alone = ((name, f"{count:,}") for name, (count,) in counts.items())
        return table("points", ("method", ">pixels with depth"), alone)
    headings = (f">{name} pixels\nwith depth" for name in ("fewest", "median", "most"))
    rows = (
        (name, f"{count[0]:,}", f"{count[len(count) // 2]:,}", f"{count[-1]:,}")
        for name, count in counts.items()
    )
    return table("points", ("method", *headings), rows)
