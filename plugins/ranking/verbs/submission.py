"""`eventsweep submission`: what a method found for a suite, made into one file and checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, SuiteName
from eventsweep.eval.cli.help import HELP_FLAGS, Program

if TYPE_CHECKING:
    from eventsweep.plugins.ranking.facts import AnyFacts
    from eventsweep.plugins.ranking.submission import Asked

Maps = Annotated[
    Path,
    Parameter(
        help="Depth maps as CASE/seedN/TIME.npz, geometries as CASE/seedN.ply or poses as "
        "CASE/seedN.txt, beside them submission.toml."
    ),
]
Archive = Annotated[
    Path | None,
    Parameter(help="Folder of the archive whose sequences were read: its cases and seeds."),
]

submission = Program(
    name="submission",
    help="Make, check or score a submission: what a method found for a suite.",
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
    """Check what a method found and pack it into a file; any fault is reported in one line.

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
    """Check what a method found and make an entry to a ranking: a folder for a pull request.

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
        suite: Suite that was answered; of an entry needed only if it is FILE.toml.
    """
    from eventsweep.plugins.ranking.entry import check_apart, is_entry

    entries = []
    for path in paths:
        facts, asked = _checked(path, suite, archive)
        if is_entry(path):
            entries.append((path, facts))
        _show(common, facts, asked, len(asked.views()))
    check_apart(entries)


@submission.command
def score(
    path: Path,
    /,
    *,
    recordings: Path,
    out: Path,
    suite: SuiteName | None = None,
    archive: Archive = None,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Score geometries or poses of a submission, for `ranking`; depth maps are scored by `suite`.

    Args:
        path: File of `submission make`, the folder it is made of, or an entry.
        recordings: Folder of `archive unpack`: sequences with truth as CASE/seedN.
        out: Folder to write: CASE/seedN/results.json.
        suite: Suite that was answered; of an entry needed only if it is FILE.toml.
    """
    from tempfile import TemporaryDirectory

    from eventsweep.eval.cli.app import command_line
    from eventsweep.eval.cli.console import Console
    from eventsweep.plugins.ranking.files import score_files
    from eventsweep.plugins.ranking.submission import opened_files

    _, asked = _checked(path, suite, archive)
    with TemporaryDirectory() as place:
        facts, folder, names = opened_files(path, asked, Path(place))
        score_files(
            folder, facts, names, recordings, out, Console(quiet=True, as_json=False),
            force=force, command=command_line(),
        )  # fmt: skip
    line = f"{facts.method}: {len(names)} files of the track {facts.track} are scored"
    common.console().result({**facts.model_dump(mode="json"), "files": len(names)}, [line])
    common.console().wrote(out)


def _asked(suite: str, archive: Path | None) -> Asked:
    from eventsweep.eval.suite.definition import check_name, load
    from eventsweep.plugins.ranking.archives.manifest import read
    from eventsweep.plugins.ranking.submission import Asked

    definition, subset = load(suite)
    check_name(definition)
    return Asked.of(definition, subset, read(archive) if archive else None)


def _checked(path: Path, suite: str | None, archive: Path | None) -> tuple[AnyFacts, Asked]:
    from eventsweep.emvs.errors import InputError
    from eventsweep.plugins.ranking.archives.manifest import read
    from eventsweep.plugins.ranking.entry import check_entry, is_entry
    from eventsweep.plugins.ranking.submission import check_submission

    if is_entry(path):
        return check_entry(path, suite or "", read(archive) if archive else None)
    if not path.exists():
        raise InputError(
            f"{path}: no such file or folder; needs a submission, or an entry's folder"
        )
    if suite is None:
        raise InputError(f"{path}: is not an entry (no entry.toml): give its --suite")
    asked = _asked(suite, archive)
    return check_submission(path, asked), asked


def _show(common: Common, facts: AnyFacts, asked: Asked, maps: int) -> None:
    """Prints what a submission is, once all of it has been checked."""
    from eventsweep.plugins.ranking.facts import FileFacts
    from eventsweep.plugins.ranking.files import places

    cost = facts.cost
    if isinstance(facts, FileFacts):
        files = len(places(asked))
        what, counted = f"{files} files of the track {facts.track}", {"files": files}
        pace = f"{facts.cost.seconds_per_sequence:g} s per sequence"
    else:
        what, counted = f"{maps} depth maps", {"depth_maps": maps}
        pace = f"{facts.cost.seconds_per_window:g} s per window"
    line = (
        f"{facts.method} by {', '.join(facts.authors)}, {facts.licence}: {what} for {asked.name} "
        f"are complete; stated: {pace}, {cost.peak_memory_mb:g} MB, {cost.hardware}"
    )
    content = {**facts.model_dump(mode="json"), "suite": asked.name, **counted}
    common.console().result(content, [line])
