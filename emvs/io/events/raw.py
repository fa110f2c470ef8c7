"""Reads Prophesee RAW (EVT2, EVT2.1, EVT3) and DAT files, block by block.

A block is a place in the file and what the decoder knew there. The words carry time modulo 2^34 µs
(EVT2), 2^24 µs (EVT3) or 2^32 µs (DAT); the decoder counts the loops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events import evt_decode
from emvs.io.events.evt_state import UNTIMED, State, initial_state
from emvs.io.events.indexed import BlockReader
from emvs.io.events.raw_header import RawHeader, read_raw_header
from emvs.io.events.wording import quoted

_BLOCK_BYTES = 1 << 20
_ROOM = 1 << 19
STREAM = "events"


@dataclass(frozen=True, slots=True)
class _Coding:
    """How the words of a format are read."""

    name: str
    word: np.dtype[Any]
    decode: Callable[..., tuple[int, int, bool]]


CODINGS = {
    "EVT2": _Coding("evt2", np.dtype("<u4"), evt_decode.decode_evt2),
    "EVT21": _Coding("evt21", np.dtype("<u8"), evt_decode.decode_evt21),
    "EVT3": _Coding("evt3", np.dtype("<u2"), evt_decode.decode_evt3),
    "DAT": _Coding("dat", np.dtype("<u8"), evt_decode.decode_dat),
}


class RawReader(BlockReader):
    """A RAW or DAT file: one stream, `events`.

    Attributes:
        untimed: events in front of the file's first time word, seen so far. They have no time and
            are left out, as the maker's own tools do.

    Raises:
        InputError: a missing or cut-off file, an unknown coding, or a word of no known kind.
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
                f"{self.path}, byte {self.path.stat().st_size - excess}: cut off in the middle of "
                f"an event word; fetch it again, or remove the last {excess} bytes"
            )

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Decodes the file from front to back."""
        del stream
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

    def load(self, stream: str, place: Any) -> Events:
        """Decodes one block."""
        del stream
        offset, size, state = place
        with opened(self.path) as file:
            file.seek(offset)
            words = np.frombuffer(file.read(size), self._coding.word)
        return self._decode(words, state.copy(), offset)[1]

    def _decode(self, words: NDArray[Any], state: State, offset: int) -> tuple[int, Events]:
        room = min(_ROOM, evt_decode.MOST_PER_WORD * len(words))
        x, y = np.empty(room, np.uint16), np.empty(room, np.uint16)
        t_us, p = np.empty(room, np.int64), np.empty(room, np.uint8)
        used, count, unknown = self._coding.decode(words, state, x, y, t_us, p)
        if unknown:
            place = offset + used * self._coding.word.itemsize
            raise InputError(
                f"{self.path}, byte {place}: {int(words[used]):#x} is no word of "
                f"{self.format.upper()}; the file is damaged or of another format, fetch it again"
            )
        return used, Events(x, y, t_us, p).slice(0, count)


def opened(path: Path) -> BinaryIO:
    """Opens a file for reading.

    Raises:
        InputError: it cannot be opened.
    """
    try:
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
            f"{path}: coded as {quoted(header.kind)}, known are {known}: convert it first"
        )
    kind, size = (*file.read(2), 0, 0)[:2]
    if kind not in (0x00, 0x0C) or size != 8:
        raise InputError(
            f"{path}, byte {header.data_offset}: events of type {kind:#x} and {size} bytes after a "
            "header without `% format`; needs change detection events (0x0 or 0xc, 8 bytes)"
        )
    return CODINGS["DAT"], header.data_offset + 2
