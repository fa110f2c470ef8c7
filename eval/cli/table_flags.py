"""Flags of the verbs that write the table of a paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.eval.cli.app import NO_NEGATIVE

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console
    from eventsweep.eval.results.results import Results

_TABLE = Group.create_ordered("Table for a paper")


@Parameter(name="*", group=_TABLE)
@dataclass(frozen=True)
class TableFlags:
    """A table of methods by metrics, in the format that its file's name says."""

    table: Annotated[tuple[Path, ...], NO_NEGATIVE] = ()
    "File for the table: .tex (booktabs), .md or .csv; repeatable."

    metric: Annotated[tuple[str, ...], NO_NEGATIVE] = ()
    "Column of the table, repeatable; by default errors, bad pixels and points."

    reference: str = ""
    "Method to compare the others with: paired differences, their intervals, and wins."

    def check(self, *, force: bool, cases: tuple[str, ...] = ()) -> None:
        """Refuses, before anything runs, what could not be written."""
        from eventsweep.eval.report.method_table import check_table_file

        if not self.table and (self.metric or self.reference or cases):
            raise InputError(
                "what a table shows is chosen, and there is none: add --table FILE.tex"
            )
        for path in self.table:
            check_table_file(path)
            check_output(path, force=force)

    def write(
        self, results: Mapping[str, Results], console: Console, *, force: bool,
        cases: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        """Writes the files."""
        from eventsweep.eval.report.method_table import method_table, write_table

        if not self.table:
            return
        made = method_table(results, self.metric, self.reference, cases)
        for path in self.table:
            write_table(path, made, force=force)
            console.wrote(path)


TABLE_FLAGS = TableFlags()
