"""Writes the table of event formats: `python tests/benchmarks format_table PAGE`."""

from __future__ import annotations

import sys
from pathlib import Path

from eventsweep.emvs.formats import FORMATS, Format
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import into_page
from table_code import Code


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


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {"docs/formats.md#formats": Code()}


def main(arguments: list[str]) -> int:
    """Rewrites the page that is named."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python tests/benchmarks format_table PAGE\n")
        return 2
    with exit_code() as ended:
        into_page(Path(arguments[0]), "formats", table(), code)
    return ended.value


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
