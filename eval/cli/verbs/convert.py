"""`eventsweep convert`: anything readable into anything writable."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import QUIET, Force, Quiet, app


@app.command
def convert(
    source: Path,
    out: Path,
    /,
    *,
    to: str,
    stream: str = "",
    shift_us: int = 0,
    from_zero: bool = False,
    columns: str = "",
    time_unit: str = "",
    unit: str = "",
    width_px: int | None = None,
    height_px: int | None = None,
    baseline_m: float | None = None,
    window_s: float | None = None,
    stride_s: float | None = None,
    force: Force = False,
    common: Quiet = QUIET,
) -> None:
    """Convert a recording, events, poses, a calibration, a depth map or a point cloud.

    Args:
        source: File or folder to read; `eventsweep info` describes it.
        out: File or folder to write.
        to: A data set's layout or event format, tum, kitti, kalibr, basalt, opencv, rig,
            depth-png, depth-npy, depth-tiff, depth-exr, disparity-png, ply, pcd or
            windows (events and depth to learn from).
        stream: Stream to convert, where the source has several; a recording's streams are its
            cameras.
        shift_us: Shift of all times, µs.
        from_zero: Shift all times so that the first event or pose is at 0.
        columns: Columns of an HDF5, NumPy, MATLAB, Parquet or text file of events, such as
            "x=ev/xs,y=ev/ys,t=ev/ts,p=ev/on"; with --time-unit.
        time_unit: Unit of the times in such a file: s, ms, us or ns.
        unit: Unit of time in a text file of poses: s, ms, us or ns; by default what its header
            says, else s.
        width_px: Sensor width, if the input does not contain it.
        height_px: Sensor height, if the input does not contain it.
        baseline_m: Distance between the cameras, for disparity-png.
        window_s: Length of windows of events, each with the depth at its end, s; by default 0.05.
        stride_s: Shortest time between the ends of two windows, s; by default one ends at each time
            with ground truth.
    """
    from eventsweep.emvs.formats.tables.columns import column_map
    from eventsweep.eval.convert import Options, convert_file

    if shift_us and from_zero:
        raise InputError("--shift-us and --from-zero are both given: leave one of them out")
    console = common.console()
    options = Options(
        to=to,
        stream=stream,
        shift_us=None if from_zero else shift_us,
        unit=unit,
        width_px=width_px,
        height_px=height_px,
        baseline_m=baseline_m,
        window_s=window_s,
        stride_s=stride_s,
        force=force,
        columns=column_map(columns, time_unit),
    )
    written = convert_file(source, out, options, console.progress)
    console.progress.say(written.what)
    for note in written.notes:
        console.warn(note)
    console.wrote(out)
