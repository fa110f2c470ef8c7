"""`eventsweep submission`: depth maps of a method for a suite, made into one file and checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, SuiteName
from eventsweep.eval.cli.help import HELP_FLAGS, Program

if TYPE_CHECKING:
    from eventsweep.plugins.ranking.submission import Asked, SubmissionFacts

Maps = Annotated[
    Path, Parameter(help="Depth maps as CASE/seedN/TIME.npz, beside them submission.toml.")
]
Archive = Annotated[
    Path | None,
    Parameter(help="Folder of the archive whose sequences were read: its cases and seeds."),
]

submission = Program(
    name="submission",
    help="Make or check a submission: depth maps of a method for a suite.",
    help_flags=HELP_FLAGS,
)


@submission.command
def make(
    folder: Maps,
    /,
    *,
    suite: SuiteName,
    out: Path,
    archive: Archive = None,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Check depth maps and pack them into a file; any fault is reported in one line.

    Args:
        suite: Such as suite-v5, quick, or FILE.toml.
        out: File to write, such as mine.tar.zst.
    """
    from eventsweep.plugins.ranking.submission import make_submission

    asked = _asked(suite, archive)
    maps = len(asked.views())
    _show(common, make_submission(folder, asked, out, force=force).facts, asked, maps)
    common.console().wrote(out)


@submission.command
def enter(
    folder: Maps,
    /,
    *,
    suite: SuiteName,
    out: Path,
    archive: Archive = None,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Check depth maps and make an entry to a public ranking: a folder for a pull request.

    Args:
        suite: Such as suite-v5 or quick.
        out: Folder to write, such as submissions/mine: entry.toml and maps.tar.zst.
    """
    from eventsweep.plugins.ranking.entry import make_entry

    asked = _asked(suite, archive)
    maps = len(asked.views())  # now: the model of a suite may lie in what is set aside
    _show(common, make_entry(folder, asked, out, force=force), asked, maps)
    common.console().wrote(out)


@submission.command
def check(
    paths: Annotated[tuple[Path, ...], NO_NEGATIVE],
    /,
    *,
    suite: SuiteName | None = None,
    archive: Archive = None,
    common: Common = COMMON,
) -> None:
    """Check whole submissions, without truth; any fault is reported in one line.

    Args:
        paths: Files of `submission make`, the folders they are made of, or entries: submissions/*.
        suite: Such as suite-v5, quick, or FILE.toml, which no entry names itself.
    """
    from eventsweep.plugins.ranking.archives.manifest import read
    from eventsweep.plugins.ranking.entry import check_apart, check_entry, is_entry

    entries = []
    for path in paths:
        if is_entry(path):
            facts, asked = check_entry(path, suite or "", read(archive) if archive else None)
            entries.append((path, facts))
        else:
            facts, asked = _checked(path, suite, archive)
        _show(common, facts, asked, len(asked.views()))
    check_apart(entries)


def _asked(suite: str, archive: Path | None) -> Asked:
    from eventsweep.eval.suite.definition import check_name, load
    from eventsweep.plugins.ranking.archives.manifest import read
    from eventsweep.plugins.ranking.submission import Asked

    definition, subset = load(suite)
    check_name(definition)
    return Asked.of(definition, subset, read(archive) if archive else None)


def _checked(path: Path, suite: str | None, archive: Path | None) -> tuple[SubmissionFacts, Asked]:
    from eventsweep.emvs.errors import InputError
    from eventsweep.plugins.ranking.submission import check_submission

    if not path.exists():
        raise InputError(
            f"{path}: no such file or folder; needs a submission, or an entry's folder"
        )
    if suite is None:
        raise InputError(f"{path}: is not an entry (no entry.toml): give its --suite")
    asked = _asked(suite, archive)
    return check_submission(path, asked), asked


def _show(common: Common, facts: SubmissionFacts, asked: Asked, maps: int) -> None:
    """Prints what a submission is, once all of it has been checked."""
    cost = facts.cost
    line = (
        f"{facts.method} by {', '.join(facts.authors)}, {facts.licence}: {maps} depth maps for "
        f"{asked.name} are complete; stated: {cost.seconds_per_window:g} s per window, "
        f"{cost.peak_memory_mb:g} MB, {cost.hardware}"
    )
    content = {**facts.model_dump(mode="json"), "suite": asked.name, "depth_maps": maps}
    common.console().result(content, [line])
