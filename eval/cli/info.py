"""`eventsweep info`: what a recording or event file is."""

from __future__ import annotations

from pathlib import Path

from emvs.utils.outputs import check_output, output_file
from eval.cli.app import COMMON, Common, app


@app.command
def info(
    path: Path,
    /,
    *,
    picture: Path | None = None,
    common: Common = COMMON,
) -> None:
    """Say what lies at a path: cameras, times, event counts and faults, and what poses cover.

    Args:
        path: A sequence, a data set's folder, a recording.toml, an event file or a bag.
        picture: PNG to draw: events per pixel and polarity, and their rate over time.
    """
    from eval.inspect import facts, inspect

    read = (path,)
    if picture is not None:
        check_output(picture, force=common.force, inputs=read, folder=False)
    console = common.console()
    readable, counts = inspect(path, console.progress)
    description = facts(readable, counts)
    if not common.quiet:
        from eval.inspect import show

        show(description, as_json=common.json)
    if picture is not None:
        from eval.inspect import draw

        names = [name for name, _ in readable.streams]
        title = f"{readable.path.resolve().name}: {readable.what}"
        with output_file(picture, force=common.force, inputs=read) as place:
            draw(place, title, names, counts)
        console.wrote(picture)
