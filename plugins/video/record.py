"""A video to a sequence on disk, or to a file of events in any format."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets.posed import CONVERTED, unit_stated
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, write_events
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import check_output, output_file
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.video.film import TOO_FAST, Film
from eventsweep.plugins.video.frames import open_frames
from eventsweep.sim.config import PixelConfig, VideoConfig

_PARTS = 1000  # of a video
SEQUENCE = "sequence"
UNCALIBRATED = "uncalibrated"
"""Name of a rig whose focal length is a guess."""


@dataclass(frozen=True)
class View:
    """Who watched: what turns events into something that can be mapped.

    Attributes:
        calibration: a file that `emvs.formats.calibration.read_rig` reads; None where unknown.
        camera: which of its cameras; not needed where it has one.
        poses: `T_world_cam` in TUM format, on the video's clock.
    """

    calibration: Path | None = None
    camera: str | None = None
    poses: Path | None = None

    def __post_init__(self) -> None:
        if self.calibration is None and (self.poses or self.camera) is not None:
            raise InputError(
                "poses and camera are given, but no calibration: a map needs both; give the "
                "calibration as well"
            )


@dataclass(frozen=True)
class RecordedVideo:
    """Result of converting a video to events.

    Attributes:
        path: the sequence or file that was written.
        format: `sequence`, or what `emvs.formats.FORMATS` calls it.
        width_px: columns.
        height_px: rows.
        frames: frames that the sensor saw, those of `upsample` included.
        events: events written.
        span_us: times of the first and the last frame, µs.
        time_base: where the times come from.
        encoding: what values were taken to stand for.
        lost_at_half_rate: whether frames are close enough together, see `plugins.video.film.Pace`.
        notes: what a user should know, a line each.
    """

    path: Path
    format: str
    width_px: int
    height_px: int
    frames: int
    events: int
    span_us: tuple[int, int]
    time_base: str
    encoding: str
    lost_at_half_rate: float
    notes: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """The same as plain values, for JSON."""
        return asdict(self) | {"path": str(self.path)}


def format_of(out: Path, to: str | None = None) -> str:
    """What to write: as asked, or as the name's end says, or a sequence.

    Raises:
        InputError: a format that is not known, or cannot be written.
    """
    writable = {name: known for name, known in FORMATS.items() if known.writes}
    if to is None:
        suffix = out.suffix.lower()
        named = (name for name, known in writable.items() if known.suffix == suffix)
        return next(named, SEQUENCE) if suffix else SEQUENCE
    if to != SEQUENCE and to not in writable:
        names = ", ".join((SEQUENCE, *writable))
        raise InputError(f"format {to!r} cannot be written: choose one of {names}")
    return to


def record(
    source: Path,
    out: Path,
    pixels: PixelConfig,
    video: VideoConfig,
    *,
    seed: int = 0,
    view: View | None = None,
    to: str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> RecordedVideo:
    """Turns a folder of images or a video file into events; see `eventsweep.video_to_events`.

    With `view`, calibration and poses, a sequence can be mapped. `progress` is called with
    `events`, and how many of 1000 parts of the video are done.

    Raises:
        InputError: what cannot be read, does not fit together, or may not be written.
    """
    view = view or View()
    kind = format_of(out, to)
    if kind != SEQUENCE and view.calibration is not None:
        raise InputError(f"{out}: an event file cannot hold calibration or poses; leave them out")
    inputs = (source, view, video, pixels)
    check_output(out, force=force)
    film = Film(open_frames(source, video), pixels, video, seed)
    if kind == SEQUENCE:
        notes = _to_sequence(film, out, view, progress, force=force, inputs=inputs)
    else:
        notes = []
        with output_file(out, force=force, inputs=inputs) as file, closing(iter(film)) as packets:
            write_events(
                file, kind, film.width_px, film.height_px,
                {"cam0": (labelled.events for labelled in packets)},
                lambda _count: progress(*_done(film)),
            )  # fmt: skip
    return RecordedVideo(
        out, kind, film.width_px, film.height_px, film.count, film.events, film.span_us,
        film.frames.time_base, film.light.said, film.pace.lost_at_half_rate,
        (*notes, *film.frames.notes(), *film.doubts.notes(film.events), *_pace_note(film)),
    )  # fmt: skip


def _to_sequence(
    film: Film, out: Path, view: View, progress: Progress, *, force: bool, inputs: Sequence[object]
) -> list[str]:
    """Writes a sequence; returns what is to be said of its poses."""
    with unit_stated(CONVERTED):
        poses = None if view.poses is None else read_poses(view.poses)
    parameters = film.pixels.sensor.resolved()
    ideal = parameters.ideal_pixels and parameters.ideal_readout
    source = film.frames.path.resolve()
    with (
        SequenceWriter(
            out, name=source.stem, rig=_rig(view, film), trajectory=poses,
            config=_configuration(film), seed=film.seed, renderer=f"video {source.name}",
            force=force, inputs=inputs,
        ) as writer,
        closing(iter(film)) as packets,
    ):  # fmt: skip
        for labelled in packets:
            writer.append_events(0, labelled.events, None if ideal else labelled.label)
            progress(*_done(film))
        writer.span_us = film.span_us
        writer.sensor_counts = None if ideal else [film.sensor.counts]
        return _pose_notes(view, poses, film.span_us)


def _done(film: Film) -> tuple[str, int, int]:
    return "events", round(_PARTS * film.frames.share), _PARTS


def _configuration(film: Film) -> dict[str, Any]:
    """What made the events, for the manifest."""
    return {
        **film.pixels.model_dump(mode="json", include=set(PixelConfig.model_fields)),
        "video": {
            **film.video.model_dump(mode="json"),
            "encoding": film.light.encoding,
            "full_scale": film.light.full_scale,
            "time_base": film.frames.time_base,
        },
    }


def _rig(view: View, film: Film) -> Rig:
    """The calibrated camera, or a guess that says so by its name."""
    size_px = width_px, height_px = film.width_px, film.height_px
    if view.calibration is None:
        centre = (width_px - 1) / 2, (height_px - 1) / 2
        focal_px = float(max(size_px))
        return Rig(UNCALIBRATED, (Camera(*size_px, focal_px, focal_px, *centre),), (np.eye(4),))
    rig = read_rig(view.calibration, () if view.camera is None else (view.camera,))
    names = rig.camera_names
    name = view.camera or (names[0] if len(rig) == 1 else None)
    if name not in names:
        raise InputError(
            f"{view.calibration}: cameras {', '.join(names)}; set camera to the one that took "
            "the video"
        )
    seen = rig.cameras[names.index(name)]
    if (seen.width_px, seen.height_px) != size_px:
        raise InputError(
            f"{view.calibration}: a camera of {seen.width_px}x{seen.height_px} px, the frames have "
            f"{width_px}x{height_px}: needs the calibration of this size"
        )
    return Rig(rig.name, (seen,), (np.eye(4),), (name,))  # poses are the camera's own


def _pose_notes(view: View, poses: Trajectory | None, span_us: tuple[int, int]) -> list[str]:
    if poses is None:
        return []
    first_us, last_us = poses.span_us
    both_us = min(last_us, span_us[1]) - max(first_us, span_us[0])
    if both_us <= 0:
        raise InputError(
            f"{view.poses}: poses from {first_us} to {last_us} µs, frames from {span_us[0]} to "
            f"{span_us[1]} µs: put both on one clock"
        )
    share = both_us / (span_us[1] - span_us[0])
    return [f"{view.poses}: poses cover {share:.1%} of the frames' time"] * (share < 1)


def _pace_note(film: Film) -> list[str]:
    lost = film.pace.lost_at_half_rate
    note = (
        f"{film.frames.path}: without every second frame {lost:.0%} of the "
        f"events would be missing, more than {TOO_FAST:.0%}: the image moves too far between "
        "frames, and an event camera would have seen more; film at a higher rate, or "
        "interpolate frames (upsample)"
    )
    return [note] * (lost > TOO_FAST)
