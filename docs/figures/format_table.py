"""Writes the table of formats into the documentation: `python -m emvs.formats PAGE`."""

from __future__ import annotations

import sys
from pathlib import Path

from emvs.errors import InputError
from emvs.formats import FORMATS, Format
from emvs.utils.files import atomic_path

_BEGIN, _END = "<!-- formats: begin -->\n", "<!-- formats: end -->\n"


def table() -> str:
    """The formats as a Markdown table."""
    head = (
        "| Name | What | Writes | Streams | Largest pixel | Time | Latest time written, µs "
        "| Backward steps survive | Polarity |"
    )
    lines = [head, "|---" * head.count(" | ") + "|---|", *map(_row, FORMATS.values())]
    return "\n".join(lines) + "\n"


def _row(entry: Format) -> str:
    limits = entry.limits
    cells = (
        f"`{entry.name}`",
        entry.what,
        "yes" if entry.writes else "no",
        "any" if limits.streams > 1000 else str(limits.streams),
        f"{limits.max_x}, {limits.max_y}",
        limits.unit,
        _power(limits.max_us) if entry.writes else "–",
        "yes" if limits.keeps_order else "no",
        entry.polarity,
    )
    return "| " + " | ".join(cells) + " |"


def _power(value: int) -> str:
    """2^N where that is close enough to say so."""
    bits = (value + 1).bit_length() - 1
    return f"2^{bits}" if value + 1 - (1 << bits) <= 1 else f"{value:.2g}"


def replaced(page: str, begin: str, end: str, text: str) -> str:
    """The page with `text` between two markers.

    Raises:
        InputError: the markers are not there.
    """
    head, found, rest = page.partition(begin)
    _, closed, tail = rest.partition(end)
    if not (found and closed):
        raise InputError(f"the page lacks {begin.strip()} and {end.strip()}: add both lines")
    return head + begin + "\n" + text + "\n" + end + tail


def main(arguments: list[str]) -> int:
    """Rewrites the page that is named."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m emvs.formats PAGE\n")
        return 2
    page = Path(arguments[0])
    text = replaced(page.read_text(encoding="utf-8"), _BEGIN, _END, table())
    with atomic_path(page) as partial:
        partial.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
