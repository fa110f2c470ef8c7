"""Opens any recording that is known, by what lies in its folder."""

from __future__ import annotations

from pathlib import Path

from emvs.data.manifest import FILE_NAME
from emvs.data.recording import Recording
from emvs.data.sequence import Sequence
from emvs.errors import InputError
from emvs.io.event_camera_dataset import FILES, EventCameraDataset


def open_recording(path: Path) -> Recording:
    """Opens a sequence of ours, or a data set as its publisher lays it out.

    Raises:
        InputError: nothing there, nothing known, or a file that is missing, damaged or impossible.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such folder; needs a recording")
    if not path.is_dir():
        raise InputError(f"{path}: is a file; needs the folder of a recording")
    if (path / FILE_NAME).exists():
        return Sequence.open(path)
    missing = [name for name in FILES if not (path / name).exists()]
    if not missing:
        return EventCameraDataset(path)
    if len(missing) < len(FILES):
        raise InputError(
            f"{path}: looks like the Event Camera Dataset, but lacks {', '.join(missing)}"
        )
    raise InputError(
        f"{path}: no recording recognised; needs {FILE_NAME} (a sequence of eventsweep) "
        f"or {', '.join(FILES)} (Event Camera Dataset)"
    )
