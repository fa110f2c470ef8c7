"""What `eventsweep gate` does, step by step."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console as RichConsole
from rich.table import Table
from rich.text import Text

from emvs.atomic import atomic_path
from emvs.errors import InputError
from eval import gate_table, suite_app, suite_output
from eval.app import Common
from eval.baseline import Baseline, make_baseline, read_baseline, write_baseline
from eval.gate import Tolerances, Verdict, compare, is_red
from eval.gate_series import Measured, of_suite, read_measured
from eval.junit import write_junit
from eval.suite import load
from eval.suite_app import Where

GREEN, RED = 0, 1
_SUMMARY = "GITHUB_STEP_SUMMARY"


@dataclass(frozen=True)
class Asked:
    """The command's flags, see `eval.commands.gate`."""

    baseline: Path
    suite: str
    result: Path | None
    seeds: tuple[int, ...] | None
    out: Path | None
    junit: Path | None
    markdown: Path | None
    strict: bool
    update: bool
    reason: str

    def check(self) -> None:
        """Refuses flags that contradict each other, before anything runs.

        Raises:
            InputError: says which.
        """
        if self.update and not self.reason.strip():
            raise InputError("--update needs --reason: why may the numbers change?")
        if self.reason and not self.update:
            raise InputError("--reason without --update: nothing is written")
        if self.result is not None and (self.seeds or self.out):
            raise InputError("--result runs nothing: leave --seeds and --out out")


def run(asked: Asked, where: Where, common: Common) -> int:
    """Measures or reads, compares, tells; returns the exit code."""
    asked.check()
    before = _before(asked)
    measured = _measured(asked, where, common)
    if asked.update:
        write_baseline(asked.baseline, make_baseline(measured, asked.reason, before))
        common.console().wrote(asked.baseline)
    verdicts = compare(before.by_key(), measured, Tolerances()) if before else []
    _tell(verdicts, measured, asked, common)
    if asked.update:
        return GREEN
    stuck = asked.strict and any(one.status == "not comparable" for one in verdicts)
    return RED if is_red(verdicts) or stuck else GREEN


def _before(asked: Asked) -> Baseline | None:
    if asked.update and not asked.baseline.exists():
        return None
    return read_baseline(asked.baseline)


def _measured(asked: Asked, where: Where, common: Common) -> Measured:
    if asked.result is not None:
        return read_measured(asked.result)
    suite, subset = load(asked.suite)
    folder = suite_output.prepared(asked.out, force=common.force) if asked.out else None
    # A baseline needs more seeds than a run: they are what the tolerances are made of.
    seeds = asked.seeds or (suite.spread_seeds if asked.update else None)
    result = suite_app.run(suite, subset, where, common.console().progress, seeds=seeds)
    if folder is not None:
        suite_output.write(folder, result)
    return of_suite(result)


def _tell(verdicts: Sequence[Verdict], measured: Measured, asked: Asked, common: Common) -> None:
    if asked.junit is not None:
        write_junit(asked.junit, verdicts)
    text = gate_table.markdown(verdicts, f"eventsweep gate, {measured.name}")
    if asked.markdown is not None:
        with atomic_path(asked.markdown) as path:
            path.write_text(text, encoding="utf-8")
    if os.environ.get(_SUMMARY):
        with Path(os.environ[_SUMMARY]).open("a", encoding="utf-8") as stream:
            stream.write(text + "\n")
    if not common.quiet:
        _print(verdicts, as_json=common.json)


def _print(verdicts: Sequence[Verdict], *, as_json: bool) -> None:
    out = RichConsole(highlight=False)
    if as_json:
        out.out(gate_table.as_json(verdicts), highlight=False)
        return
    rows = gate_table.lines(verdicts)
    if rows:
        out.print(_table(rows))
    if gate_table.hidden(verdicts):
        out.print(f"and {gate_table.hidden(verdicts)} more")
    out.print(gate_table.summary(verdicts), markup=False, soft_wrap=True)


def _table(rows: Sequence[gate_table.Line]) -> Table:
    """The lines in as few columns as a terminal has room for."""
    table = Table(title="all that is not the same", title_justify="left")
    table.add_column("verdict", no_wrap=True)
    table.add_column("what", overflow="fold")
    for heading in ("baseline", "now", "allowed"):
        table.add_column(heading, justify="right", no_wrap=True)
    for status, case, method, metric, before, now, _change, allowed, why in rows:
        what = " ".join(part for part in (case, method, metric) if part)
        what += f": {why}" if why else ""
        table.add_row(*map(Text, (status, what, before, now, allowed)))
    return table
