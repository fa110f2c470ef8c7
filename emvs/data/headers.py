"""What a table says of itself: its columns by the names in a header, and what its times count.

Trajectories, events and images share one vocabulary, that of TUM, EuRoC (`p_RS_R_x [m]`, `q_RS_w
[]`), ROS (`%time,field.header.stamp,field.pose.position.x`, `secs nsecs`) and of programs that
write columns by name. A file that names nothing is read as its format says, unless its times would
then be impossible.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from eventsweep.emvs.errors import InputError, quoted

PER_UNIT_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
POLARITIES = ("p", "pol", "polarity", "on")
_UNITS = {
    word: unit
    for unit, words in {
        "s": "s sec secs second seconds", "ms": "ms msec msecs millisecond milliseconds",
        "us": "us µs μs usec usecs microsecond microseconds",
        "ns": "ns nsec nsecs nanosec nanosecs nanosecond nanoseconds",
    }.items()
    for word in words.split()
}  # fmt: skip
_FIELD = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?|[\[(]\S*")
_BRACKET = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]?$")
_LABEL = re.compile(r"^\s*(?:columns?|fields?|format|header)\s*[:=]\s*", re.IGNORECASE)
_PATH = r"(?:\w+[./])*(?:header_)?"
_TIME = re.compile(
    rf"{_PATH}(?:t|ts|time|times|timestamp|timestamps|time[ _]stamp|stamp|rosbagtimestamp)"
)
_SECONDS = re.compile(rf"(?:{_PATH}|stamp_|timestamp_)(secs?|seconds)")
_REST_NS = re.compile(rf"(?:{_PATH}|stamp_|timestamp_)(?:n|nano)(?:secs?|seconds)")
_PLACE = re.compile(r"(?:p(?:_[a-z]+)*_|p|t_?|(?:pos|position|trans|translation)_?)?([xyz])")
_TURN = re.compile(r"(?:q(?:_[a-z]+)*_|q|(?:quat|quaternion|orientation|rotation|rot)_)([wxyz])")
_COUNTS_NS = re.compile(r"[pq]_rs_.*|field\..*|.*header[./_]stamp|rosbagtimestamp")
_NUMBER = re.compile(r"[-+]?(?:[.\d].*|nan|inf(?:inity)?)", re.IGNORECASE)
_OTHER_UNITS = ("mm", "cm", "km", "min", "h", "hours", "days", "ps", "ticks", "frame", "frames")


class Column(NamedTuple):
    """A column as a header names it.

    `role` is `t`, `secs` and `nsecs` (a time in two columns), `x`, `y`, `z`, `qx`, `qy`, `qz`,
    `qw`, `p` (polarity), or empty; `unit` is in lower case, empty where the name says none.
    """

    name: str
    role: str
    unit: str


def fields_of(line: str) -> list[str]:
    """The fields of a line, parted by commas or semicolons, or else by blanks."""
    parts = [part.strip() for part in re.split("[,;]", line)]
    if len(parts) == 1 or any(len(part.split()) > 1 for part in parts):
        return re.sub("[,;]", " ", line).split()
    while parts and not parts[-1]:
        parts.pop()
    return parts


def columns_of(line: str) -> list[Column]:
    """The columns that a line of names states; `#` or `%` may stand before it."""
    text = _LABEL.sub("", line.strip(" \r\n").lstrip("#%").strip(" "))
    parts = re.split("[,;\t]", text)
    while parts and not parts[-1].strip():
        parts.pop()
    names = [part.strip() for part in parts] if len(parts) > 1 else _FIELD.findall(text)
    return [column_of(name) for name in names]


def column_of(name: str) -> Column:
    """What one name says."""
    plain = name.strip().strip("\"'").partition("@")[0].strip().lower().lstrip("%")
    match = _BRACKET.fullmatch(plain)
    plain, unit = match.groups() if match else (plain, "")
    for pattern, role in ((_SECONDS, "secs"), (_REST_NS, "nsecs")):
        if pattern.fullmatch(plain):
            return Column(name, role, unit)
    head, _, tail = plain.rpartition("_")
    if not unit and head and (tail in _UNITS or tail in ("m", "mm", "cm", "px")):
        plain, unit = head, tail
    return Column(name, _role(plain), _UNITS.get(unit, unit))


def _role(plain: str) -> str:
    if _TIME.fullmatch(plain):
        return "t"
    if plain in POLARITIES:
        return "p"
    *_, parent, leaf = ["", *re.split("[./]", plain)]
    short = f"{parent}_{leaf}" if len(leaf) == 1 and parent else leaf
    if match := _TURN.fullmatch(short):
        return f"q{match[1]}"
    match = _PLACE.fullmatch(short)
    return match[1] if match else ""


def is_names(line: str) -> bool:
    """Whether a line that is no comment has names, not numbers."""
    words = [word.strip("\"'") for word in re.split(r"[\s,;]+", line) if word.strip("\"'")]
    return bool(words) and not _NUMBER.fullmatch(words[0])


def header_of(
    where: str, lines: Sequence[str], row: str, needed: Sequence[str]
) -> list[Column] | None:
    """The columns that the lines before the first row name; None where none of them does.

    A line of names has as many as the row has fields; a comment may have more words around them.

    Args:
        where: file, for the errors' sake.
        lines: comments, and lines of names.
        row: the first row.
        needed: roles that a header of this table has, `t` among them.

    Raises:
        InputError: names of which some that are needed are not understood, or too many or few.
    """
    count, enough = len(fields_of(row)), min(len(needed) - 1, 4)
    for line in reversed(lines):
        columns = columns_of(line)
        is_comment = line.lstrip().startswith(("#", "%"))
        starts = range(max(1, len(columns) - count + 1) if is_comment else 1)
        parts = [columns[k : k + count] if is_comment else columns for k in starts]
        best = max(parts, key=lambda part: _known(part, needed))
        if _known(best, needed) >= enough or (len(best) == count and not is_comment):
            if len(best) == count:
                return checked_columns(where, best, needed)
            if not is_comment:
                raise InputError(
                    f"{where}: its header names {len(best)} columns, its first row has {count}; "
                    "needs as many names as columns: correct the header"
                )
    return None


def _known(columns: Sequence[Column], needed: Sequence[str]) -> int:
    return len({"t" if c.role == "secs" else c.role for c in columns} & set(needed))


def checked_columns(where: str, columns: list[Column], needed: Sequence[str]) -> list[Column]:
    """The columns, of which just one has each role that is needed.

    Raises:
        InputError: none or two of a role, or a unit that is not read.
    """
    columns = _one_time(columns)
    roles = ["t" if column.role == "secs" else column.role for column in columns]
    missing = [role for role in needed if role not in roles]
    twice = [role for role in needed if roles.count(role) > 1]
    odd = [c.name for c in columns if c.role in needed and c.unit in _OTHER_UNITS]
    faults = [f"lacks {', '.join(missing)}"] if missing else []
    faults += [f"{role} twice" for role in twice]
    faults += [f"{name} is in a unit not read here" for name in odd]
    if faults:
        raise InputError(
            f"{where}: a header of {quoted(*(c.name for c in columns))}: {faults[0]}; needs one "
            f"each of {' '.join(needed)}, in m or px, and s, ms, us or ns: rename or convert them"
        )
    return columns


def _one_time(columns: list[Column]) -> list[Column]:
    """The same with one time: seconds and their rest, or the message's own stamp."""
    roles = {c.role for c in columns}
    if {"secs", "nsecs"} <= roles:
        return [c._replace(role="") if c.role == "t" else c for c in columns]
    lone = {"secs": "s", "nsecs": "ns"}
    columns = [
        c._replace(role="t", unit=lone[c.role]) if c.role in lone and "t" not in roles else c
        for c in columns
    ]
    stamps = [c for c in columns if c.role == "t"]
    own = [c for c in stamps if "header" in c.name.lower()]
    if len(stamps) > 1 and len(own) == 1:
        return [c._replace(role="") if c.role == "t" and c != own[0] else c for c in columns]
    return columns


def unit_of(columns: Sequence[Column], word: str) -> str:
    """What times count by their column's name, or empty where that is silent.

    EuRoC's and ROS's whole numbers are ns without a word.

    Args:
        columns: of the header.
        word: the first time.
    """
    (time,) = [column for column in columns if column.role in ("t", "secs")]
    if time.role == "secs" or time.unit in PER_UNIT_US:
        return time.unit or "s"
    implied = any(_COUNTS_NS.fullmatch(column.name.lower()) for column in columns)
    return "ns" if implied and word.strip("+-").isdecimal() else ""


def agreed_unit(where: str, said: str, stated: str) -> str:
    """The unit that a header says or a setting states; both only where they agree."""
    if said and stated and said != stated:
        raise InputError(
            f"{where}: its header counts time in {said}, the setting in {stated}: leave the "
            "setting out, or correct the header"
        )
    return said or stated


_BOOT_US, _SINCE_US, _UNTIL_US = (int(1e6 * s) for s in (315_576_000, 946_684_800, 4_102_444_800))
"""Ten years, and the years 2000 and 2100 from 1970, µs."""
_YEAR_US = 31_556_952_000_000
_STEP_US = 1e4  # of most trackers


def impossible(t_us: int) -> str:
    """Why a time can be no recording's, in a few words; empty where it can.

    A clock counts from when it was switched on, at most ten years ago, or from 1970 to a time
    between 2000 and 2100.
    """
    if -_BOOT_US < t_us < _BOOT_US or _SINCE_US <= t_us < _UNTIL_US:
        return ""
    return f"the year {1970 + t_us // _YEAR_US}"


def check_whole_us(where: str, time: int) -> None:
    """Refuses a whole time that would be µs, for want of a word, where it cannot be."""
    if year := impossible(time):
        fits = finer_unit(time, "us") or "what they count"
        raise InputError(
            f"{where}: times such as {time}, as µs, reach {year}: set `time_unit` to {fits}"
        )


def finer_unit(time: float, unit: str, step: float = 0.0) -> str:
    """The unit finer than one in which a time is possible; empty where none is.

    Of several, the one in which rows follow each other most nearly every 10 ms, or the coarsest.

    Args:
        time: as the table has it.
        unit: in which it is not possible.
        step: from row to row, as the table has it.
    """
    finer = list(PER_UNIT_US)[list(PER_UNIT_US).index(unit) + 1 :] if abs(time) < 1e300 else []
    fits = [name for name in finer if not impossible(int(time * PER_UNIT_US[name]))]
    apart = {
        name: abs(math.log10(max(step, 1e-300) * PER_UNIT_US[name] / _STEP_US)) for name in fits
    }
    return min(fits, key=lambda name: apart[name] if step else 0.0, default="")
