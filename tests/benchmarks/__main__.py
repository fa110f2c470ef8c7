"""Runs a developer tool by its name: `python tests/benchmarks NAME ...`; without one, lists them.

The tools lie in folders by what they are about; they import each other, and what tests share, by
name.
"""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FOLDERS = sorted({path.parent for path in HERE.glob("*/*.py")})


def tools() -> dict[str, Path]:
    """Programs by name: modules that run something when they are started."""
    found = {path.stem: path for folder in FOLDERS for path in sorted(folder.glob("*.py"))}
    return {name: path for name, path in found.items() if "__main__" in path.read_text("utf-8")}


def main() -> None:
    """Runs the tool, as if its own file had been started."""
    known = tools()
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in known:
        sys.stderr.write(f"no tool {name!r}; " * bool(name) + "python tests/benchmarks NAME ...\n")
        for path in known.values():
            words = (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").splitlines()
            sys.stderr.write(f"  {path.parent.name}/{path.stem:<20} {words[0] if words else ''}\n")
        sys.exit(2)
    beside = [HERE.parent / "helpers", *HERE.parent.glob("helpers/*/"), HERE.parent / "reference"]
    shared = *beside, *ROOT.glob("plugins/*/tests")
    sys.path[:1] = [str(folder) for folder in (*FOLDERS, *shared)]
    sys.argv[:2] = [str(known[name])]
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
