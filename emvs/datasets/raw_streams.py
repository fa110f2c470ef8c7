"""The event streams of anything readable, as its files hold them: unsorted or stray events too."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eventsweep.emvs.data.recording import Recording, has_poses
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import bag_of, open_recording
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.datasets.evimo2 import INFO, TIMES
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, open_events
from eventsweep.emvs.formats.tables.columns import ColumnMap


@dataclass(frozen=True)
class Readable:
    """What was found at a path, `what` in words: streams, or a recording of which they are.

    `streams` has name and events of each camera or topic, `sizes_px` their sensors' where known.
    """

    path: Path
    what: str
    recording: Recording | None
    streams: tuple[tuple[str, EventSource], ...]
    sizes_px: tuple[tuple[int, int] | None, ...]


def open_readable(path: Path, columns: ColumnMap | None = None) -> Readable:
    """Opens a recording, or else an event file, whose columns may be stated.

    A ROS bag or folder of EVIMO2 without calibration is opened for its events alone, and `what`
    says why; one whose calibration or poses are damaged is refused.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; needs a recording or an event file")
    if columns is not None and (path.is_dir() or path.suffix == ".toml"):
        raise InputError(
            f"{path}: columns can be given for an event file only; for a recording, set them in "
            "a recording.toml"
        )
    alone = (path / TIMES).exists() and not (path / INFO).exists()
    bag = bag_of(path) if path.is_dir() and not alone else None
    if path.suffix == ".toml" or (path.is_dir() and not alone and bag is None):
        return _recording(path)
    path = bag or path
    reader, why = open_events(path, columns), f"no {INFO}" if alone else ""
    if reader.format.startswith("rosbag"):
        from eventsweep.emvs.datasets.rosbag import lacks

        why = lacks(path)
        if not why:
            return _recording(path)
    sizes_px = tuple(map(reader.size_px, reader.streams))
    streams = tuple((name, EventSource(path, name, 0, columns)) for name in reader.streams)
    what = f"{FORMATS[reader.format].what} ({reader.format})"
    what += f"; events alone: {why}" if why else ""
    return Readable(path, what, None, streams, sizes_px)


def _recording(path: Path) -> Readable:
    recording = open_recording(path)
    what, sources = _sources(recording)
    streams = tuple(zip(recording.rig.camera_names, sources, strict=True))
    sizes_px = tuple((c.width_px, c.height_px) for c in recording.rig.cameras)
    if not has_poses(recording):
        lacks = getattr(recording, "poses", "")  # a sequence's own, there or not, have one place
        what += f"; no poses: {lacks}" if lacks else "; no poses"
    return Readable(path, what, recording, streams, sizes_px)


def _sources(recording: Recording) -> tuple[str, tuple[EventSource, ...]]:
    match recording:
        case Sequence():
            files = [recording.path / f"cam{k}" / "events.h5" for k in range(len(recording.rig))]
            return "sequence of eventsweep", tuple(EventSource(file) for file in files)
        case EventCameraDataset():
            return "Event Camera Dataset", (EventSource(recording.path / "events.txt"),)
        case PosedRecording():
            return f"recording ({recording.layout})", recording.sources
    raise InputError(f"{recording.name}: its event files are unknown")
