"""Prophesee RAW (EVT2, EVT2.1, EVT3) and DAT files, read block by block; RAW is written, too.

A block is a place in the file and what the decoder knew there. The words carry time modulo 2^34 µs
(EVT2), 2^24 µs (EVT3) or 2^32 µs (DAT); the decoder counts the loops.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats import prophesee_kernels
from eventsweep.emvs.formats.base import FileWriter
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee_kernels import (
    LOOPS,
    UNTIMED,
    State,
    encode_evt2,
    encode_evt3,
    encoder_state,
    initial_state,
)
from eventsweep.emvs.utils.inputs import check_file

_BLOCK_BYTES = 1 << 20
_ROOM = 1 << 19
STREAM = "events"
_MOST_BYTES = 1 << 16
_CODINGS: dict[str, tuple[str, np.dtype[Any], Callable[..., int], int]] = {
    "evt2": ("2.0", np.dtype("<u4"), encode_evt2, 34),
    "evt3": ("3.0", np.dtype("<u2"), encode_evt3, 24),
}


class _Coding(NamedTuple):
    """How the words of a format are read."""

    name: str
    word: np.dtype[Any]
    decode: Callable[..., tuple[int, int, bool]]


CODINGS = {
    "EVT2": _Coding("evt2", np.dtype("<u4"), prophesee_kernels.decode_evt2),
    "EVT21": _Coding("evt21", np.dtype("<u8"), prophesee_kernels.decode_evt21),
    "EVT3": _Coding("evt3", np.dtype("<u2"), prophesee_kernels.decode_evt3),
    "DAT": _Coding("dat", np.dtype("<u8"), prophesee_kernels.decode_dat),
}


class RawReader(BlockReader):
    """A RAW or DAT file: one stream, `events`.

    Attributes:
        untimed: events in front of the file's first time word, seen so far. They have no time and
            are left out, as the maker's own tools do.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(Path(path), (STREAM,))
        with opened(self.path) as file:
            header = read_raw_header(self.path, file)
            self._coding, self._start = _coding(self.path, header, file)
        self.format = self._coding.name
        self.width_px, self.height_px = header.width_px, header.height_px
        self.untimed = 0
        excess = (self.path.stat().st_size - self._start) % self._coding.word.itemsize
        if excess:
            raise InputError(
                f"{self.path}, byte {self.path.stat().st_size - excess}: cut off in the middle "
                f"of an event word; download it again, or remove the last {excess} bytes"
            )

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Decodes the file from front to back."""
        state = initial_state()
        with opened(self.path) as file:
            offset = file.seek(self._start)
            while data := file.read(_BLOCK_BYTES):
                words = np.frombuffer(data, self._coding.word)
                while len(words):
                    before = state.copy()
                    used, events = self._decode(words, state, offset)
                    size = used * self._coding.word.itemsize
                    yield (offset, size, before), events
                    words, offset = words[used:], offset + size
        self.untimed = int(state[UNTIMED])

    def load(self, _stream: str, place: Any) -> Events:
        """Decodes one block."""
        offset, size, state = place
        with opened(self.path) as file:
            file.seek(offset)
            words = np.frombuffer(file.read(size), self._coding.word)
        return self._decode(words, state.copy(), offset)[1]

    def _decode(self, words: NDArray[Any], state: State, offset: int) -> tuple[int, Events]:
        size = self._coding.word.itemsize
        return decode_words(
            self._coding, words, state, lambda k: f"{self.path}, byte {offset + k * size}"
        )


def decode_words(
    coding: _Coding, words: NDArray[Any], state: State, where: Callable[[int], str]
) -> tuple[int, Events]:
    """Decodes words until they end or a block is full.

    Args:
        coding: an entry of `CODINGS`.
        words: (N,) what comes next in the stream.
        state: what the decoder knows of the stream so far; updated.
        where: file and place of a word by its number, for the error's sake.

    Returns:
        How many words were used, and their events.
    """
    room = min(_ROOM, prophesee_kernels.MOST_PER_WORD * len(words))
    events = Events.room(room)
    used, count, unknown = coding.decode(words, state, events.columns)
    if unknown:
        raise InputError(
            f"{where(used)}: {int(words[used]):#x} is not a word of {coding.name.upper()}; the "
            "file is damaged or in another format, download it again"
        )
    return used, events.slice(0, count)


def opened(path: Path) -> BinaryIO:
    """Opens a file for reading."""
    try:
        check_file(path)
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _coding(path: Path, header: RawHeader, file: BinaryIO) -> tuple[_Coding, int]:
    """The coding, and where the words begin."""
    if header.kind in CODINGS:
        return CODINGS[header.kind], header.data_offset
    if header.kind:
        known = ", ".join(kind for kind in CODINGS if kind != "DAT")
        raise InputError(
            f"{path}: encoded as {quoted(header.kind)}; supported: {known}; convert it first"
        )
    kind, size = (*file.read(2), 0, 0)[:2]
    if kind not in (0x00, 0x0C) or size != 8:
        raise InputError(
            f"{path}, byte {header.data_offset}: events of type {kind:#x} and {size} bytes after a "
            "header without `% format`; needs change detection events (0x0 or 0xc, 8 bytes)"
        )
    return CODINGS["DAT"], header.data_offset + 2


_SENSORS = {
    **dict.fromkeys(("gen3", "gen31"), (640, 480)),
    **dict.fromkeys(("gen41", "gen42", "imx636"), (1280, 720)),
    "genx320": (320, 320),
}


class RawHeader(NamedTuple):
    """What the lines say: coding (empty: none), sensor size, and where the events begin, bytes."""

    kind: str
    width_px: int | None
    height_px: int | None
    data_offset: int


def read_raw_header(path: Path, file: BinaryIO) -> RawHeader:
    """Reads the lines and leaves the file where the events begin."""
    fields: dict[str, str] = {}
    while file.peek(1)[:1] == b"%":  # type: ignore[attr-defined]
        line = file.readline(_MOST_BYTES)
        if file.tell() > _MOST_BYTES or not line.endswith(b"\n"):
            raise InputError(
                f"{path}, byte {file.tell()}: the header does not end; needs lines `% ...` and "
                "`% end`: the file is damaged"
            )
        key, _, value = line[1:].decode("latin-1").strip().partition(" ")
        if key == "end":
            break
        fields[key.lower()] = value.strip()
    if not fields:
        raise InputError(f"{path}, byte 0: no header; needs lines `% ...` before the events")
    kind, *options = fields.get("format", "").split(";")
    named = dict(option.partition("=")[::2] for option in options)
    if "legacy" in (named.get("endianness"), fields.get("endianness")):
        raise InputError(f"{path}: words in legacy order; convert it with Prophesee's tools first")
    if not kind and "evt" in fields:
        kind = "EVT" + fields["evt"].removesuffix(".0").replace(".", "")
    width_px, height_px = _size(path, fields, named)
    return RawHeader(kind.upper().replace(".", ""), width_px, height_px, file.tell())


def _size(
    path: Path, fields: dict[str, str], named: dict[str, str]
) -> tuple[int, int] | tuple[None, None]:
    width, height = (named.get(name) or fields.get(name) for name in ("width", "height"))
    if geometry := re.fullmatch(r"(\d+)x(\d+)", fields.get("geometry", "")):
        width, height = geometry.groups()
    if width is None or height is None:
        sensor = re.sub(r"[^a-z0-9]", "", fields.get("sensor_name", fields.get("generation", "")))
        return _SENSORS.get(sensor, (None, None))
    if not all(re.fullmatch(r"[1-9]\d{0,4}", word) for word in (width, height)):
        raise InputError(
            f"{path}: sensor size {quoted(width)} x {quoted(height)}; needs whole pixels > 0"
        )
    return int(width), int(height)


class RawWriter(FileWriter):
    """Appends sorted events to a RAW file."""

    packet = 1 << 19

    def __init__(self, path: Path, kind: str, width_px: int, height_px: int) -> None:
        version, self._word, self._encode, self._loop_bits = _CODINGS[kind]
        self._state = encoder_state()
        super().__init__(path)
        lines = [
            f"evt {version}",
            f"format {kind.upper()};height={height_px};width={width_px}",
            f"geometry {width_px}x{height_px}",
            "integrator_name eventsweep",
            "end",
        ]
        self._file.write("".join(f"% {line}\n" for line in lines).encode("ascii"))

    def _put(self, _stream: str, events: Events) -> None:
        loops = (int(events.t_us[-1]) >> self._loop_bits) - int(self._state[LOOPS])
        words = np.empty(8 * len(events) + 3 * loops + 8, self._word)
        count = self._encode(events.columns, self._state, words)
        self._file.write(words[:count].data)
