"""Runs the notebooks of the documentation, and stores what they show with the hash of their code.

`python tests/benchmarks run_notebooks` needs the extra `docs`; with `--check` it only says whose
outputs are those of older code.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

FOLDER = Path("docs/notebooks")
TIMEOUT_S = 600  # of one cell, on a busy machine


def code_of(notebook: dict[str, Any]) -> Iterator[str]:
    """The code of a notebook, cell by cell."""
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            yield "".join(cell["source"])


def digest(notebook: dict[str, Any]) -> str:
    """The hash of a notebook's code."""
    return hashlib.sha256("\n\n".join(code_of(notebook)).encode()).hexdigest()


def stored_digest(notebook: dict[str, Any]) -> str:
    """The hash of the code whose outputs are stored; empty where none are."""
    return str(notebook["metadata"].get("eventsweep", {}).get("code_sha256", ""))


def run(path: Path) -> None:
    """Runs a notebook in a folder of its own, and writes it with its outputs."""
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)  # type: ignore[no-untyped-call]
    with TemporaryDirectory() as folder:
        client = NotebookClient(
            book, timeout=TIMEOUT_S, record_timing=False, coalesce_streams=True,
            resources={"metadata": {"path": folder}},
        )  # fmt: skip
        client.execute()
    book.metadata["language_info"] = {"name": "python"}  # no version: it says nothing here
    book.metadata["eventsweep"] = {"code_sha256": digest(book)}
    text = nbformat.writes(book)  # type: ignore[no-untyped-call]
    path.write_text(text + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs or checks notebooks; 1 where a check finds a stale one."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks run_notebooks", description=__doc__
    )
    parser.add_argument("notebooks", type=Path, nargs="*", help="default: all")
    parser.add_argument("--check", action="store_true", help="run nothing")
    asked = parser.parse_args(arguments)
    paths = asked.notebooks or sorted(FOLDER.glob("*.ipynb"))
    if not asked.check:
        for path in paths:
            run(path)
        return 0
    books = {path: json.loads(path.read_text(encoding="utf-8")) for path in paths}
    stale = [path for path, book in books.items() if stored_digest(book) != digest(book)]
    for path in stale:
        sys.stderr.write(f"{path}: stale: python tests/benchmarks run_notebooks {path}\n")
    return int(bool(stale))


if __name__ == "__main__":
    sys.exit(main())
