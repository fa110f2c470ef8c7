"""`eventsweep submission`: depth maps of a method for a suite, made into one file and checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.eval.cli.app import COMMON, Common, Force, SuiteName, app
from eventsweep.eval.cli.help import HELP_FLAGS, Program

if TYPE_CHECKING:
    from eventsweep.eval.suite.submission import Asked, SubmissionFacts

submission = Program(
    name="submission",
    help="Make or check a submission: depth maps of a method for a suite.",
    help_flags=HELP_FLAGS,
)
app.command(submission)


@submission.command
def make(
    folder: Path,
    /,
    *,
    suite: SuiteName,
    out: Path,
    archive: Path | None = None,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Check depth maps and pack them into a file; any fault is reported in one line.

    Args:
        folder: Depth maps as CASE/seedN/TIME.npz, beside them submission.toml.
        suite: Such as suite-v4, quick, or FILE.toml.
        out: File to write, such as mine.tar.zst.
        archive: Folder of the archive whose sequences were read: its cases and seeds.
    """
    from eventsweep.eval.archives.manifest import read
    from eventsweep.eval.suite.definition import load
    from eventsweep.eval.suite.submission import Asked, make_submission

    asked = Asked.of(*load(suite), read(archive) if archive else None)
    manifest = make_submission(folder, asked, out, force=force)
    _show(common, manifest.facts, asked)
    common.console().wrote(out)


@submission.command
def check(
    path: Path,
    /,
    *,
    suite: SuiteName,
    archive: Path | None = None,
    common: Common = COMMON,
) -> None:
    """Check a whole submission, without truth; any fault is reported in one line.

    Args:
        path: File of `submission make`, or the folder it is made of.
        suite: Such as suite-v4, quick, or FILE.toml.
        archive: Folder of the archive whose sequences were read: its cases and seeds.
    """
    from eventsweep.eval.archives.manifest import read
    from eventsweep.eval.suite.definition import load
    from eventsweep.eval.suite.submission import Asked, check_submission

    asked = Asked.of(*load(suite), read(archive) if archive else None)
    facts = check_submission(path, asked)
    _show(common, facts, asked)


def _show(common: Common, facts: SubmissionFacts, asked: Asked) -> None:
    """Prints what a submission is, once all of it was found to be right."""
    maps, cost = len(asked.views()), facts.cost
    line = (
        f"{facts.method} by {', '.join(facts.authors)}, {facts.licence}: {maps} depth maps for "
        f"{asked.suite.name} are complete; stated: {cost.seconds_per_window:g} s a window, "
        f"{cost.peak_memory_mb:g} MB, {cost.hardware}"
    )
    content = {**facts.model_dump(mode="json"), "suite": asked.suite.name, "depth_maps": maps}
    common.console().result(content, [line])
