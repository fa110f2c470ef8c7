"""One file per sequence, `CASE/seedN.ply` or `.txt`: geometries and poses, checked and scored."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.errors import InputError, located, quoted
from eventsweep.emvs.utils.inputs import check_file, inside
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.eval.cli.verbs.score import Scorer, scorer_of
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.scoring.predictions import plain
from eventsweep.eval.suite.packages import Wanted
from eventsweep.plugins.ranking.facts import FileFacts

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console

SUFFIXES: Mapping[str, tuple[str, ...]] = {"geometry": (".ply", ".pcd"), "odometry": (".txt",)}
"""By track, the kinds of file: those whose readers take data of strangers."""
MOST_BYTES = 1 << 30
"""Of a file."""


def places(wanted: Wanted) -> list[str]:
    """A sequence each, `CASE/seedN`."""
    return [
        f"{case}/seed{seed}"
        for case in wanted.cases
        for seed in wanted.seeds
        if not wanted.suite.leaves_out(case, seed)
    ]


def file_names(there: Iterable[str], track: str, wanted: Wanted) -> dict[str, str]:
    """The file of each sequence, of the names that are there.

    Raises:
        InputError: a sequence without a file or with two, or a file of no sequence.
    """
    found: dict[str, str] = {}
    asked = set(places(wanted))
    for name in sorted(there):
        place, suffix = name[: -len(Path(name).suffix) or None], Path(name).suffix
        if place not in asked or suffix not in SUFFIXES[track]:
            raise InputError(f"{quoted(name)} is no file of the track {track}: {_needs(track)}")
        if place in found:
            raise InputError(f"{found[place]} and {name}: leave one file for each sequence")
        found[place] = name
    if missing := [place for place in places(wanted) if place not in found]:
        raise InputError(
            f"no file for {len(missing)} of {len(asked)} sequences, the first is {missing[0]}: "
            f"{_needs(track)}"
        )
    return found


def _needs(track: str) -> str:
    return f"needs CASE/seedN with {' or '.join(SUFFIXES[track])} for each case and seed"


def stage_files(folder: Path, facts: FileFacts, wanted: Wanted, stage: Path) -> list[str]:
    """Copies the files of a folder to where they are packed, checked; returns their names."""
    there = [
        path.relative_to(folder).as_posix()
        for path in folder.glob("*/*") if path.suffix in SUFFIXES[facts.track]
    ]  # fmt: skip
    with located(folder):
        names = list(file_names(there, facts.track, wanted).values())
    for name in names:
        source = inside(folder, name)
        check_file(source, MOST_BYTES)
        check_content(source, facts.track)
        (stage / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, stage / name)
    return names


def check_content(path: Path, track: str) -> None:
    """Reads a file as scoring will.

    Raises:
        InputError: a damaged file, one without a point or pose, or no plug-in that reads it.
    """
    if track == "odometry":
        read_poses(path, "s")
        return
    _scorer(path).check(str(path))


def _scorer(path: Path) -> Scorer:
    scorer = scorer_of((str(path),))
    if scorer is None:
        raise InputError(f"{path}: no installed plug-in scores geometries: install one that does")
    return scorer


def score_files(
    folder: Path, facts: FileFacts, names: Mapping[str, str], recordings: Path, out: Path,
    console: Console, *, force: bool, command: str,
) -> None:  # fmt: skip
    """Scores each sequence's file into `out/CASE/seedN`, as `ranking` takes them.

    Args:
        folder: the files.
        facts: what is submitted.
        names: file by sequence, as `file_names` finds them.
        recordings: the sequences with truth, `CASE/seedN`, as `archive unpack` writes them.
        out: folder to write.
        console: where single results go.
        force: whether an earlier output is replaced.
        command: for the pages' provenance.
    """
    for place in names:
        if not (recordings / place).is_dir():
            raise InputError(
                f"{recordings / place}: is no sequence; needs CASE/seedN of every sequence, as "
                "`archive unpack` writes them"
            )
    with atomic_dir(out, force=force, inputs=(folder, recordings)) as made:
        for place, name in names.items():
            given = f"{plain(facts.method)}={folder / name}"
            _score(given, facts.track, recordings / place, made / place, console, command)


def _score(given: str, track: str, truth: Path, out: Path, console: Console, command: str) -> None:
    from eventsweep.eval.report.trajectory_page import write_scores

    case = out.parent.name
    out.parent.mkdir(exist_ok=True)
    if track == "odometry":
        config = TrajectoryConfig()
        for note in write_scores([given], truth, out, config, case=case, command=command).notes:
            console.warn(f"{case}: {note}")
        return
    scorer = _scorer(Path(given))
    scorer.score(
        (given,), truth, out, console, config=scorer.Config(), align=None, case=case, force=False,
        command=command,
    )  # fmt: skip
