"""Finds the files of a data set by the names that its publisher gives them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from eventsweep.emvs.errors import InputError


def find_one(folder: Path, patterns: Iterable[str], what: str) -> Path:
    """The one file that matches; the first pattern that matches decides."""
    patterns = tuple(patterns)
    found = find_optional(folder, patterns, what)
    if found is None:
        raise InputError(f"{folder}: lacks {what}; needs {' or '.join(patterns)}")
    return found


def find_optional(folder: Path, patterns: Iterable[str], what: str) -> Path | None:
    """The one file that matches, or None."""
    for pattern in patterns:
        found = sorted(path for path in folder.glob(pattern) if path.is_file())
        if len(found) > 1:
            names = ", ".join(path.name for path in found[:4])
            raise InputError(
                f"{folder}: {len(found)} candidates for {what} ({names}); keep one, or name it in "
                "a recording.toml"
            )
        if found:
            return found[0]
    return None
