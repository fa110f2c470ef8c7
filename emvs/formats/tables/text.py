"""Events as text, read and written: `t x y p` in lines, with or without a size line, or CSV.

A time with a decimal point or an exponent is in seconds, a whole number in µs, and a whole file
is one or the other; a CSV header may name the unit instead (`t_s`, `t_ms`, `t_us`, `t_ns`)
and the sensor (`x@1280`, `y@720`, as faery writes it).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats.base import FileWriter
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import STREAM, opened
from eventsweep.emvs.formats.tables.columns import CURE, POLARITIES, TIMES, ColumnMap
from eventsweep.emvs.formats.tables.text_kernels import format_rows, parse_rows
from eventsweep.emvs.utils.release import page

_BLOCK_BYTES = 1 << 22
_HEAD_BYTES = 1 << 16
_POWERS = {"t_s": 6, "t_ms": 3, "t_us": 0, "t_ns": -3}
_NAMES = dict.fromkeys(TIMES, 0) | {"x": 1, "y": 2} | dict.fromkeys(POLARITIES, 3)


@dataclass(frozen=True)
class TextLayout:
    """How lines are read: behind `skip` bytes, with times that count `10**power` µs.

    `order` is what each field is: 0 time, 1 x, 2 y, 3 polarity, -1 anything; `size_px` is width and
    height, where a line says them.
    """

    format: str
    skip: int
    order: tuple[int, ...]
    power: int
    whole_times: bool
    size_px: tuple[int, int] | None = None


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
            self._layout = layout or text_layout(self.path, file.read(_HEAD_BYTES), columns)
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
            fields = " ".join("txyp"[what] if what >= 0 else "..." for what in layout.order)
            times = "a whole number of µs" if layout.whole_times else "seconds"
            times = f"{times}, as the file begins" if layout.power in (0, 6) else "in its unit"
            raise InputError(
                f"{self.path}, line {self.line_at(offset + bad)}: {line!r} is not an event; "
                f"needs `{fields}`, t >= 0 ({times}), whole pixels 0 to 65535, p 0 or 1 or -1: "
                "correct or remove the line"
            )
        return events.slice(0, count)


def text_layout(path: Path, head: bytes, columns: ColumnMap | None = None) -> TextLayout:
    """Recognises the layout from the first bytes of a file, or takes it as stated."""
    if b"\0" in head or not head.isascii():
        raise InputError(
            f"{path}: neither text nor a known binary event format; "
            f"{page('formats', 'event-files')} lists what can be opened"
        )
    lines = head.splitlines(keepends=True)
    skip = 0
    while lines and (lines[0].startswith(b"#") or not lines[0].strip()):
        skip += len(lines.pop(0))
    if not lines:
        raise InputError(
            f"{path}: only blank lines and comments in the first {len(head)} bytes; needs lines "
            "`t x y p`: the file is cut off or empty, download it again"
        )
    words = lines[0].decode("ascii").replace(",", " ").split()
    is_header = bool(words) and words[0].strip("\"'")[:1].isalpha()
    size = None
    if columns is not None and columns.x:
        layout = _stated_layout(path, columns, words, skip + is_header * len(lines[0]), is_header)
    elif is_header:
        layout = _csv_layout(path, words, skip + len(lines[0]), lines[1:])
    else:
        if len(words) == 2 and all(word.isdigit() and len(word) < 6 for word in words):
            size = (int(words[0]), int(words[1]))
            skip += len(lines.pop(0))
        seconds = _has_points(lines, 0)
        name = "esim-text" if size else "text"
        layout = TextLayout(name, skip, (0, 1, 2, 3), 6 if seconds else 0, not seconds, size)
    if columns is None:
        return layout
    return replace(layout, power=_POWERS[f"t_{columns.time_unit}"], whole_times=False)


def _stated_layout(
    path: Path, columns: ColumnMap, words: list[str], skip: int, is_header: bool
) -> TextLayout:
    """The fields that are stated, by their names in the header or by their numbers."""
    names = [word.strip("\"'") for word in words] if is_header else []
    order = [-1] * len(words)
    for what, address in enumerate((columns.t, columns.x, columns.y, columns.p)):
        place = names.index(address) if address in names else -1
        if place < 0 and address.isdecimal() and int(address) < len(words):
            place = int(address)
        if place < 0 or order[place] >= 0:
            there = quoted(*names) or f"0 to {len(words) - 1}"
            raise InputError(f"{path}: no separate column {quoted(address)}; choose from {there}")
        order[place] = what
    return TextLayout("csv", skip, tuple(order), 0, False)


def _csv_layout(path: Path, words: list[str], skip: int, body: list[bytes]) -> TextLayout:
    parts = [word.strip("\"'").lower().partition("@") for word in words]
    names = [name for name, _, _ in parts]
    sizes = {name: int(size) for name, _, size in parts if size.isdecimal() and len(size) < 6}
    order = tuple(_NAMES.get(name, -1) for name in names)
    if sorted(what for what in order if what >= 0) != [0, 1, 2, 3]:
        raise InputError(
            f"{path}, byte 0: columns {quoted(*names)}; needs x, y, p (or polarity) and one of "
            f"t, {', '.join(_POWERS)}: rename them in the header, or {CURE}"
        )
    place = order.index(0)
    seconds = names[place] == "t_s" or (names[place] not in _POWERS and _has_points(body, place))
    power = 6 if seconds else _POWERS.get(names[place], 0)
    whole = names[place] not in _POWERS and not seconds
    size = (sizes["x"], sizes["y"]) if {"x", "y"} <= set(sizes) else None
    return TextLayout("csv", skip, order, power, whole, size)


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
