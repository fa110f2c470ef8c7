"""The table of formats: what each one is, holds and loses. Imports no format's own module."""

from __future__ import annotations

from dataclasses import dataclass

from emvs.io.events.contract import ANY_PX, ANY_US, DOUBLE_US, MANY, Limits

_SPAN_US = 1 << 36
_PER_MS = "an index entry per millisecond"
_EVT = "11-bit pixels; longer times would be mostly counter words"
_COLUMNS = "64-bit columns"


@dataclass(frozen=True, slots=True)
class Format:
    """A format.

    Attributes:
        name: as `write_events` takes it.
        what: in a few words.
        suffix: customary end of the file's name.
        writes: whether it can be written here; all can be read.
        limits: what it can hold.
        polarity: how it codes brighter and darker.
    """

    name: str
    what: str
    suffix: str
    writes: bool
    limits: Limits
    polarity: str


def _evt(unit: str, max_us: int) -> Limits:
    return Limits(2047, 2047, max_us, unit, False, 1, _EVT)


_ALL = (
    Format("evt2", "Prophesee RAW, EVT 2.0", ".raw", True, _evt("µs mod 2^34", 1 << 48), "1/0"),
    Format("evt21", "Prophesee RAW, EVT 2.1", ".raw", False, _evt("µs mod 2^34", ANY_US), "1/0"),
    Format("evt3", "Prophesee RAW, EVT 3.0", ".raw", True, _evt("µs mod 2^24", 1 << 40), "1/0"),
    Format(
        "dat",
        "Prophesee DAT",
        ".dat",
        False,
        Limits(16383, 16383, ANY_US, "µs mod 2^32", True, 1, "14-bit pixels"),
        "1/0",
    ),
    Format(
        "prophesee-hdf5",
        "Prophesee HDF5 (`CD/events`, ECF)",
        ".hdf5",
        False,
        Limits(ANY_PX, ANY_PX, ANY_US, "µs", True, 1, _COLUMNS),
        "1/0",
    ),
    Format(
        "dsec",
        "HDF5 as DSEC lays it out, and our own",
        ".h5",
        True,
        Limits(ANY_PX, ANY_PX, ANY_US, "µs from `t_offset`", False, 1, _PER_MS, _SPAN_US),
        "1/0",
    ),
    Format(
        "tumvie",
        "HDF5 as TUM-VIE lays it out",
        ".h5",
        True,
        Limits(ANY_PX, ANY_PX, _SPAN_US, "µs", False, 1, f"{_PER_MS} from 0"),
        "1/0",
    ),
    Format(
        "mvsec",
        "HDF5 as MVSEC lays it out",
        ".hdf5",
        True,
        Limits(ANY_PX, ANY_PX, DOUBLE_US, "s, double", True, 2, "seconds in a double"),
        "1/-1",
    ),
    Format(
        "aedat4",
        "iniVation AEDAT 4.0",
        ".aedat4",
        True,
        Limits(32767, 32767, ANY_US, "µs", False, 64, "signed 16-bit pixels"),
        "1/0",
    ),
    Format(
        "rosbag1",
        "ROS1 bag, dvs_msgs (reads prophesee_event_msgs, too)",
        ".bag",
        True,
        Limits(ANY_PX, ANY_PX, (1 << 32) * 10**6 - 1, "s + ns", True, MANY, "32-bit seconds"),
        "1/0",
    ),
    Format(
        "rosbag2",
        "ROS2 bag, dvs_msgs or prophesee_event_msgs",
        "",
        False,
        Limits(ANY_PX, ANY_PX, (1 << 32) * 10**6 - 1, "s + ns", True, MANY, "32-bit seconds"),
        "1/0",
    ),
    Format(
        "text",
        "lines `t x y p`",
        ".txt",
        True,
        Limits(ANY_PX, ANY_PX, ANY_US // 10, "s, six decimals", True, 1, "18 digits"),
        "1/0",
    ),
    Format(
        "esim-text",
        "a line `width height`, then lines `t x y p`",
        ".txt",
        True,
        Limits(ANY_PX, ANY_PX, ANY_US // 10, "s, six decimals", True, 1, "18 digits"),
        "1/0",
    ),
    Format(
        "csv",
        "columns named in a header",
        ".csv",
        True,
        Limits(ANY_PX, ANY_PX, ANY_US // 10, "µs", True, 1, "18 digits"),
        "1/0",
    ),
    Format(
        "npz",
        "NumPy archive of columns",
        ".npz",
        True,
        Limits(ANY_PX, ANY_PX, ANY_US, "µs", True, 1, _COLUMNS),
        "1/0",
    ),
)

FORMATS = {entry.name: entry for entry in _ALL}
"""Every format by name."""
