"""Opens any known event file by its content."""

from __future__ import annotations

from pathlib import Path

from emvs.errors import InputError
from emvs.io.events.contract import EventReader
from emvs.io.events.raw import opened

_HDF5 = b"\x89HDF\r\n\x1a\n"
_OLD_AEDAT = b"#!AER-DAT"


def open_events(path: Path) -> EventReader:
    """Opens an event file, or the folder of a ROS2 bag; reads no events yet.

    Raises:
        InputError: nothing there, nothing known, or a file that is damaged.
    """
    path = Path(path)
    if path.is_dir():
        return _folder(path)
    if not path.exists():
        raise InputError(f"{path}: no such file; needs a file of events")
    if not path.is_file():
        raise InputError(f"{path}: is a pipe or device; copy its content into a file first")
    with opened(path) as file:
        head = file.read(16)
    if not head:
        raise InputError(f"{path}: is empty; fetch it again")
    return _file(path, head)


def _folder(path: Path) -> EventReader:
    from emvs.io.events.rosbag import RosbagReader

    if not (path / "metadata.yaml").exists():
        raise InputError(f"{path}: a folder without metadata.yaml; needs a file, or a ROS2 bag")
    return RosbagReader(path)


def _file(path: Path, head: bytes) -> EventReader:
    # Each import waits until its format is met: together they cost half a second.
    if head.startswith(_HDF5):
        from emvs.io.events.hdf5_reader import Hdf5Reader

        return Hdf5Reader(path)
    if head.startswith(b"#ROSBAG V"):
        from emvs.io.events.rosbag import RosbagReader

        return RosbagReader(path)
    if head.startswith(_OLD_AEDAT):
        from emvs.io.events.aedat4 import Aedat4Reader

        return Aedat4Reader(path)
    if head.startswith(b"PK\x03\x04"):
        from emvs.io.events.npz import NpzReader

        return NpzReader(path)
    if head.startswith(b"%"):
        from emvs.io.events.raw import RawReader

        return RawReader(path)
    from emvs.io.events.text import TextReader

    return TextReader(path)
