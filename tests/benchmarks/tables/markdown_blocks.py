"""What commands write into pages: the text between two marks is theirs, the rest is not.

With the text goes a line in `docs/measured.toml`, of the code that the tool declares (`measured`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from measured import one_writer, record
from table_code import Code

_STALE = 1
Tables = Callable[[], Mapping[str, Code]]
"""A tool's `code`: page and mark -> what its numbers depend on."""


def with_block(page: str, mark: str, block: str, where: str = "the page") -> str:
    """A page's text with the block between its marks of that name.

    Raises:
        InputError: the page, called `where`, lacks the marks.
    """
    first, last = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not begin or not end:
        raise InputError(f"{where} needs the lines {first} and {last}")
    return f"{before}{begin}\n\n{block}\n{end}{after}"


def into_page(page: Path, mark: str, block: str, code: Tables) -> None:
    """Puts a text between the page's two marks of that name, and notes its code.

    Raises:
        InputError: no such page, one without the marks, or one that `code` does not declare.
    """
    with one_writer(page):
        _write(page, with_block(_read(page), mark, block, f"{page}:"))
        record(page, mark, code)


def show(text: str, page: Path | None, mark: str, code: Tables) -> None:
    """Prints a text and, where a page is given, puts it between the page's marks."""
    sys.stdout.write(text)
    if page is not None:
        into_page(page, mark, text, code)


def refresh(page: Path, mark: str, block: str, code: Tables, *, check: bool, command: str) -> int:
    """Brings a page's block up to date; with `check` only says whether it is.

    Args:
        page: the page.
        mark: name of its marks.
        block: what should stand between them.
        code: the tool's declarations.
        check: whether to write nothing.
        command: what writes it, for the message.

    Returns:
        1 where a check finds the block stale, else 0.

    Raises:
        InputError: no such page, or one without the marks.
    """
    before = _read(page)
    if not check:
        into_page(page, mark, block, code)
    elif before != with_block(before, mark, block):
        sys.stderr.write(f"{page}: its table is stale; run `{command}`\n")
        return _STALE
    return 0


def _read(page: Path) -> str:
    if not page.is_file():
        raise InputError(f"{page}: no such file; run this in the project's folder")
    return page.read_text(encoding="utf-8")


def _write(page: Path, text: str) -> None:
    with atomic_path(page) as partial:
        partial.write_text(text, encoding="utf-8")
