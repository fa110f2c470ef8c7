"""The manifest of an output folder: size and hash of every file that this program wrote into it.

What is listed and unchanged is ours, and may be replaced; everything else belongs to somebody. A
folder below that has a manifest of its own is a part of the output and says itself what is ours.
The manifest of a sequence, `manifest.json`, counts as one for the folder as a whole.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from eventsweep.emvs.utils.files import is_work_folder, move_aside, write_text

NAME = ".eventsweep.json"
_SEQUENCE = "manifest.json"
_SEQUENCE_KEYS = {"schema_version", "event_counts", "files"}
_SCHEMA = 1
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
        sequence: files of a sequence, each of which goes only with the whole.
        unlisted: files that are manifests themselves, and go with the whole.
    """

    files: Files = field(default_factory=dict)
    coming: Files = field(default_factory=dict)
    parts: frozenset[str] = frozenset()
    sequence: Files = field(default_factory=dict)
    unlisted: frozenset[str] = frozenset()

    def lists(self, folder: Path, name: str, *, whole: bool = False) -> bool:
        """Whether a file is ours and unchanged; `whole`: where all of the folder goes with it."""
        if whole and name in self.unlisted:
            return True
        listings = (self.files, self.coming, self.sequence if whole else {})
        known = [files[name] for files in listings if name in files]
        return any(_is_unchanged(folder / name, facts) for facts in known)


_NOTHING = OutputManifest()


def read(folder: Path) -> OutputManifest | None:
    """The manifest of a folder; None without one, or where it is damaged."""
    own, sequence = _json(folder / NAME), _json(folder / _SEQUENCE)
    known = _NOTHING
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        if sequence.keys() >= _SEQUENCE_KEYS:
            files = _parsed(sequence["files"])
            known = replace(known, sequence=files, unlisted=frozenset({_SEQUENCE}))
        if own.get("written_by") == "eventsweep" and own.get("schema") == _SCHEMA:
            files, coming = _parsed(own["files"]), _parsed(own.get("coming", {}))
            parts, unlisted = frozenset(map(str, own.get("parts", ()))), known.unlisted | {NAME}
            return OutputManifest(files, coming, parts, known.sequence, unlisted)
    return known if known.unlisted else None


def _parsed(files: dict[str, Any]) -> Files:
    return {n: FileFacts(int(f["bytes"]), str(f["sha256"])) for n, f in files.items()}


def complete(folder: Path) -> None:
    """Lists every file below a folder, all of them ours, that no manifest lists yet."""
    known = read(folder) or _NOTHING
    files, parts = dict(known.files), set(known.parts)
    for parent, below, names in os.walk(folder):
        at = Path(parent).relative_to(folder)
        if at.parts and read(Path(parent)) is not None:
            parts.add(at.as_posix())
            below.clear()
            continue
        listed = {*files, *known.sequence, *known.unlisted}
        new = {(at / name).as_posix() for name in names} - listed
        files |= {name: facts_of(folder / name) for name in new}
    if not known.unlisted or files != known.files or parts != known.parts:
        _write(folder, replace(known, files=files, parts=frozenset(parts)))


def add_part(folder: Path, name: str) -> None:
    """Lists a folder below, which has a manifest of its own, or will have when it appears."""
    with _updating(folder) as manifest:
        if name not in manifest.parts:
            _write(folder, replace(manifest, parts=manifest.parts | {name}))


@contextmanager
def listing(folder: Path, files: Files) -> Iterator[OutputManifest]:
    """Lists files that the caller puts into a folder within the context, whenever it is killed.

    Yields what was ours there before.
    """
    with _updating(folder) as before:
        _write(folder, replace(before, coming={**before.coming, **files}))
        yield before
        _write(folder, replace(before, files={**before.files, **files}))


def is_ours(path: Path) -> bool:
    """Whether the manifest of its folder lists a file by itself, unchanged."""
    manifest = read(path.parent)
    return manifest is not None and manifest.lists(path.parent, path.name)


def strangers(folder: Path) -> list[str]:
    """Names of what a folder holds that is not ours."""
    return sorted(name for name, ours in survey(folder) if not ours)


def survey(folder: Path) -> Iterator[tuple[str, bool]]:
    """Every file below a folder, and whether it is ours.

    Links, devices and mounted file systems never are; a folder that cannot be looked into stands
    for what it holds, with a slash. Empty folders hold nothing.
    """
    return _look(folder, "", read(folder) or _NOTHING)


def _look(folder: Path, at: str, manifest: OutputManifest) -> Iterator[tuple[str, bool]]:
    try:
        names = [f"{at}{path.name}" for path in sorted((folder / at).iterdir())]
    except OSError:
        yield at or "./", False
        return
    for name in names:
        path = folder / name
        if path.is_symlink() or not path.is_dir():
            yield name, manifest.lists(folder, name, whole=True)
        elif path.is_mount():
            yield f"{name}/", False
        elif name in manifest.parts:
            yield from ((f"{name}/{inner}", ours) for inner, ours in survey(path))
        elif is_work_folder(path):
            yield from ((f"{name}/{inner}", True) for inner in _files_below(path))
        else:
            yield from _look(folder, f"{name}/", manifest)


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


def _is_unchanged(path: Path, facts: FileFacts) -> bool:
    return facts.bytes == _plain_size(path) and facts_of(path) == facts


def files_below(folder: Path) -> dict[str, FileFacts]:
    """Size and hash of every file below a folder, by its name there."""
    return {name: facts_of(folder / name) for name in _files_below(folder)}


def _files_below(folder: Path) -> list[str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return [path.relative_to(folder).as_posix() for path in paths]


def digest_of(hashes: Mapping[str, str]) -> str:
    """sha256 over the hashes of files by name: equal where all of them are equal."""
    lines = "".join(f"{name} {sha256}\n" for name, sha256 in sorted(hashes.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


def hashed(path: Path) -> FileFacts:
    """Size and hash of a file, read anew."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return FileFacts(file.tell(), digest)


@contextmanager
def _updating(folder: Path) -> Iterator[OutputManifest]:
    """The manifest of a folder, which no other process changes meanwhile."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        known = read(folder) or _NOTHING
        if NAME not in known.unlisted and os.path.lexists(folder / NAME):
            move_aside(folder / NAME, folder / NAME, "is damaged, or of another version")
        coming = known.coming.items()
        arrived = {name: facts for name, facts in coming if _is_unchanged(folder / name, facts)}
        yield replace(known, files={**known.files, **arrived}, coming={})
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
