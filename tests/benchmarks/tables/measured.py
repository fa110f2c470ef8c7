"""The list `docs/measured.toml`: by which code, and at which commit, each generated table was made.

Whatever writes a table writes its line, see `markdown_blocks`; `stale_tables` reads it.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import subprocess
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from table_code import EXACT, Code

UNKNOWN = "unknown"
_PLACE = Path("docs", "measured.toml")
_HEAD = "# Written by the tools that write tables: of which code and commit the numbers are.\n"
Entry = dict[str, str]


def checkout_of(page: Path) -> Path | None:
    """The folder of the checkout in which a page lies, if that keeps a list."""
    above = page.resolve().parents
    return next((folder for folder in above if (folder / _PLACE).is_file()), None)


@contextmanager
def one_writer(page: Path) -> Iterator[None]:
    """Keeps other tools from the pages and the list of a checkout meanwhile."""
    root = checkout_of(page)
    if root is None:
        yield
        return
    lock = os.open(root / _PLACE.parent, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def key_of(page: Path, mark: str) -> str:
    """A table's name in the list; of a page in no checkout, that of the page alone."""
    root = checkout_of(page)
    return f"{page.resolve().relative_to(root).as_posix() if root else page.name}#{mark}"


def entries(root: Path) -> dict[str, Entry]:
    """The list, by page and mark.

    Raises:
        InputError: there is none, or a damaged one.
    """
    try:
        return tomllib.loads((root / _PLACE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{root / _PLACE}: {error}; restore it with git") from error


def record(page: Path, mark: str, declared: Callable[[], Mapping[str, Code]]) -> None:
    """Notes that a table was just made; a page in no checkout keeps no list.

    A table of committed data is as old as the data: its line stays while they do.

    Raises:
        InputError: its tool does not declare what it depends on.
    """
    root = checkout_of(page)
    if root is None:
        return
    known, key = entries(root), key_of(page, mark)
    code = declared().get(key)
    if code is None:
        raise InputError(f"{key}: no such table; declare its code in `code` of the tool")
    if code.data in known:
        write(root, {**known, key: known[code.data]})
        return
    made = {"code": code.digest(root)}
    if made["code"] != EXACT:
        made["commit"] = commit(root)
    if code.data:
        made["data"] = _hash_of(root / code.data)
    if not code.data or known.get(key, {}).get("data") != made["data"]:
        write(root, {**known, key: made})


def write(root: Path, known: dict[str, Entry]) -> None:
    """Writes the list, a line per table."""
    lines = [
        f'"{key}" = {{ ' + ", ".join(f'{name} = "{text}"' for name, text in one.items()) + " }\n"
        for key, one in sorted(known.items())
    ]
    with atomic_path(root / _PLACE) as partial:
        partial.write_text(_HEAD + "".join(lines), encoding="utf-8")


def commit(root: Path) -> str:
    """The checked-out commit, with a `+` where code is changed beside it; unknown without git."""
    head = git(root, "rev-parse", "--short=8", "HEAD").strip()
    changed = git(root, "status", "--porcelain", "--", "*.py", "*.xml", "pyproject.toml")
    return f"{head}{'+' if changed.strip() else ''}" if head else UNKNOWN


def git(root: Path, *words: str) -> str:
    """What git prints; nothing where it fails."""
    command = ["git", "-C", str(root), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout if done.returncode == 0 else ""


def _hash_of(file: Path) -> str:
    if not file.is_file():
        raise InputError(f"{file}: no such file; the table is made of it")
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
