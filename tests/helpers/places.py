"""Where things lie: the checkout, its tests, and the recordings beside it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HELPERS = ROOT / "tests" / "helpers"
TOOLS = ROOT / "tests" / "benchmarks"
SHARED = ROOT.parent / "shared"


def with_tools() -> dict[str, str]:
    """The environment of a program that imports tools, and what tests share, by name."""
    folders = sorted(str(folder) for folder in (HELPERS, *TOOLS.iterdir()) if folder.is_dir())
    search = [*folders, os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, search))}
