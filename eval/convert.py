"""Converts anything readable into anything writable: recordings, events, poses, rigs, depth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.poses import read_poses, write_kitti, write_tum
from eventsweep.emvs.data.recording import Recording, has_poses
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.export import RecordingExport, kinds, left_out, write_recording
from eventsweep.emvs.datasets.posed import EventSource
from eventsweep.emvs.datasets.raw_streams import Readable, open_readable
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, calibration_writers, depth, write_events
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import inputs_of, opened_npz, parse_json
from eventsweep.emvs.utils.outputs import check_output, output_file
from eventsweep.eval.progress import Display

POSES = ("tum", "kitti")
CLOUDS = ("ply", "pcd")
WINDOWS = "windows"


@dataclass(frozen=True)
class Options:
    """What can be chosen.

    Attributes:
        to: the format to write.
        stream: the only stream to convert, of an event file with several or of a recording.
        shift_us: added to all times; None: such that the first event or pose is at 0.
        unit: unit of time of a text of poses; empty: what its header says, else s.
        width_px: sensor width, where the input does not say it, as `height_px`.
        baseline_m: distance between the cameras, for disparity.
        window_s: length of windows to learn from, as of `TrainingWindows`; so `stride_s`.
        columns: which column of an event file is what, and what its times count, if stated.
        inputs: other files that the output must not replace, such as a configuration.
    """

    to: str
    stream: str = ""
    shift_us: int | None = 0
    unit: str = ""
    width_px: int | None = None
    height_px: int | None = None
    baseline_m: float | None = None
    window_s: float | None = None
    stride_s: float | None = None
    force: bool = False
    columns: ColumnMap | None = None
    inputs: tuple[Path, ...] = ()


def targets() -> list[str]:
    """Every format that can be written."""
    files = [*POSES, *calibration_writers.WRITERS, *depth.WRITERS, "disparity-png", *CLOUDS]
    return [*kinds(), *files, WINDOWS]


@dataclass(frozen=True)
class Written:
    """What was written, in a sentence, and notes on what is wrong with it as with the input."""

    what: str
    notes: tuple[str, ...] = ()


def convert_file(source: Path, out: Path, options: Options, progress: Display) -> Written:
    """Converts one thing."""
    to = options.to
    if to not in targets():
        raise InputError(f"--to {to}: unknown; choose from {', '.join(targets())}")
    _refuse_unused(options)
    inputs = inputs_of(source, options.inputs)
    check_output(out, force=options.force)
    if source.is_dir() or source.suffix == ".toml":
        _refuse_own(out, inputs)
    if to == WINDOWS:
        return _windows(source, out, options, inputs, progress)
    if to in kinds():
        return _events(source, out, options, inputs, progress)
    with output_file(out, force=options.force, inputs=inputs) as place:
        if to in POSES:
            return _poses(source, place, options)
        if to in calibration_writers.WRITERS:
            rig, notes = _rig(source)
            calibration_writers.WRITERS[to](place, rig)
            return Written(f"calibration as {to}", notes)
        return Written((_cloud if to in CLOUDS else _depth)(source, place, options))


def _refuse_own(out: Path, inputs: Sequence[Path]) -> None:
    """Refuses to put what was made of a recording in the place of one of its own files."""
    place = out.resolve()
    own = [path for path in inputs if path.resolve() in (place, *place.parents)]
    if own and out.exists():
        raise InputError(f"{out}: is part of the input {own[0]}: choose another name")


def _refuse_unused(options: Options) -> None:
    """Refuses options that say nothing about the format asked for."""
    events, poses = options.to in kinds(), options.to in POSES
    windows = options.to == WINDOWS
    lengths = (options.window_s, options.stride_s)
    useless = {
        "--stream": bool(options.stream) and not (events or windows),
        "--window-s and --stride-s": lengths != (None, None) and not windows,
        "--shift-us and --from-zero": options.shift_us != 0 and not (events or poses),
        "--unit": bool(options.unit) and not poses,
        "--width-px": options.width_px is not None and not events,
        "--height-px": options.height_px is not None and not events,
        "--columns and --time-unit": options.columns is not None and not events,
        "--baseline-m": options.baseline_m is not None and options.to != "disparity-png",
    }
    for flag, is_useless in useless.items():
        if is_useless:
            have = "have no effect" if " and " in flag else "has no effect"
            raise InputError(f"{flag} {have} with --to {options.to}: leave it out")


def _events(
    source: Path, out: Path, options: Options, inputs: tuple[Path, ...], progress: Display
) -> Written:
    readable = open_readable(source, options.columns)
    shift_us = options.shift_us if options.shift_us is not None else -_start_us(readable)
    counted, chosen, lost = [0], _chosen(readable, options), ""
    with progress.stage(f"write {options.to}", 1.0) as update:

        def report_progress(done: int) -> None:
            counted[0] = max(counted[0], done)
            share = sum(source.share for _, source in chosen) / len(chosen)
            update(share, f"{done:,} events")

        if readable.recording is not None and _is_whole(readable.recording, out, options):
            sources = tuple(source for _, source in chosen)
            job = RecordingExport(readable.recording, sources, shift_us, report_progress)
            write_recording(job, out, options.to, force=options.force, inputs=inputs)
            what = f"recording of {len(sources)} cameras as {options.to}"
            lost = left_out(readable.recording, options.to)
        else:
            with output_file(out, force=options.force, inputs=inputs) as place:
                count = _event_file(readable, chosen, place, options, shift_us, report_progress)
            what = f"{count:,} events as {options.to}"
    moved = f", all times shifted by {shift_us} µs" if shift_us else ", times as they were"
    return Written(what + moved, (*_notes(chosen), *filter(None, [lost])))


def _is_whole(recording: Recording, out: Path, options: Options) -> bool:
    """Whether a recording's folder is written, and not a file of its events.

    Without poses one camera's events become a file, those of several where `out` is named as one.
    """
    if options.stream or has_poses(recording) or options.to not in FORMATS:
        return not options.stream
    suffix = FORMATS[options.to].suffix
    return len(recording.rig) > 1 and not (suffix and out.suffix.lower() == suffix)


def _windows(
    source: Path, out: Path, options: Options, inputs: tuple[Path, ...], progress: Display
) -> Written:
    """Events and the depth at their end, a file per window."""
    from eventsweep.emvs.datasets.training import WINDOW_S, TrainingWindows, write_windows

    recording: Any = open_recording(source)
    names = list(recording.rig.camera_names)
    if options.stream and options.stream not in names:
        raise InputError(f"{source}: no stream {options.stream}; choose from {names}")
    windows = TrainingWindows(
        recording,
        window_s=WINDOW_S if options.window_s is None else options.window_s,
        stride_s=options.stride_s or 0.0,
        camera=names.index(options.stream) if options.stream else 0,
    )
    with progress.stage("write windows", len(windows)) as update:
        count = write_windows(
            windows,
            out,
            force=options.force,
            inputs=inputs,
            on_written=lambda done: update(done, ""),
        )
    return Written(f"{count:,} windows of {windows.window_s:g} s with depth")


def _notes(streams: Sequence[tuple[str, EventSource]]) -> Iterator[str]:
    """Streams that are not in the order of time: the format holds them, mapping refuses them."""
    for name, source in streams:
        if source.late:
            yield (
                f"{name}: {source.late:,} events come after later ones, as in the input; they "
                "cannot be mapped: sort by time (stable sort)"
            )


def _chosen(readable: Readable, options: Options) -> list[tuple[str, EventSource]]:
    """The streams that are converted."""
    if not options.stream:
        return list(readable.streams)
    names = [name for name, _ in readable.streams]
    if options.stream not in names:
        raise InputError(f"{readable.path}: no stream {options.stream}; choose from {names}")
    return [(name, source) for name, source in readable.streams if name == options.stream]


def _event_file(
    readable: Readable,
    chosen: Sequence[tuple[str, EventSource]],
    out: Path,
    options: Options,
    shift_us: int,
    report_progress: Callable[[int], None],
) -> int:
    if options.to not in FORMATS:
        why = "has events but no calibration" if readable.recording is None else "is one stream"
        raise InputError(f"{readable.path}: {why}; --to {options.to} needs a whole recording")
    if len(chosen) > 1 and FORMATS[options.to].limits.streams == 1:
        raise InputError(
            f"{readable.path}: {len(chosen)} streams ({', '.join(dict(chosen))}) into "
            f"{options.to}, which holds one: choose with --stream"
        )
    sizes_px = _sizes_px(readable, [name for name, _ in chosen], options)
    width, height = next(iter(sizes_px.values()))
    streams = {
        name: (events.shifted(shift_us) for events in source.chunks()) for name, source in chosen
    }
    return write_events(out, options.to, width, height, streams, report_progress, sizes_px)


def _sizes_px(
    readable: Readable, names: Sequence[str], options: Options
) -> dict[str, tuple[int, int]]:
    """Width and height of each stream's sensor: as asked, as the input says, or as a neighbour's.

    A file often says a size once for all streams.
    """
    own = dict(zip(dict(readable.streams), readable.sizes_px, strict=True))
    any_px = next((size_px for size_px in readable.sizes_px if size_px), (None, None))
    sizes_px = {}
    for name in names:
        known = own[name] or any_px
        width, height = options.width_px or known[0], options.height_px or known[1]
        if width is None or height is None:
            raise InputError(
                f"{readable.path}: does not say the sensor's size; add --width-px and --height-px"
            )
        sizes_px[name] = width, height
    return sizes_px


def _start_us(readable: Readable) -> int:
    """The earliest event or pose."""
    first = [source.span_us()[0] for _, source in readable.streams]
    if readable.recording is not None and has_poses(readable.recording):
        first.append(readable.recording.trajectory.span_us[0])
    return min(first)


def _poses(source: Path, out: Path, options: Options) -> Written:
    poses = _trajectory(source, options.unit)
    notes = poses.notes
    if options.shift_us is None or options.shift_us:
        shift = -poses.span_us[0] if options.shift_us is None else options.shift_us
        poses = Trajectory(poses.t_us + shift, poses.positions_m, poses.quats_xyzw)
    if options.to == "kitti":
        write_kitti(out, poses)
        return Written(f"{len(poses)} poses as KITTI rows, without their times", notes)
    write_tum(out, poses)
    return Written(f"{len(poses)} poses as TUM rows", notes)


def _trajectory(source: Path, unit: str) -> Trajectory:
    from eventsweep.emvs.datasets.bags import read_bag_poses
    from eventsweep.emvs.datasets.custom import is_bag

    if is_bag(source):
        return read_bag_poses(source)
    if source.is_dir() or source.suffix == ".toml":
        return open_recording(source).trajectory
    return read_poses(source, unit)


def _rig(source: Path) -> tuple[Rig, tuple[str, ...]]:
    """A rig, and what of its file is not in it."""
    from eventsweep.emvs.formats.calibration import left_out, read_rig

    if source.is_dir() or source.suffix in (".toml", ".bag", ".mcap", ".db3"):
        return open_recording(source).rig, ()
    rig = read_rig(source)
    note = left_out(source)
    return rig, (f"{source.name}: {note}",) if note else ()


def _depth(source: Path, out: Path, options: Options) -> str:
    depth_m = depth.read_depth(source)
    if options.to != "disparity-png":
        depth.WRITERS[options.to](out, depth_m)
        return f"depth map of {depth_m.shape[1]}x{depth_m.shape[0]} as {options.to}"
    from eventsweep.emvs.datasets.dsec import write_disparity

    focal_px = _focal_px(source)
    if options.baseline_m is None:
        raise InputError(f"{source}: contains no baseline; add --baseline-m")
    write_disparity(out, depth_m, focal_px * options.baseline_m)
    return f"disparity, b·f {focal_px * options.baseline_m:.3f} px·m"


def _focal_px(source: Path) -> float:
    if source.suffix != ".npz":
        raise InputError(f"{source}: contains no focal length; needs a map's depth.npz")
    try:
        with opened_npz(source) as stored:
            return float(parse_json(str(stored["camera"]))["fx_px"])
    except (KeyError, ValueError, OSError, TypeError) as error:
        raise InputError(f"{source}: contains no camera; needs a map's depth.npz") from error


def _cloud(source: Path, out: Path, options: Options) -> str:
    from eventsweep.emvs.depth.tsdf import load_open3d

    if source.suffix not in (".ply", ".pcd") or not source.is_file():
        raise InputError(f"{source}: no point cloud; needs a .ply or .pcd file")
    o3d = load_open3d()
    cloud = o3d.io.read_point_cloud(source)
    if not cloud.has_points():
        raise InputError(f"{source}: contains no points, or is damaged; export it again")
    if out.suffix != f".{options.to}":
        raise InputError(f"{out}: needs a name that ends in .{options.to}")
    with atomic_path(out) as partial:
        if not o3d.io.write_point_cloud(partial, cloud):
            raise InputError(f"{out}: could not be written; is the disk full?")
    return f"{len(cloud.points):,} points as {options.to}"
