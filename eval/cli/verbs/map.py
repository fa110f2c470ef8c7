"""`eventsweep map`: a recording to depth maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from eventsweep.emvs.config import DeviceName
from eventsweep.eval.cli.app import (
    CONFIGURED,
    MAP,
    AllowSkipped,
    Configured,
    Force,
    MapFlags,
    Methods,
    app,
    check_skipping,
    with_values,
)
from eventsweep.eval.cli.help import RARE


@app.command
def map(  # noqa: A001 - the verb's name
    recording: Path,
    /,
    *,
    out: Path,
    method: Methods = (),
    device: Annotated[DeviceName | None, RARE] = None,
    allow_skipped: AllowSkipped = False,
    check: Annotated[bool, Parameter(negative="--no-check"), RARE] = True,
    force: Force = False,
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
        check: Warn of what looks wrong with the recording, a line each, as `eventsweep check` does.
    """
    from eventsweep.eval.cli.exit_codes import incomplete
    from eventsweep.eval.cli.verbs.report import report_stage
    from eventsweep.eval.pipeline import map_recording

    flags = with_values(map, methods=method or None, device=device)
    wanted = common.settings(map=flags)
    check_skipping(wanted.map, allowed=allow_skipped)
    common.check(out, recording, force=force)
    console = common.console()
    finish = report_stage(console.progress)
    stored = map_recording(
        recording, out, wanted, force=force, finish=finish, progress=console.progress,
        doubt=console.doubt if check else None,
    )  # fmt: skip
    console.mapped(stored)
    console.wrote(out / "report.html")
    return incomplete([stored.info], allowed=allow_skipped)
