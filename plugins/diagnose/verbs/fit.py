"""`eventsweep fit`: what sensor made a recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, Common, Force, command_line

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.diagnose.sensing.fit import SensorFit


def fit(
    recording: Path,
    /,
    *,
    out: Path,
    camera: int = 0,
    start_s: float | None = None,
    duration_s: float | None = None,
    columns: str = "",
    time_unit: str = "",
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Fit the sensor model to a recording: thresholds, bandwidth, refractory period, noise.

    What the recording does not determine is refused, with the reason. Thresholds and bandwidth need
    frames beside the events.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag, a recording.toml, or
            an event file, which determines less.
        out: Folder to write: sensor.toml, for `--sim.sensor.preset`, and report.html.
        camera: Which camera or stream.
        start_s: Start, s after the first event; by default 0.
        duration_s: Length, s; by default to the end.
        columns: Columns of a table of events, as `info` takes them; with --time-unit.
        time_unit: Unit of the times in such a file: s, ms, us or ns.
    """
    from eventsweep.emvs.datasets.raw_streams import open_readable
    from eventsweep.emvs.formats.tables.columns import column_map
    from eventsweep.emvs.utils.outputs import atomic_dir, check_output
    from eventsweep.plugins.diagnose.sensing.fit import fit_sensor, fit_stream
    from eventsweep.plugins.diagnose.sensing.folder import (
        SENSOR_NAME,
        part_of_span,
        write_fit,
    )

    check_output(out, force=force)
    console = common.console()
    readable = open_readable(recording, column_map(columns, time_unit))
    opened = readable.recording
    if not 0 <= camera < len(readable.streams):
        last = len(readable.streams) - 1
        raise InputError(f"{recording}: no camera {camera}, it has 0 to {last}")
    with console.progress.stage("fit", 1.0) as update:
        if opened is not None:
            span_us = opened.event_span_us(camera)
            part = part_of_span(opened.name, span_us, start_s, duration_s)
            fitted = fit_sensor(opened, camera, part)
        else:
            stream, source = readable.streams[camera]
            part = part_of_span(stream, source.span_us(), start_s, duration_s)
            fitted = fit_stream(source, readable.sizes_px[camera], part)
        with atomic_dir(out, force=force, inputs=(recording,)) as folder:
            name = recording.resolve().name if opened is None else opened.name
            write_fit(folder, fitted, name, command_line())
        update(1.0, f"{len(fitted.pixels):,} events")
    console.result({"estimates": [e.facts() for e in fitted.estimates]}, _summary(fitted))
    console.wrote(out / SENSOR_NAME)
    console.wrote(out / "report.html")


def _summary(fitted: SensorFit) -> Iterator[Part]:
    from eventsweep.eval.cli.console import dim, table

    rows = (
        (e.name, "refused" if e.refused else e.words[0], e.words[1], e.unit)
        for e in fitted.estimates
    )  # fmt: skip
    yield table("sensor", ("parameter", ">value", ">95 % ±", ">unit"), rows)
    reasons = dict.fromkeys(e.refused for e in fitted.estimates if e.refused)
    for reason in reasons:
        names = ", ".join(e.name for e in fitted.estimates if e.refused == reason)
        yield dim(f"{names}: {reason}")
