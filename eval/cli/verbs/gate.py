"""`eventsweep gate`: is this worse than the baseline?"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.output_manifest import is_ours
from eventsweep.emvs.utils.outputs import check_output, output_file
from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, SuiteName, app
from eventsweep.eval.cli.help import RARE
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, run_with_flags, seed_numbers

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.eval.gate.compare import Choice, Judgement, Tolerances
    from eventsweep.eval.gate.report import VerdictLine
    from eventsweep.eval.results.results import Results
    from eventsweep.eval.results.series import Measured

GREEN, RED = 0, 1
_SUITE = "quick"
_SUMMARY = "GITHUB_STEP_SUMMARY"


@Parameter(name="*")
@dataclass(frozen=True)
class GateFlags:
    """Inputs of the comparison, and files for its outcome."""

    baseline: Path
    "Baseline to compare with, or to write with --update."

    suite: SuiteName | None = None
    "Suite to run, as `eventsweep suite` takes it; by default quick."

    result: Annotated[tuple[Path, ...], NO_NEGATIVE] = ()
    "Take this suite.json or results.json instead of running anything, repeatable."

    seeds: Annotated[str | None, RARE] = None
    "Seeds instead of the suite's own, such as 0,1,2 or 100-109."

    force: Force = False

    out: Path | None = None
    "Folder for suite.json and suite.csv of what was run."

    metric: Annotated[tuple[str, ...], NO_NEGATIVE] = ()
    "Let only this metric decide, repeatable; by default those on the page `gate`."

    tolerance: float | None = None
    "Relative difference that counts as no change, such as 0.05, in place of those on the page."

    case: Annotated[tuple[str, ...], NO_NEGATIVE, RARE] = ()
    "Compare only this case of the baseline, repeatable."

    method: Annotated[tuple[str, ...], NO_NEGATIVE, RARE] = ()
    "Compare only this method of the baseline, repeatable."

    junit: Path | None = None
    "File for the verdicts as JUnit XML."

    markdown: Path | None = None
    "File for the summary; it also goes to $GITHUB_STEP_SUMMARY where that is set."

    strict: Annotated[bool, NO_NEGATIVE, RARE] = False
    "Of the same sequences let any change be red, and whatever is lost."

    update: Annotated[bool, NO_NEGATIVE] = False
    "Write the result as the new baseline."

    reason: str = ""
    "Reason for the new baseline; stored in it."

    def check(self, jobs: JobFlags) -> None:
        """Refuses flags that contradict each other, before anything runs.

        Raises:
            InputError: says which.
        """
        self.seed_numbers()
        if self.update and not self.reason.strip():
            raise InputError("--update needs --reason: why may the numbers change?")
        if self.reason and not self.update:
            raise InputError(
                "--reason without --update has no effect: add --update, or leave it out"
            )
        if self.result and (self.seeds or self.out or self.suite or jobs != JOB_FLAGS):
            raise InputError(
                "--result runs nothing: leave --suite, --seeds, --out, --workers, --cache and "
                "--scheduler out"
            )
        if self.update and (self.case or self.method):
            raise InputError("--update writes a whole baseline: leave --case and --method out")
        if self.tolerance is not None and not 0 <= self.tolerance < 1:
            raise InputError(f"--tolerance {self.tolerance:g}: needs a fraction, from 0 to below 1")

    def check_files(self) -> None:
        """Refuses, without --force, files that are there and not the gate's own."""
        named = [path for path in (self.junit, self.markdown) if path is not None]
        if len({path.resolve() for path in named}) < len(named):
            raise InputError(f"--junit and --markdown are both {self.junit}: name two files")
        for path in named:
            check_output(path, force=self.force or is_ours(path))
        if self.update:
            check_output(self.baseline, force=True)

    def choice(self) -> Choice:
        """The part that is compared, and the metrics that decide."""
        from eventsweep.eval.gate.compare import DECIDING, Choice

        return Choice(self.metric or DECIDING, self.case, self.method, self.strict)

    def tolerances(self) -> Tolerances:
        """Differences that count as equal."""
        from eventsweep.eval.gate.compare import Tolerances

        if self.tolerance is None:
            return Tolerances()
        names = ("same_sequence", "same_recipe", "relative", "relative_alone")
        return Tolerances(**dict.fromkeys(names, self.tolerance))

    def seed_numbers(self) -> tuple[int, ...] | None:
        """The seeds; None for the suite's own."""
        return seed_numbers(self.seeds, "--seeds")


@app.command
def gate(*, flags: GateFlags, job_flags: JobFlags = JOB_FLAGS, common: Common = COMMON) -> int:
    """Compare a result with a baseline, number by number; exit code 1 if anything is worse."""
    from eventsweep.eval.gate.baseline import make_baseline, read_baseline, write_baseline
    from eventsweep.eval.gate.compare import compare, is_red

    flags.check(job_flags)
    flags.check_files()
    first = flags.update and not flags.baseline.exists()
    before = None if first else read_baseline(flags.baseline)
    if before is not None:
        flags.choice().check(before.by_key())
    measured = _measured(flags, job_flags, common)
    if flags.update:
        write_baseline(flags.baseline, make_baseline(measured, flags.reason, before))
        common.console().wrote(flags.baseline)
    known = None if before is None else before.by_key()
    verdicts = compare(known, measured, flags.tolerances(), flags.choice())
    _report(verdicts, measured, flags, common)
    return RED if is_red(verdicts) and not flags.update else GREEN


def _measured(flags: GateFlags, job_flags: JobFlags, common: Common) -> Measured:
    from eventsweep.eval.gate.baseline import together
    from eventsweep.eval.results.series import measured_of, read_measured
    from eventsweep.eval.suite import output
    from eventsweep.eval.suite.definition import load

    if flags.result:
        return together([read_measured(path) for path in flags.result])
    suite, subset = load(flags.suite or _SUITE)
    # A baseline needs more seeds than a run: they are what the tolerances are made of.
    seeds = flags.seed_numbers() or (suite.spread_seeds if flags.update else None)

    def run() -> Results:
        return run_with_flags(
            suite, subset, job_flags, common.console().progress, seeds=seeds, cases=flags.case
        )

    if flags.out is None:
        return measured_of(run())
    with output.prepare_folder(flags.out, force=flags.force) as folder:
        result = run()
        output.write(folder, result, force=flags.force)
    return measured_of(result)


def _report(
    verdicts: Sequence[Judgement], measured: Measured, flags: GateFlags, common: Common
) -> None:
    from eventsweep.eval.gate import report
    from eventsweep.eval.gate.report import write_junit

    # Checked before; what came meanwhile is checked again.
    flags.check_files()
    if flags.junit is not None:
        with output_file(flags.junit, force=True) as path:
            write_junit(path, verdicts)
    text = report.markdown(verdicts, f"eventsweep gate, {measured.name}")
    if flags.markdown is not None:
        with output_file(flags.markdown, force=True) as path:
            path.write_text(text, encoding="utf-8")
    if os.environ.get(_SUMMARY):
        with Path(os.environ[_SUMMARY]).open("a", encoding="utf-8") as stream:
            stream.write(text + "\n")
    if not common.quiet:
        common.console().result(report.as_json(verdicts), _summary(verdicts))


def _summary(verdicts: Sequence[Judgement]) -> Iterator[Part]:
    """The verdicts; without a table where it would only list a first baseline."""
    from eventsweep.eval.cli.console import table
    from eventsweep.eval.gate import report

    first = all(verdict.status == "new" for verdict in verdicts)
    rows = [] if first else report.lines(verdicts)
    if rows:
        columns = ("verdict", "what", ">baseline", ">now", ">allowed")
        yield table(report.CAPTION, columns, map(_cells, rows))
    if rows and report.hidden(verdicts):
        yield f"and {report.hidden(verdicts)} more"
    yield report.summary(verdicts)


def _cells(line: VerdictLine) -> tuple[str, ...]:
    """A line in as few columns as a terminal has room for."""
    status, case, method, metric, before, now, _change, allowed, why = line
    what = " ".join(part for part in (case, method, metric) if part)
    return status, f"{what}: {why}" if why else what, before, now, allowed
