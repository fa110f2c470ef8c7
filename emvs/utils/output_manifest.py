"""The manifest of an output folder: size and hash of every file that this program wrote into it.

What is listed and unchanged is ours, and may be replaced; everything else belongs to somebody. A
folder below that has a manifest of its own is a part of the output and says itself what is ours.
The manifest of a sequence, `manifest.json`, counts as one.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import flush, is_work_folder, link_new, write_text

NAME = ".eventsweep.json"
LOCK = b"eventsweep: a run is writing the output of this name\n"
"""What a claim's hidden file says: left by a killed process, it is ours."""
_SEQUENCE = "manifest.json"
_SEQUENCE_KEYS = {"schema_version", "event_counts", "files"}
_SCHEMA = 1
_MOST_NAMED = 3
_SETTLED_NS = 1_000_000_000


class FileFacts(NamedTuple):
    """Size and hash of a file."""

    bytes: int
    sha256: str


Files = Mapping[str, FileFacts]


@dataclass(frozen=True)
class OutputManifest:
    """What is ours in a folder.

    Attributes:
        files: by name below the folder.
        coming: files that are being exchanged: until that is done either content is ours.
        parts: folders below that have a manifest of their own.
        unlisted: files that are manifests themselves.
    """

    files: Files = field(default_factory=dict)
    coming: Files = field(default_factory=dict)
    parts: frozenset[str] = frozenset()
    unlisted: frozenset[str] = frozenset()

    def lists(self, folder: Path, name: str) -> bool:
        """Whether a file is ours and unchanged."""
        if name in self.unlisted:
            return True
        known = [facts[name] for facts in (self.files, self.coming) if name in facts]
        size = _plain_size(folder / name)
        same_size = [facts for facts in known if facts.bytes == size]
        return bool(same_size) and facts_of(folder / name) in same_size


_NOTHING = OutputManifest()


def read(folder: Path) -> OutputManifest | None:
    """The manifest of a folder; None without one, or where it is damaged."""
    own, sequence = _json(folder / NAME), _json(folder / _SEQUENCE)
    try:
        if own.get("written_by") == "eventsweep" and own.get("schema") == _SCHEMA:
            files, coming = _parsed(own["files"]), _parsed(own.get("coming", {}))
            parts = frozenset(map(str, own.get("parts", ())))
            return OutputManifest(files, coming, parts, frozenset({NAME}))
        if sequence.keys() >= _SEQUENCE_KEYS:
            return OutputManifest(_parsed(sequence["files"]), unlisted=frozenset({_SEQUENCE}))
    except (TypeError, KeyError, AttributeError, ValueError):
        pass
    return None


def _parsed(files: dict[str, Any]) -> Files:
    return {n: FileFacts(int(f["bytes"]), str(f["sha256"])) for n, f in files.items()}


def complete(folder: Path) -> None:
    """Lists every file below a folder, all of them ours, that no manifest lists yet."""
    known = read(folder) or _NOTHING
    files, parts = dict(known.files), set(known.parts)
    before = len(files), len(parts)
    for parent, below, names in os.walk(folder):
        at = Path(parent).relative_to(folder)
        if at.parts and read(Path(parent)) is not None:
            parts.add(at.as_posix())
            below.clear()
            continue
        new = {(at / name).as_posix() for name in names} - {*files, *known.unlisted}
        files |= {name: facts_of(folder / name) for name in new}
    if (len(files), len(parts)) != before or not known.unlisted:
        _write(folder, replace(known, files=files, parts=frozenset(parts)))


def add_part(folder: Path, name: str) -> None:
    """Lists a folder below, which has a manifest of its own, or will have when it appears."""
    with _updating(folder) as manifest:
        if name not in manifest.parts:
            _write(folder, replace(manifest, parts=manifest.parts | {name}))


@contextmanager
def listing(folder: Path, files: Files) -> Iterator[None]:
    """Lists files that the caller puts into a folder within the context, whenever it is killed."""
    with _updating(folder) as before:
        _write(folder, replace(before, coming={**before.coming, **files}))
        yield
        _write(folder, replace(before, files={**before.files, **files}))


def check_ours(folder: Path, names: Iterable[str]) -> None:
    """Refuses files and folders in a folder that are not ours; absent ones pass."""
    theirs = strangers(folder, names)
    if theirs:
        raise InputError(
            f"{folder} holds {named(theirs)}, which eventsweep did not write, or which was changed "
            f"since: choose another output, or move {'it' if len(theirs) == 1 else 'them'} away"
        )


def exchange(staged: Path, folder: Path, names: Iterable[str], index: str = "") -> None:
    """Puts staged files of these names into a folder, and lists them there.

    `index`, the one that says which others to read, is absent while they are exchanged.
    """
    ordered = sorted(names, key=lambda name: name == index)
    for name in ordered:
        flush(staged / name)
    check_ours(folder, ordered)
    with listing(folder, {name: facts_of(staged / name) for name in ordered}):
        if index:
            (folder / index).unlink(missing_ok=True)
        for name in ordered:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            put = Path.replace if os.path.lexists(folder / name) else link_new
            put(staged / name, folder / name)


def strangers(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """What a folder holds, or these names in it, that is not ours; folders with a slash.

    Links, devices and mounted file systems are never ours. Empty folders hold nothing.
    """
    manifest = read(folder)
    if names is not None:
        every = (_look_below(folder, name, manifest or _NOTHING) for name in names)
        return sorted({name for entries in every for name, ours in entries if not ours})
    if manifest is None and os.access(folder, os.R_OK):  # all of it is somebody's: named briefly
        theirs = [path for path in folder.iterdir() if not _is_leftover(path)]
        return sorted(f"{path.name}{'/' * _is_folder(path)}" for path in theirs)
    return sorted(name for name, ours in _survey(folder) if not ours)


def remove_ours(folder: Path) -> list[str]:
    """Removes what is ours in a folder, and the folder if that was all; returns what is left."""
    entries = list(_survey(folder))
    # Manifests last: after a kill they still say what is ours.
    ours = [name for name, is_ours in entries if is_ours]
    for name in sorted(ours, key=lambda name: (name.endswith((NAME, _SEQUENCE)), -name.count("/"))):
        (folder / name).unlink(missing_ok=True)
    for parent, _, _ in os.walk(folder, topdown=False):
        with suppress(OSError):  # somebody's file is in it
            Path(parent).rmdir()
    return sorted(name for name, is_ours in entries if not is_ours)


def named(names: list[str]) -> str:
    """The first few names, as an error shows them."""
    shown = [name if name.isprintable() else ascii(name) for name in names[:_MOST_NAMED]]
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(shown) + more


def facts_of(path: Path) -> FileFacts:
    """Size and hash of a file."""
    seen = path.stat()
    stamp = (seen.st_ino, seen.st_size, seen.st_mtime_ns, seen.st_ctime_ns)
    # A clock with coarse ticks shows no second change right after a first one.
    is_settled = time.time_ns() - seen.st_ctime_ns > _SETTLED_NS
    return _settled_facts(path, stamp) if is_settled else hashed(path)


@lru_cache(1 << 16)
def _settled_facts(path: Path, _stamp: tuple[int, ...]) -> FileFacts:
    return hashed(path)


def files_below(folder: Path) -> dict[str, FileFacts]:
    """Size and hash of every file below a folder, by its name there."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): facts_of(path) for path in paths}


def digest_of(hashes: Mapping[str, str]) -> str:
    """sha256 over the hashes of files by name: equal where all of them are equal."""
    lines = "".join(f"{name} {sha256}\n" for name, sha256 in sorted(hashes.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


def hashed(path: Path) -> FileFacts:
    """Size and hash of a file, read anew."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return FileFacts(file.tell(), digest)


def _survey(folder: Path) -> Iterator[tuple[str, bool]]:
    """Every file below a folder, and whether it is ours."""
    names = _entries(folder)
    if names is None:
        yield "./", False
        return
    manifest = read(folder) or _NOTHING
    for name in names:
        yield from _look(folder, name, manifest)


def _look_below(folder: Path, name: str, manifest: OutputManifest) -> Iterator[tuple[str, bool]]:
    """As `_look`; a file or link where a folder above it should be is reported instead."""
    for parent in [above.as_posix() for above in list(Path(name).parents)[-2::-1]]:
        if os.path.lexists(folder / parent) and not _is_folder(folder / parent):
            yield parent, False
            return
    yield from _look(folder, name, manifest)


def _look(folder: Path, name: str, manifest: OutputManifest) -> Iterator[tuple[str, bool]]:
    path = folder / name
    if not _is_folder(path):
        if os.path.lexists(path):
            yield name, manifest.lists(folder, name) or _is_claim(path)
    elif os.path.ismount(path) or _entries(path) is None:
        yield f"{name}/", False
    elif name in manifest.parts:
        yield from ((f"{name}/{inner}", ours) for inner, ours in _survey(path))
    elif is_work_folder(path):
        yield from ((f"{name}/{inner}", True) for inner in _files_below(path))
    else:
        for inner in _entries(path) or ():
            yield from _look(folder, f"{name}/{inner}", manifest)


def _entries(folder: Path) -> list[str] | None:
    """The names in a folder; None if it cannot be looked into."""
    try:
        return sorted(path.name for path in folder.iterdir())
    except OSError:
        return None


def _files_below(folder: Path) -> list[str]:
    paths = (Path(parent, name) for parent, _, names in os.walk(folder) for name in names)
    return [path.relative_to(folder).as_posix() for path in paths]


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _is_leftover(path: Path) -> bool:
    """Whether a killed process left this before it wrote a manifest."""
    is_work = path.name.startswith(".") and path.name.endswith(".partial") and is_work_folder(path)
    return is_work or _is_claim(path)


def _is_claim(path: Path) -> bool:
    """Whether a file is a claim that a killed process left."""
    return _plain_size(path) == len(LOCK) and path.read_bytes() == LOCK


@contextmanager
def _updating(folder: Path) -> Iterator[OutputManifest]:
    """The manifest of a folder, which no other process changes meanwhile."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        manifest = read(folder) or _NOTHING
        if NAME not in manifest.unlisted and os.path.lexists(folder / NAME):
            raise InputError(
                f"{folder / NAME}: is damaged or of an older version: move it away, or choose "
                "another output"
            )
        arrived = {n: facts for n, facts in manifest.coming.items() if manifest.lists(folder, n)}
        beside = {n: facts_of(folder / n) for n in manifest.unlisted - {NAME}}
        yield replace(manifest, files={**manifest.files, **arrived, **beside}, coming={})
    finally:
        os.close(lock)


def _write(folder: Path, manifest: OutputManifest) -> None:
    content: dict[str, Any] = {"written_by": "eventsweep", "schema": _SCHEMA}
    content["files"] = {n: facts._asdict() for n, facts in sorted(manifest.files.items())}
    if manifest.coming:
        content["coming"] = {n: facts._asdict() for n, facts in sorted(manifest.coming.items())}
    if manifest.parts:
        content["parts"] = sorted(manifest.parts)
    write_text(folder / NAME, json.dumps(content, indent=1) + "\n")


def _json(path: Path) -> dict[str, Any]:
    """A JSON object in a plain file; empty for anything else."""
    try:
        content = json.loads(path.read_bytes()) if _plain_size(path) > 0 else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _plain_size(path: Path) -> int:
    """Bytes of a plain file; -1 for anything else."""
    try:
        seen = os.lstat(path)
    except (OSError, ValueError):
        return -1
    return seen.st_size if stat.S_ISREG(seen.st_mode) else -1
