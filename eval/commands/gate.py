"""`eventsweep gate`: is this worse than the baseline?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from eval import suite_app
from eval.app import COMMON, Common, app
from eval.suite_app import WHERE, Where

_Switch = Parameter(negative=())


@app.command
def gate(
    *,
    baseline: Path,
    suite: str = "quick",
    result: Path | None = None,
    seeds: str | None = None,
    out: Path | None = None,
    junit: Path | None = None,
    markdown: Path | None = None,
    strict: Annotated[bool, _Switch] = False,
    update: Annotated[bool, _Switch] = False,
    reason: str = "",
    where: Where = WHERE,
    common: Common = COMMON,
) -> int:
    """Compare a result with a baseline, number by number; exit code 1 if anything is worse.

    Args:
        baseline: The file to hold against, or to write with --update.
        suite: What to run, as `eventsweep suite` takes it.
        result: Take this suite.json or results.json instead of running anything.
        seeds: Seeds instead of the suite's own, such as 0,1,2 or 100-109.
        out: Folder for suite.json and suite.csv of what was run.
        junit: File for the verdicts as JUnit XML.
        markdown: File for the summary; it also goes to $GITHUB_STEP_SUMMARY where that is set.
        strict: Let numbers that cannot be compared fail as well.
        update: Write the result as the new baseline.
        reason: Why there is a new baseline; kept in it.
    """
    from eval import gate_app

    asked = gate_app.Asked(
        baseline, suite, result, suite_app.numbers(seeds, "--seeds"), out, junit, markdown, strict,
        update, reason,
    )  # fmt: skip
    return gate_app.run(asked, where, common)
