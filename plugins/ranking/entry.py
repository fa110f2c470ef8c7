"""An entry to a public ranking: a folder of a repository with a submission, and what identifies it.

`NAME/entry.toml` names the suite, the package beside it and the package's hash. Whoever opens the
pull request makes the folder by one command and checks it by another; CI runs the second one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import tomli_w
from pydantic import Field, ValidationError

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.parameters import FrozenModel, first_fault
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, check_file, inside, parse_toml, read_text
from eventsweep.emvs.utils.output_manifest import NAME as LISTED
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.eval.suite.definition import ALL, check_name, installed, load
from eventsweep.plugins.ranking.archives.manifest import ArchiveManifest
from eventsweep.plugins.ranking.archives.tarball import sha256_of
from eventsweep.plugins.ranking.facts import AnyFacts
from eventsweep.plugins.ranking.submission import (
    PACKAGE,
    Asked,
    check_submission,
    make_submission,
)

ENTRY = "entry.toml"
MOST_BYTES = 100 << 20
"""Of a package: what hosts of repositories take in one file."""
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")


class Entry(FrozenModel):
    """`entry.toml`.

    Attributes:
        suite: name of the suite that was mapped, behind a colon that of a subset.
        archive: version of the archive whose sequences were read; empty where the suite was drawn.
        sha256: of the package, `maps.tar.zst`.
    """

    suite: Annotated[str, Field(pattern=r"^[\w.-]{1,80}(:[\w.-]{1,80})?$")]
    archive: Annotated[str, Field(pattern=r"^[0-9a-f]{0,64}$")] = ""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


def is_entry(folder: Path) -> bool:
    """Whether a folder holds an entry."""
    return (folder / ENTRY).is_file()


def read_entry(folder: Path) -> Entry:
    """Reads `entry.toml` in a folder."""
    path = inside(folder, ENTRY)
    try:
        return Entry.model_validate(parse_toml(read_text(path, SETTINGS_BYTES)))
    except ValidationError as error:
        fault = first_fault(error)
        raise InputError(
            f"{path}: {fault}; it holds {', '.join(Entry.model_fields)}: create it again"
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not TOML ({error}): create it again") from error


def package_of(folder: Path) -> Path:
    """The package of an entry, whose bytes are those that the entry names."""
    entry, path = read_entry(folder), inside(folder, PACKAGE)
    if not path.is_file():
        raise InputError(f"{path}: is missing: create the entry again")
    check_file(path, MOST_BYTES)
    found = sha256_of(path)
    if found != entry.sha256:
        raise InputError(
            f"{path}: its SHA-256 is {found}, {ENTRY} names {entry.sha256}: create the entry again"
        )
    return path


def make_entry(folder: Path, asked: Asked, out: Path, *, force: bool) -> AnyFacts:
    """Checks depth maps or files, packs them, and writes the folder of an entry.

    Args:
        folder: depth maps or files, and `submission.toml`, as `make_submission` takes them.
        asked: what it must hold.
        out: the folder to write; its name is the entry's.
        force: whether an entry that is there is replaced.
    """
    _check_name(out)
    with atomic_dir(out, force=force, inputs=(folder, asked)) as made:
        manifest = make_submission(folder, asked, made / PACKAGE, force=False)
        check_file(made / PACKAGE, MOST_BYTES)
        digest = sha256_of(made / PACKAGE)
        entry = Entry(suite=asked.name, archive=asked.archive, sha256=digest)
        (made / ENTRY).write_text(tomli_w.dumps(entry.model_dump()), encoding="utf-8")
    return manifest.facts


def check_entry(
    folder: Path, suite: str = "", archive: ArchiveManifest | None = None
) -> tuple[AnyFacts, Asked]:
    """Checks an entry as CI does: its name, its files, the package's hash, all that is packed.

    Args:
        folder: the entry.
        suite: its suite as `load` takes it; by default the one that the entry names, which must
            come with the program. The subset is always the entry's.
        archive: whose cases and seeds are enough; by default all of the subset.

    Returns:
        What is submitted, and what was asked for.
    """
    _check_name(folder)
    strange = sorted({path.name for path in folder.iterdir()} - {ENTRY, PACKAGE, LISTED})
    if strange:
        raise InputError(f"{folder}: {quoted(strange[0])} does not belong to an entry: remove it")
    entry, package = read_entry(folder), package_of(folder)
    own, _, subset = entry.suite.partition(":")
    if not suite and own not in installed():  # a file of that name would be the entry's own
        raise InputError(
            f"{folder}: its suite {quoted(own)} is not one of {', '.join(installed())}: give that "
            "suite's file with --suite"
        )
    found, _ = load(suite or entry.suite)
    check_name(found)
    if found.name != own:
        raise InputError(f"{folder}: is for {own}, not for {found.name}")
    asked = Asked.of(found, subset or ALL, archive)
    return check_submission(package, asked), asked


def check_apart(found: Iterable[tuple[Path, AnyFacts]]) -> None:
    """Refuses two entries of one method name: a ranking could not tell them apart."""
    by_method: dict[str, Path] = {}
    for folder, facts in found:
        other = by_method.setdefault(facts.method, folder)
        if other != folder:
            raise InputError(
                f"{folder}: {other} is called {facts.method!r} as well: give the method another "
                "name"
            )


def _check_name(folder: Path) -> None:
    name = folder.resolve().name
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{folder}: an entry's folder needs a name of a to z, 0 to 9 and -, at most 40 long"
        )
