"""Events as text, read and written: `t x y p` in lines, with or without a size line, or CSV.

A time with a decimal point or an exponent is in seconds, a whole number in µs, and a whole file
is one or the other; a header, of names or in a comment, may name order and unit instead (`t_s`,
`t_ms`, `t_us`, `t_ns`) and the sensor (`x@1280`, `y@720`, as faery writes it). Prophesee's CSV says
`%geometry:1280,720` and has x, y, p, t in µs.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.headers import (
    Column,
    agreed_unit,
    check_whole_us,
    checked_columns,
    columns_of,
    fields_of,
    header_of,
    is_names,
    unit_of,
)
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats.base import FileWriter
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import STREAM, opened
from eventsweep.emvs.formats.tables.columns import CURE, ColumnMap
from eventsweep.emvs.formats.tables.text_kernels import format_rows, parse_rows
from eventsweep.emvs.utils.inputs import mark_bytes
from eventsweep.emvs.utils.release import page

_BLOCK_BYTES = 1 << 22
_HEAD_BYTES = 1 << 16
_POWERS = {"s": 6, "ms": 3, "us": 0, "ns": -3}
_CODES = {"t": 0, "secs": 0, "x": 1, "y": 2, "p": 3, "nsecs": 4}
_ROLES = ("t", "x", "y", "p")
_LINE = columns_of("t x y p")
_SIZE = re.compile(r"%\s*geometry\s*[:= ]\s*(\d{1,5})\s*[,x]\s*(\d{1,5})\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class TextLayout:
    """How lines are read: behind `skip` bytes, with times that count `10**power` µs.

    `order` is what each field is: 0 time, 1 x, 2 y, 3 polarity, 4 ns beside the time, -1 anything;
    `size_px` is width and height, where a line says them; `is_stated` whether the unit is.
    """

    format: str
    skip: int
    order: tuple[int, ...]
    power: int
    whole_times: bool
    size_px: tuple[int, int] | None = None
    is_stated: bool = False


class TextReader(BlockReader):
    """A text of events: one stream, `events`.

    Which field of a line is what is stated, or a header says, or it is `t x y p`; its `layout` is
    found from its first lines where not given.
    """

    def __init__(
        self, path: Path, columns: ColumnMap | None = None, layout: TextLayout | None = None
    ) -> None:
        super().__init__(Path(path), (STREAM,))
        with opened(self.path) as file:
            head = file.read(_HEAD_BYTES)
            self._layout = (
                replace(layout, skip=mark_bytes(self.path, head))
                if layout
                else text_layout(self.path, head, columns)
            )
        self.format = self._layout.format
        self.width_px, self.height_px = self._layout.size_px or (None, None)

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Parses the file from front to back."""
        with opened(self.path) as file:
            offset = file.seek(self._layout.skip)
            while text := file.read(_BLOCK_BYTES):
                text += file.readline(_HEAD_BYTES)
                yield (offset, len(text)), self._parse(text, offset)
                offset += len(text)

    def load(self, _stream: str, place: Any) -> Events:
        """Parses one block."""
        with opened(self.path) as file:
            file.seek(place[0])
            return self._parse(file.read(place[1]), place[0])

    def line_at(self, offset: int) -> int:
        """Which line, counted from 1, a byte of the file belongs to: slow, for errors."""
        line = 1
        with opened(self.path) as file:
            while offset > 0 and (text := file.read(min(offset, _BLOCK_BYTES))):
                line, offset = line + text.count(b"\n"), offset - len(text)
        return line

    def _parse(self, text: bytes, offset: int) -> Events:
        layout, events = self._layout, Events.room(text.count(b"\n") + 1)
        order: NDArray[np.int64] = np.array(layout.order, np.int64)
        data = np.frombuffer(text, np.uint8)
        count, bad = parse_rows(data, order, layout.power, layout.whole_times, events.columns)
        if bad >= 0:
            line = text[bad : bad + 60].split(b"\n")[0].decode("ascii", "replace")
            names = {0: "t", 1: "x", 2: "y", 3: "p", 4: "ns"}
            fields = " ".join(names.get(what, "...") for what in layout.order)
            times = {6: "seconds", 3: "ms", 0: "µs", -3: "ns"}[layout.power]
            times = f"a whole number of {times}" if layout.whole_times else times
            times += ", as stated" if layout.is_stated else ", as the file begins"
            raise InputError(
                f"{self.path}, line {self.line_at(offset + bad)}: {line!r} is not an event; "
                f"needs `{fields}`, t >= 0 ({times}), whole pixels 0 to 65535, p 0 or 1 or -1 or "
                "True or False: correct or remove the line"
            )
        return events.slice(0, count)


def text_layout(path: Path, head: bytes, columns: ColumnMap | None = None) -> TextLayout:
    """Recognises the layout from the first bytes of a file, or takes it as stated."""
    skip, comments, lines = _begin(path, head)
    first, size = lines[0].decode("utf-8", "replace"), _size_px(comments)
    found = columns_of(first) if is_names(first) else None
    if found is not None:
        skip, size = skip + len(lines.pop(0)), _size_px([first]) or size
    elif re.fullmatch(r"\d{1,5}\s+\d{1,5}\s*", first):
        skip, size = skip + len(lines.pop(0)), (int(first.split()[0]), int(first.split()[1]))
        return _layout(path, "esim-text", _LINE, skip, lines, size, columns)
    if columns is not None and columns.x:
        count = len(fields_of(first)) if found is None else len(found)
        if found is None:
            with suppress(InputError):  # what is stated is the cure
                found = header_of(str(path), comments, first, _ROLES)
        chosen = _stated(path, columns, found, count)
        return _layout(path, "csv", chosen, skip, lines, size, columns)
    try:
        if found is not None:
            found = checked_columns(f"{path}, byte 0", found, _ROLES)
        else:
            found = header_of(str(path), comments, first, _ROLES)
    except InputError as error:
        raise InputError(f"{error}; or {CURE}") from error
    if found is None and size is not None:  # Prophesee's, whose only words are its size
        return _layout(path, "csv", columns_of("x y p t_us"), skip, lines, size, columns)
    kind = "csv" if is_names(first) or (found and found != _LINE) else "text"
    return _layout(path, kind, found or _LINE, skip, lines, size, columns)


def _begin(path: Path, head: bytes) -> tuple[int, list[str], list[bytes]]:
    """Bytes before the first line that is no comment, the comments, and the lines from there."""
    skip = mark_bytes(path, head)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        skip = -1
    if skip < 0 or b"\0" in head:
        raise InputError(
            f"{path}: neither text nor a known binary event format; "
            f"{page('formats', 'event-files')} lists what can be opened"
        )
    lines, comments = head[skip:].splitlines(keepends=True), []
    while lines and (lines[0].startswith((b"#", b"%")) or not lines[0].strip()):
        skip += len(lines[0])
        comments.append(lines.pop(0).decode("utf-8", "replace"))
    if not lines:
        raise InputError(
            f"{path}: only blank lines and comments in the first {len(head)} bytes; needs lines "
            "`t x y p`: the file is cut off or empty, download it again"
        )
    return skip, comments, lines


def _stated(path: Path, columns: ColumnMap, named: list[Column] | None, count: int) -> list[Column]:
    """The fields that are stated, by their names in the header or by their numbers."""
    named = named or [Column("", "", "")] * count
    names = [column.name.strip("\"' ") for column in named]
    found = [Column(name, "", "") for name in names]
    for role, address in columns.addresses.items():
        place = names.index(address) if address in names else -1
        if place < 0 and address.isdecimal() and int(address) < count:
            place = int(address)
        if place < 0 or found[place].role:
            there = quoted(*filter(None, names)) or f"0 to {count - 1}"
            raise InputError(f"{path}: no separate column {quoted(address)}; choose from {there}")
        if named[place].role in set(_ROLES) - {role}:
            raise InputError(
                f"{path}: column {quoted(names[place])} is stated as {role}, but its name says "
                f"{named[place].role}: correct `columns`, or the header"
            )
        found[place] = Column(names[place], role, named[place].unit)
    return found


def _layout(
    path: Path, kind: str, found: Sequence[Column], skip: int, lines: list[bytes],
    size_px: tuple[int, int] | None, columns: ColumnMap | None,
) -> TextLayout:  # fmt: skip
    """How the lines are read whose columns were found; of times that nothing states, the first."""
    roles = [column.role for column in found]
    order = tuple(_CODES.get(role, -1) for role in roles)
    place = order.index(0)
    word = _first_word(lines, place)
    said = agreed_unit(str(path), unit_of(found, word), columns.time_unit if columns else "")
    if said:
        return TextLayout(kind, skip, order, _POWERS[said], False, size_px, True)
    seconds = _has_points(lines, place)
    if not seconds and word.isdecimal():
        check_whole_us(str(path), int(word))
    return TextLayout(kind, skip, order, 6 if seconds else 0, not seconds, size_px)


def _size_px(lines: Iterable[str]) -> tuple[int, int] | None:
    """Width and height as `%geometry:1280,720` or `x@1280,y@720` say them."""
    for line in lines:
        if match := _SIZE.match(line):
            return int(match[1]), int(match[2])
        sizes = dict(re.findall(r"\b([xy])@(\d{1,5})\b", line))
        if len(sizes) == 2:
            return int(sizes["x"]), int(sizes["y"])
    return None


def _first_word(lines: list[bytes], place: int) -> str:
    """The first row's field at a place; empty without one."""
    for line in lines:
        if line.strip() and not line.startswith(b"#"):
            words = fields_of(line.decode("utf-8", "replace"))
            return words[place] if place < len(words) else ""
    return ""


def _has_points(lines: list[bytes], place: int) -> bool:
    """Whether times in these lines have a decimal point or an exponent."""
    for line in lines:
        words = line.replace(b",", b" ").replace(b";", b" ").split()
        if len(words) > place and not words[0].startswith(b"#") and set(words[place]) & set(b".eE"):
            return True
    return False


class TextWriter(FileWriter):
    """Appends lines."""

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        super().__init__(path)
        self._seconds = kind != "csv"
        self._gap = ord("," if kind == "csv" else " ")
        head = {"csv": "t_us,x,y,p\n", "esim-text": f"{width_px} {height_px}\n"}.get(kind, "")
        self._file.write(head.encode("ascii"))

    def _put(self, _stream: str, events: Events) -> None:
        text = np.empty(48 * len(events), np.uint8)
        size = format_rows(events.columns, self._seconds, self._gap, text)
        self._file.write(text[:size].data)
