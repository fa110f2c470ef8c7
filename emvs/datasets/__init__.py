"""Opens any recording that is known, by what lies in its folder."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from eventsweep.emvs.data.manifest import FILE_NAME
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.ecd import FILES, EventCameraDataset
from eventsweep.emvs.errors import InputError, check_path, shown
from eventsweep.emvs.utils.mirror import fetched

DESCRIPTOR = "recording.toml"


# Of `Recording`, all that a mapper needs.
_MEMBERS = ("name", "rig", "trajectory", "depth_range_m", "event_span_us", "events")


class NoRecordingError(InputError):
    """What lies at a path is no recording, not even a bad one."""


def open_recording(path: str | Path) -> Recording:
    """Opens a sequence of ours, a data set as its publisher lays it out, or a `recording.toml`.

    Raises:
        NoRecordingError: nothing there, or nothing known.
        InputError: a file that is missing, damaged or impossible.
    """
    check_path("path", path)
    path = fetched(Path(path))
    if not path.exists():
        raise NoRecordingError(f"{path}: no such folder; needs a recording's folder")
    if not path.is_dir():
        return _file(path)
    if (path / FILE_NAME).exists():
        return Sequence.open(path)
    if (path / DESCRIPTOR).exists():
        return _file(path / DESCRIPTOR)
    layout = _layout(path)
    if layout is not None:
        return layout(path)
    bag = _bag_in(path)
    if bag is not None:
        return _file(bag)
    missing = [name for name in FILES if not (path / name).exists()]
    if not missing:
        return EventCameraDataset(path)
    if missing != list(FILES):
        raise InputError(
            f"{path}: looks like the Event Camera Dataset, but lacks {', '.join(missing)}"
        )
    raise NoRecordingError(
        f"{path}: not recognised as a recording; needs {FILE_NAME} (a sequence by eventsweep), "
        f"{', '.join(FILES)} (Event Camera Dataset), events/left/events.h5 (DSEC), "
        "*-events_left.h5 (TUM-VIE), *_data.hdf5 (MVSEC), *_data.h5 (M3ED), *.left_event.hdf5 "
        f"(VECtor), dataset_events_t.npy (EVIMO2), events.h5 (EDS), a ROS bag, or a {DESCRIPTOR}"
    )


def opened(recording: Recording | str | Path) -> Recording:
    """A recording, or the one at a path.

    Raises:
        InputError: nothing known at the path, or neither a path nor a recording.
    """
    if isinstance(recording, str | Path):
        return open_recording(recording)
    lacks = []
    for name in _MEMBERS:
        with suppress(InputError):  # a member is there, even where its data are not
            lacks += [] if hasattr(recording, name) else [name]
    if lacks:
        raise InputError(
            f"recording is {shown(recording)}: needs a path, what open_recording returned, or a "
            f"class of your own with {', '.join(lacks)}"
        )
    return recording


def _file(path: Path) -> Recording:
    from eventsweep.emvs.datasets.custom import assembled, read_descriptor

    if path.suffix == ".toml":
        return assembled(path.parent, read_descriptor(path), DESCRIPTOR)
    from eventsweep.emvs.datasets.rosbag import SUFFIXES, open_bag_recording

    if path.is_dir() or path.suffix in SUFFIXES:
        return open_bag_recording(path)
    raise NoRecordingError(
        f"{path}: is a file; needs the folder of a recording, a ROS bag or a {DESCRIPTOR}"
    )


def bag_of(path: Path) -> Path | None:
    """The ROS bag that `open_recording` opens at a folder; None where it is something else."""
    ours = (path / FILE_NAME).exists() or (path / DESCRIPTOR).exists()
    return None if ours or _layout(path) is not None else _bag_in(path)


def _bag_in(path: Path) -> Path | None:
    from eventsweep.emvs.datasets.posed import find_optional
    from eventsweep.emvs.datasets.rosbag import METADATA, bag_at

    if (path / METADATA).exists():
        return bag_at(path) or path
    return find_optional(path, ["*.bag"], "the bag") or bag_at(path)


def _layout(path: Path) -> Callable[[Path], Recording] | None:
    """What opens a data set with a module of its own, if the folder looks like one."""
    from eventsweep.emvs.datasets import described, dsec, evimo2, mvsec_m3ed

    layouts: dict[str, Callable[[Path], Recording]] = {
        dsec.LEFT: dsec.open_dsec,
        described.TUMVIE_LEFT: described.open_tumvie,
        described.VECTOR_LEFT: described.open_vector,
        described.EDS_EVENTS: described.open_eds,
        mvsec_m3ed.MVSEC_DATA: mvsec_m3ed.open_mvsec,
        mvsec_m3ed.M3ED_DATA: mvsec_m3ed.open_m3ed,
        evimo2.TIMES: evimo2.open_evimo2,
    }
    return next((opens for pattern, opens in layouts.items() if any(path.glob(pattern))), None)
