"""What in a folder is this program's own work: outputs are known by their markers, files by name.

A folder of ours may be replaced, because the same command makes it again; anything else in it
belongs to somebody. So everything that is written into a folder must be explained here.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.files import atomic_path

MARKER = ".eventsweep.json"
"""The marker of folders in which no file is known to be ours by its name: written by `mark`."""

_PAGE, _PAGE_BYTES = b"<title>eventsweep \xc2\xb7 ", 4096
# What a kill leaves of something that was being written.
_LEFT = r"(?:[^/]+/)*\.[^/]+\.\w{8}\.partial(?:\.\w+)?(?:/.*)?"
# Where `files_together` keeps files until all are there: what lies in it says whose the others are.
_HIDDEN = ".*.????????.partial"
_WINDOW_FILES = ("window.json", "slices.npz", "events.npz")
_METHOD_FILES = ("depth.npz", "dense.npz", "cloud.ply")
_FUSED_FILES = ("fuse.json", "cloud.ply", "mesh.ply")
_MOST_NAMED = 3

Patterns = Iterator[str]


def strangers(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """What a folder holds that no output of ours explains: names below it, folders with a slash.

    Links, devices, empty folders and mounted file systems are never ours.

    Args:
        folder: an output, or what is in its place.
        names: only look at these files and folders in it.
    """
    owned = _ours(folder)
    if owned is None and names is None:
        return _listing(folder)
    found = _walk(folder) if names is None else chain.from_iterable(_at(folder, n) for n in names)
    return [
        name for name, plain in sorted(found) if not (plain and owned and owned.fullmatch(name))
    ]


def remove_ours(folder: Path) -> list[str]:
    """Removes what is ours in a folder, and the folder if that was all; returns what is left."""
    entries = list(_walk(folder))
    owned = _ours(folder)
    left = []
    for name, plain in entries:
        if plain and owned and owned.fullmatch(name):
            (folder / name).unlink(missing_ok=True)
        else:
            left.append(name)
    for parent, _, _ in os.walk(folder, topdown=False):
        try:
            Path(parent).rmdir()
        except OSError:  # somebody's file is in it
            continue
    return sorted(left)


def named(names: list[str]) -> str:
    """The first few names, as an error shows them."""
    shown = [name if name.isprintable() else ascii(name) for name in names[:_MOST_NAMED]]
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(shown) + more


def mark(folder: Path, beside: Path | None = None) -> None:
    """Writes into a folder which files in it are ours; `strangers` then knows them.

    Args:
        folder: with the files in it, all of them ours.
        beside: the folder that they will be put into, whose own marked files stay marked.
    """
    written = [name for name, _ in _walk(folder)]
    before = _json(beside / MARKER).get("files") if beside is not None else None
    files = before if isinstance(before, dict) else {}
    files |= {name: _size(folder, name) for name in written if name != MARKER}
    text = json.dumps({"written_by": "eventsweep", "files": dict(sorted(files.items()))}, indent=1)
    with atomic_path(folder / MARKER) as path:
        path.write_text(text + "\n", encoding="utf-8")


def is_our_file(path: Path) -> bool:
    """Whether a file says itself that we wrote it: a page, a result, a table, a gate's verdicts."""
    read = _READERS.get(path.suffix)
    return read is not None and _is_plain(path) and read(path)


def _walk(folder: Path, below: str = "") -> Iterator[tuple[str, bool]]:
    """Every entry that is no folder, and whether it is a plain file; folders that are empty."""
    try:
        entries = list(os.scandir(folder / below))
    except OSError:  # what cannot be looked into cannot be known
        yield f"{below}/", False
        return
    for entry in entries:
        yield from _at(folder, f"{below}/{entry.name}" if below else entry.name)
    if not entries and below:
        yield f"{below}/", False


def _at(folder: Path, name: str) -> Iterator[tuple[str, bool]]:
    try:
        mode = os.lstat(folder / name).st_mode
    except OSError:  # gone meanwhile
        return
    if not stat.S_ISDIR(mode):
        yield name, stat.S_ISREG(mode)
    elif os.path.ismount(folder / name):
        yield f"{name}/", False
    else:
        yield from _walk(folder, name)


def _listing(folder: Path) -> list[str]:
    """The names right in a folder."""
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return ["./"]
    return sorted(one.name + "/" * one.is_dir(follow_symlinks=False) for one in entries)


def _ours(folder: Path) -> re.Pattern[str] | None:
    """The names that are ours in a folder; None without a marker."""
    patterns = list(_owned(folder))
    return re.compile("|".join(f"(?:{one})" for one in (*patterns, _LEFT))) if patterns else None


def _owned(folder: Path) -> Patterns:
    for kind in _KINDS:
        yield from kind(folder)
    if _is_plain(folder / "config.toml") and is_our_file(folder / "results.json"):
        yield re.escape("config.toml")
        for part in sorted(folder.glob("*/sequence")) + sorted(folder.glob("*/map")):
            yield from _below(part.relative_to(folder).as_posix(), (_sequence(part), _map(part)))


def _below(name: str, patterns: tuple[Patterns, ...]) -> Patterns:
    for kind in patterns:
        yield from (f"{re.escape(name)}/(?:{pattern})" for pattern in kind)


def _sequence(folder: Path) -> Patterns:
    manifest = _json(folder / "manifest.json")
    files = manifest.get("files")
    if isinstance(files, dict) and {"schema_version", "event_counts"} <= manifest.keys():
        yield from map(re.escape, ("manifest.json", *files))


def _marked(folder: Path) -> Patterns:
    for path in (folder / MARKER, *folder.glob(f"{_HIDDEN}/{MARKER}")):
        marker = _json(path)
        files = marker.get("files")
        if isinstance(files, dict) and marker.get("written_by") == "eventsweep":
            yield re.escape(MARKER)
            alike = (name for name, size in files.items() if _size(folder, name) == size)
            yield from map(re.escape, alike)


def _map(folder: Path) -> Patterns:
    index = _json(folder / "map.json")
    if not {"schema_version", "recording", "config", "windows"} <= index.keys():
        return
    yield re.escape("map.json")
    entries = {path.parent.name: _json(path) for path in folder.glob("w*/window.json")}
    listed = index["windows"] if isinstance(index["windows"], list) else []
    entries |= {str(one.get("name")): one for one in listed if isinstance(one, dict)}
    every: set[str] = set()
    for name, entry in entries.items():
        methods = _methods(entry)
        every |= set(methods)
        yield f"{re.escape(name)}/(?:{_window(methods)})"
    for method in sorted(every):
        yield f"global/{re.escape(method)}/{_one_of(_FUSED_FILES)}"
    yield from _report(folder)


def _methods(entry: dict[str, Any]) -> list[str]:
    methods = entry.get("methods")
    return [str(name).replace("/", "-") for name in methods] if isinstance(methods, list) else []


def _window(methods: list[str]) -> str:
    folders = _one_of(methods)
    parts = (_one_of(_WINDOW_FILES), f"{folders}/{_one_of(_METHOD_FILES)}", rf"dsi/{folders}\.npy")
    return "|".join(parts)


def _fused(folder: Path) -> Patterns:
    if {"method", "window_points"} <= _json(folder / "fuse.json").keys():
        yield _one_of(_FUSED_FILES)


def _report(folder: Path) -> Patterns:
    if is_our_file(folder / "results.json"):
        yield _one_of(("results.json", "results.csv"))
    if is_our_file(folder / "report.html"):
        yield _one_of(("report.html", "overview.png", "recording.rrd"))


def _suite(folder: Path) -> Patterns:
    if is_our_file(folder / "suite.json"):
        yield _one_of(("suite.json", "suite.csv"))  # its pictures are marked


def _comparison(folder: Path) -> Patterns:
    if is_our_file(folder / "compare.html"):
        yield re.escape("compare.html")


def _ranking(folder: Path) -> Patterns:
    if is_our_file(folder / "ranking.json"):
        yield _one_of(("ranking.json", "index.html"))  # its pictures are marked


def _studies(folder: Path) -> Patterns:
    for path in (*folder.glob("*.json"), *folder.glob(f"{_HIDDEN}/*.json")):
        if {"study", "breaks_at"} <= _json(path).keys():
            yield rf"{re.escape(path.stem)}\.(?:json|csv|png|svg)"


def _parts(folder: Path) -> Patterns:
    for name in ("tables", "figures", "predictions", "pictures"):
        yield from _below(name, (_marked(folder / name),))


_KINDS: tuple[Callable[[Path], Patterns], ...] = (
    _sequence, _marked, _map, _fused, _report, _suite, _comparison, _ranking, _studies,
    _parts,
)  # fmt: skip


def _is_our_json(path: Path) -> bool:
    content = _json(path).keys()
    rows = (
        {"rows", "configuration"},
        {"suite", "samples"},
        {"study", "breaks_at"},
        {"entries", "ranked_by"},
    )
    return any(keys <= content for keys in rows)


def _starts(*words: bytes) -> Callable[[Path], bool]:
    def read(path: Path) -> bool:
        try:
            with path.open("rb") as file:
                start = file.read(_PAGE_BYTES)
        except OSError:
            return False
        return any(word in start for word in words)

    return read


_READERS: dict[str, Callable[[Path], bool]] = {
    ".json": _is_our_json,
    ".html": _starts(_PAGE),
    ".xml": _starts(b'<testsuite name="eventsweep gate"'),
    ".md": _starts(b"### eventsweep gate"),
    ".csv": _starts(b"case,seed,window,method,metric,value"),
}


def _one_of(names: tuple[str, ...] | list[str]) -> str:
    return f"(?:{'|'.join(map(re.escape, names)) or '(?!)'})"


def _json(path: Path) -> dict[str, Any]:
    """A JSON object in a plain file; empty for anything else."""
    if not _is_plain(path):
        return {}
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _is_plain(path: Path) -> bool:
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except (OSError, ValueError):
        return False


def _size(folder: Path, name: str) -> int:
    try:
        return os.lstat(folder / name).st_size
    except (OSError, ValueError):
        return -1
