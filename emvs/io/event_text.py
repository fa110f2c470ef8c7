"""Events as text, one `t_s x y p` per line, read by time slice without loading the file."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from emvs.data.events import Events
from emvs.errors import InputError

_BLOCK_BYTES = 1 << 23


@dataclass(frozen=True)
class _Block:
    """A run of whole lines: where it lies in the file, and the times it covers."""

    offset: int
    size: int
    first_line: int
    first_us: int
    last_us: int


class EventText:
    """A text of events; opening reads it once, in blocks, to learn which block covers which time.

    Raises:
        InputError: a missing file, a line that is no event, or events unsorted or off the sensor.
    """

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self.path = Path(path)
        self._size_px = (width_px, height_px)
        self.count = 0
        self._blocks = self._index()
        if not self._blocks:
            raise InputError(f"{path}: no events; needs lines `t_s x y p`")
        self.span_us = (self._blocks[0].first_us, self._blocks[-1].last_us)

    def read(self, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`."""
        wanted = [
            block for block in self._blocks if block.last_us >= t0_us and block.first_us < t1_us
        ]
        return Events.concat([self._load(block).between(t0_us, t1_us) for block in wanted])

    def _index(self) -> list[_Block]:
        blocks: list[_Block] = []
        offset, line = 0, 1
        with _opened(self.path) as file:
            while text := file.read(_BLOCK_BYTES):
                text += file.readline()
                events = self._parse(text, line)
                if len(events):
                    block = _Block(
                        offset, len(text), line, int(events.t_us[0]), int(events.t_us[-1])
                    )
                    self._check_order(blocks, block)
                    blocks.append(block)
                self.count += len(events)
                offset, line = offset + len(text), line + text.count(b"\n")
        return blocks

    def _check_order(self, blocks: list[_Block], block: _Block) -> None:
        if blocks and block.first_us < blocks[-1].last_us:
            raise InputError(
                f"{self.path}, line {block.first_line}: event at {block.first_us} µs comes after "
                f"one at {blocks[-1].last_us} µs: sort the events by time (stable)"
            )

    def _load(self, block: _Block) -> Events:
        with _opened(self.path) as file:
            file.seek(block.offset)
            return self._parse(file.read(block.size), block.first_line)

    def _parse(self, text: bytes, first_line: int) -> Events:
        if not text.strip():
            return Events.empty()
        import pandas as pd  # 0.1 s that other recordings need not wait for

        try:
            table = pd.read_csv(
                io.BytesIO(text), sep=" ", header=None, dtype=np.float64, skip_blank_lines=False
            ).to_numpy()
        except ValueError as error:
            raise InputError(f"{self.path}, {_bad_line(text, first_line)}") from error
        if table.shape[1] != 4 or not np.isfinite(table).all() or not _whole(table[:, 1:]):
            raise InputError(f"{self.path}, {_bad_line(text, first_line)}")
        t_us = np.round(table[:, 0] * 1e6).astype(np.int64)
        x, y = table[:, 1].astype(np.uint16), table[:, 2].astype(np.uint16)
        events = Events(x, y, t_us, (table[:, 3] > 0).astype(np.uint8))
        try:
            return events.checked(*self._size_px)
        except InputError as error:
            raise InputError(f"{self.path}, counted from line {first_line}: {error}") from error


def _opened(path: Path) -> io.BufferedReader:
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _whole(columns: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> bool:
    """Whether all values are integers that fit a sensor position."""
    return bool(((columns >= 0) & (columns <= 65535) & (columns == np.floor(columns))).all())


def _bad_line(text: bytes, first_line: int) -> str:
    """Says which line of a block is no event: slow, and needed only once."""
    for number, line in enumerate(text.splitlines(), start=first_line):
        try:
            t_s, *rest = (float(word) for word in line.split(b" "))
            good = np.isfinite(t_s) and len(rest) == 3 and _whole(np.array(rest))
        except ValueError:
            good = False
        if not good:
            shown = line[:60].decode("ascii", "replace")
            return f"line {number}: {shown!r} is not an event; needs `t_s x y p`, whole pixels >= 0"
    return f"lines {first_line} and following: not events; needs `t_s x y p` with single blanks"
