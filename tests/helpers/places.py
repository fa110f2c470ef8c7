"""Where things lie: the checkout, its tests and pages, and the recordings beside it."""

import os
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HELPERS = ROOT / "tests" / "helpers"
HELPER_FOLDERS = tuple(map(str, (HELPERS, *sorted(HELPERS.glob("[a-z]*/")))))
"""Where a program of its own finds what tests share."""
TOOLS = ROOT / "tests" / "benchmarks"
SHARED = ROOT.parent / "shared"
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("plugins/*/*.md"))]
"""All pages of the documentation, those of plug-ins too."""
PLUGINS = ROOT / "plugins"
HAS_PLUGINS = PLUGINS.is_dir()
"""The core's tests pass without them, too."""
needs_plugins = pytest.mark.skipif(not HAS_PLUGINS, reason="about the plug-ins, too")

_WORDS = [
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen",
    "nineteen", "twenty",
]  # fmt: skip


def page(name: str) -> Path:
    """A page of the documentation by its file's name, wherever it lies."""
    return next(path for path in PAGES if path.name == name)


def of_absent_plug_ins() -> tuple[set[str], set[str]]:
    """Verbs and public names of plug-ins whose folders were taken out; both empty in a checkout."""
    doors = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    stub = (ROOT / "eventsweep" / "__init__.pyi").read_text("utf-8")
    verbs = {name for name, place in doors["eventsweep.verbs"].items() if _is_absent(place)}
    lines = re.findall(r"^from \.(plugins\.\S+) import (\w+)", stub, re.MULTILINE)
    return verbs, {name for place, name in lines if _is_absent(f"eventsweep.{place}")}


def _is_absent(place: str) -> bool:
    return not (PLUGINS / place.split(".")[2]).is_dir()


def with_tools() -> dict[str, str]:
    """The environment of a program that imports tools, and what tests share, by name."""
    tools = sorted(str(folder) for folder in TOOLS.iterdir() if folder.is_dir())
    search = [*HELPER_FOLDERS, *tools, os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, search))}


def numbers_in(page: Path, pattern: str) -> list[int]:
    """The numbers, in digits or words, that the groups of a pattern find on a page."""
    match = re.search(pattern, page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert match, f"{page.name} counts it no more: drop the test"
    return [
        int(word) if word.isdecimal() else _WORDS.index(word.lower()) for word in match.groups()
    ]
