"""Packages of others, as an installer leaves them: from what a page prints, or made up."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

from places import ROOT
from programs import python


def documented(page: Path, heading: str) -> list[str]:
    """The first pyproject.toml and the first module below a heading of a page."""
    section = page.read_text("utf-8").partition(heading)[2]
    return [
        re.search(rf"```{kind}\n(.*?)```", section, re.DOTALL)[1] for kind in ("toml", "python")
    ]


def install(folder: Path, project: str, module: str) -> None:
    """Puts a package, whose module is `NAME/eventsweep.py`, into a folder of packages."""
    facts = tomllib.loads(project)["project"]
    name, version = facts["name"], facts["version"]
    (folder / name).mkdir()
    (folder / name / "__init__.py").touch()
    (folder / name / "eventsweep.py").write_text(module)
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, points in facts["entry-points"].items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in points.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


def run_with(packages: Path, folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """Runs `eventsweep` in a folder, where the packages are installed."""
    return python("-m", "eventsweep", *words, path=[ROOT, packages], cwd=folder)
