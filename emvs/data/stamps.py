"""Times of images as text: lines `t`, or `t name`, as data sets and other simulators have them."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import NamedTuple

from eventsweep.emvs.data.headers import agreed_unit
from eventsweep.emvs.errors import InputError, quoted, said
from eventsweep.emvs.utils.inputs import TABLE_BYTES, read_text

STAMP_FILES = ("timestamps.txt", "images.txt", "timestamps.csv", "images.csv")
"""Names by which a folder's times are found."""
_PER_US = {"s": Decimal(10) ** 6, "ms": Decimal(1000), "us": Decimal(1), "ns": Decimal("0.001")}
_HEADER_UNIT = re.compile(r"(?:\[|\(|_|,|\s)(s|ms|us|µs|ns)(?=$|[\])\s,_])")
_LARGEST_US = 2**62


class Stamps(NamedTuple):
    """Times, µs; the images' names, as many or none; what the file's numbers count."""

    t_us: tuple[int, ...]
    names: tuple[str, ...]
    unit: str


def text_of(path: Path, needs: str, most_bytes: int = TABLE_BYTES) -> str:
    """A text of a file; what cannot be read says what is needed."""
    try:
        return read_text(path, most_bytes)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file in utf-8"
        raise InputError(f"{path}: cannot be read ({reason}); needs {needs}") from error


def read_stamps(path: Path, unit: str | None = None) -> Stamps:
    """Reads lines `t` or `t name`, parted by blanks or a comma; `#` starts a comment.

    Without a `unit`, s, ms, us or ns, a header has it (`timestamp_ns`, `[us]`), or a decimal point,
    which means seconds; whole numbers alone could be anything.

    Raises:
        InputError: an unreadable file, a line that is neither, some lines with a name and some
            without, or a unit that nothing says.
    """
    rows, header = _rows(text_of(path, "lines `t` or `t name`").splitlines())
    if not rows:
        raise InputError(f"{path}: no times; needs a line `t` or `t name` for each image")
    words = [row[1] for row in rows]
    unit = agreed_unit(str(path), _said(header), unit or "") or _unit(path, words)
    t_us = tuple(_time_us(f"{path}, line {row[0]}", row[1], unit) for row in rows)
    names = tuple(row[2] for row in rows if row[2])
    if len(names) not in (0, len(rows)):
        raise InputError(
            f"{path}: {len(names)} of {len(rows)} lines name an image; needs a name in all lines "
            "or in none"
        )
    return Stamps(t_us, names, unit)


def _rows(lines: list[str]) -> tuple[list[tuple[int, str, str]], str]:
    """Line number, time and name of every row, and what stands in the header and comments."""
    rows: list[tuple[int, str, str]] = []
    header: list[str] = []
    for number, line in enumerate(lines, start=1):
        text, _, comment = line.partition("#")
        stamp, *rest = text.replace(",", " ", 1).split(maxsplit=1) or [""]
        first_word = stamp[:1].isalpha() and not rows and not header
        if first_word:
            header.append(text)
        elif stamp:
            rows.append((number, stamp, rest[0].strip() if rest else ""))
        if comment and not rows:
            header.append(comment)
    return rows, " ".join(header)


def _said(header: str) -> str:
    """The only unit that a header says, or empty."""
    stated: set[str] = {unit.replace("µ", "u") for unit in _HEADER_UNIT.findall(header)}
    return stated.pop() if len(stated) == 1 else ""


def _unit(path: Path, words: list[str]) -> str:
    if any("." in word for word in words):
        return "s"
    raise InputError(
        f"{path}: times such as {quoted(words[-1])} have no unit: set unit to s, ms, us or ns"
    )


def _time_us(where: str, word: str, unit: str) -> int:
    """A time, rounded to the microsecond; exact however large it is."""
    try:
        time_us = Decimal(word) * _PER_US[unit]
        if not abs(time_us) < _LARGEST_US:
            raise InputError(f"{where}: time {quoted(word)} {unit}; needs one below 2^62 µs")
        return round(time_us)
    except (InvalidOperation, ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = quoted(word) if word.isascii() else said(error)
        raise InputError(f"{where}: {reason} is not a time; expected `t` or `t name`") from error
