"""JSON files of this program: read with one line for whatever is wrong, written a row a line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from eventsweep.emvs.errors import InputError, quoted, said
from eventsweep.emvs.parameters import first_fault
from eventsweep.emvs.utils.inputs import TABLE_BYTES, parse_json, read_text

Read = TypeVar("Read")


def read_json(
    file: Path, validate: Callable[[Any], Read], versions: tuple[int, ...], cure: str,
    name: str = "",
) -> Read:  # fmt: skip
    """Reads a JSON file that this program wrote.

    Args:
        file: its path.
        validate: makes the result of the file's content; raises pydantic's error or `InputError`
            where it cannot.
        versions: the values of `schema_version` that can be read; empty where it has none.
        cure: what to do where the file cannot be used, in words.
        name: how errors call the file, if not by its path.
    """
    name = name or str(file)
    try:
        text = read_text(file, TABLE_BYTES)
    except OSError as error:
        raise InputError(f"{name}: cannot be read ({error.strerror}); {cure}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: not a text in UTF-8 ({error.reason}); {cure}") from error
    if not text.strip():
        raise InputError(f"{name}: is empty; {cure}")
    try:
        content = parse_json(text)
    except ValueError as error:
        raise InputError(f"{name}: not complete JSON ({error}); {cure}") from error
    stored = content.get("schema_version") if isinstance(content, dict) else None
    if versions and stored not in versions:
        known = " and ".join(map(str, versions))
        raise InputError(
            f"{name}: schema version {quoted(stored)}, but this program reads {known}; {cure} with "
            "this version"
        )
    try:
        return validate(content)
    except ValidationError as error:
        raise InputError(f"{name}: {first_fault(error)}; {cure}") from error
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: {said(error, 400)}; {cure}") from error


def json_text(content: dict[str, Any], table: str, indent: int = 1) -> str:
    """JSON in which the objects of one list, put last, take a line each."""
    pad = " " * indent
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) for row in content.pop(table)]
    head = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    body = f",\n{pad * 2}".join(lines)
    filled = f"\n{pad * 2}{body}\n{pad}" if lines else ""
    return f'{head.removesuffix(f"{chr(10)}}}")},\n{pad}"{table}": [{filled}]\n}}\n'
