"""Finds the files of a data set by the names that its publisher gives them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from eventsweep.emvs.errors import InputError


def find_one(folder: Path, patterns: Iterable[str], what: str) -> Path:
    """The one file that matches; the first pattern that matches decides."""
    patterns = tuple(patterns)
    match = find_optional(folder, patterns, what)
    if match is None:
        raise InputError(f"{folder}: lacks {what}; needs {' or '.join(patterns)}")
    return match


def find_optional(folder: Path, patterns: Iterable[str], what: str) -> Path | None:
    """The one file that matches, or None."""
    for pattern in patterns:
        matches = sorted(path for path in folder.glob(pattern) if path.is_file())
        if len(matches) > 1:
            names = ", ".join(path.name for path in matches[:4])
            raise InputError(
                f"{folder}: {len(matches)} candidates for {what} ({names}); keep one, or name it "
                "in a recording.toml"
            )
        if matches:
            return matches[0]
    return None
