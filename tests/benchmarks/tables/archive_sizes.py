"""How large an archive of sequences is: `python tests/benchmarks archive_sizes DIR --page PAGE`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.ranking.archives.manifest import ArchiveManifest, PackedSequence, read
from markdown_blocks import show

MARK = "sizes"


def sizes(manifest: ArchiveManifest) -> str:
    """Markdown: a line for the whole archive, and one for each subset of its suite."""
    parts = {manifest.suite: manifest.sequences}
    parts |= {name: manifest.chosen(name) for name in manifest.subsets}
    head = ["| Part | sequences | to fetch | unpacked |", "|---|--:|--:|--:|"]
    return "\n".join([*head, *(_line(name, part) for name, part in parts.items())]) + "\n"


def _line(name: str, part: Sequence[PackedSequence]) -> str:
    packed, unpacked = sum(one.bytes for one in part), sum(one.unpacked_bytes for one in part)
    return f"| `{name}` | {len(part)} | {packed / 1e6:,.1f} MB | {unpacked / 1e6:,.1f} MB |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints and writes the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks archive_sizes", description=__doc__
    )
    parser.add_argument("archive", type=Path, help="what `eventsweep archive make` wrote")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args(arguments)
    with exit_code() as code:
        text = sizes(read(asked.archive))
        show(text, asked.page, MARK)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
