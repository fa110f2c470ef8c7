"""How a command prints: tables for people, JSON for scripts, nothing with --quiet."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console as RichConsole
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from eventsweep.emvs.errors import one_line, visible
from eventsweep.eval.cli.addresses import shown
from eventsweep.eval.cli.flag_names import with_flags
from eventsweep.eval.progress import Bars, Display, Silent

Part = str | Text | Table
"""What a summary is made of; a string is a line of its own, printed as it is."""


class Terminal(RichConsole):
    """What draws tables, bars and styles: of texts, which may be data's, none commands it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, highlight=False, **options)

    def render(self, *shown: Any, **options: Any) -> Iterator[Segment]:
        """The parts of what is shown."""
        for part in super().render(*shown, **options):
            yield part if part.control else part._replace(text=visible(part.text))


class Console:
    """Summaries on standard output, progress on the error stream.

    With `as_json` summaries are JSON, without progress. `piped_width` is the columns of tables that
    another program reads; by default 80.
    """

    def __init__(self, *, quiet: bool, as_json: bool, piped_width: int | None = None) -> None:
        self._shows = not (quiet or as_json)
        self._as_json = as_json
        self._out = Terminal()
        if piped_width is not None and not self.is_terminal:
            self._out.width = piped_width
        self.progress: Display = (
            Bars(with_flags, Terminal(stderr=True)) if self._shows else Silent()
        )

    @property
    def is_terminal(self) -> bool:
        """Whether a person looks at the output."""
        return self._out.is_terminal

    def result(self, facts: Any, parts: Iterable[Part]) -> None:
        """Prints facts as JSON where that is asked for, or else tables and lines for people.

        Facts that are a string are JSON already.
        """
        if self._as_json:
            text = (
                facts if isinstance(facts, str) else json.dumps(facts, indent=2, ensure_ascii=False)
            )
            self._out.out(visible(shown(text.rstrip("\n"))), highlight=False)
        self._print(parts)

    def say(self, line: str) -> None:
        """Prints a line for people."""
        self._print([line])

    def wrote(self, path: Path) -> None:
        """Says where to look."""
        self.say(f"wrote {path}")

    def warn(self, note: str) -> None:
        """Prints a note on the error stream, however quiet."""
        sys.stderr.write(f"note: {one_line(note)}\n")

    def _print(self, parts: Iterable[Part]) -> None:
        for part in parts if self._shows else ():
            if isinstance(part, Text):
                part.plain = one_line(shown(part.plain))
            line = one_line(shown(part)) if isinstance(part, str) else part
            self._out.print(line, soft_wrap=not isinstance(part, Table))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str | Text]]) -> Table:
    """A table for the terminal; `>` before a heading aligns its column to the right."""
    made = Table(title=one_line(title), title_justify="left")
    for k, heading in enumerate(columns):
        made.add_column(
            heading.removeprefix(">"),
            justify="right" if heading.startswith(">") else "left",
            no_wrap=k == 0,
            overflow="fold",
        )
    for row in rows:
        made.add_row(*(cell.replace("\n", " ") if isinstance(cell, str) else cell for cell in row))
    return made


def dim(line: str) -> Text:
    """A line of less weight."""
    return Text(line, style="dim")
