"""`eventsweep info`: what a recording or event file is."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import check_output, output_file
from eventsweep.eval.cli.app import COMMON, Common, Force, app


@app.command
def info(
    path: Path,
    /,
    *,
    picture: Path | None = None,
    columns: str = "",
    time_unit: str = "",
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Describe a recording: cameras, times, event counts, faults and pose coverage.

    Args:
        path: A sequence, a data set's folder, a recording.toml, an event file or a bag.
        picture: PNG to draw: events per pixel and polarity, and their rate over time.
        columns: Columns of an HDF5, NumPy, MATLAB, Parquet or text file of events, such as
            "x=ev/xs,y=ev/ys,t=ev/ts,p=ev/on"; with --time-unit.
        time_unit: Unit of the times in such a file: s, ms, us or ns.
    """
    from eventsweep.emvs.formats.tables.columns import column_map
    from eventsweep.eval.inspect import facts, inspect, summary

    if force and picture is None:
        raise InputError("--force without --picture has no effect: add --picture, or leave it out")
    if picture is not None:
        check_output(picture, force=force)
    console = common.console()
    readable, counts = inspect(path, console.progress, column_map(columns, time_unit))
    description = facts(readable, counts)
    console.result(description, summary(description))
    if picture is not None:
        from eventsweep.eval.figures.event_counts import draw_counts

        names = [name for name, _ in readable.streams]
        title = f"{readable.path.resolve().name}: {readable.what}"
        with output_file(picture, force=force, inputs=(path,)) as place:
            draw_counts(place, title, names, counts)
        console.wrote(picture)
