"""The text in front of Prophesee's RAW and DAT files: lines that begin with `% `."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from emvs.errors import InputError
from emvs.io.events.wording import quoted

_MOST_BYTES = 1 << 16
_SENSORS = {"gen31": (640, 480), "gen3": (640, 480), "gen41": (1280, 720), "gen42": (1280, 720)}
_SENSORS |= {"imx636": (1280, 720), "genx320": (320, 320)}


@dataclass(frozen=True)
class RawHeader:
    """What the lines say.

    Attributes:
        kind: `EVT2`, `EVT21`, `EVT3`, or an empty text where no line says it.
        width_px: sensor width, where a line says it.
        height_px: sensor height, where a line says it.
        data_offset: where the events begin, bytes.
    """

    kind: str
    width_px: int | None
    height_px: int | None
    data_offset: int


def read_raw_header(path: Path, file: BinaryIO) -> RawHeader:
    """Reads the lines and leaves the file where the events begin.

    Raises:
        InputError: no such lines, too many, or a size that is none.
    """
    fields: dict[str, str] = {}
    while file.peek(1)[:1] == b"%":  # type: ignore[attr-defined]
        line = file.readline(_MOST_BYTES)
        if file.tell() > _MOST_BYTES or not line.endswith(b"\n"):
            raise InputError(
                f"{path}, byte {file.tell()}: the header does not end; needs lines `% ...` and "
                "`% end`: the file is damaged"
            )
        words = line[1:].decode("latin-1").strip()
        key, _, value = words.partition(" ")
        if key == "end":
            break
        fields[key.lower()] = value.strip()
    if not fields:
        raise InputError(f"{path}, byte 0: no header; needs lines `% ...` before the events")
    return _header(path, fields, file.tell())


def _header(path: Path, fields: dict[str, str], offset: int) -> RawHeader:
    kind, *options = (fields.get("format") or "").split(";")
    named = dict(option.partition("=")[::2] for option in options)
    if "legacy" in (named.get("endianness"), fields.get("endianness")):
        raise InputError(f"{path}: words in legacy order; convert it with the maker's tools first")
    if not kind and "evt" in fields:
        kind = "EVT" + fields["evt"].removesuffix(".0").replace(".", "")
    size = _size(path, fields, named)
    return RawHeader(kind.upper().replace(".", ""), size[0], size[1], offset)


def _size(
    path: Path, fields: dict[str, str], named: dict[str, str]
) -> tuple[int, int] | tuple[None, None]:
    width = named.get("width") or fields.get("width")
    height = named.get("height") or fields.get("height")
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
