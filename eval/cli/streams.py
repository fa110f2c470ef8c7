"""The standard streams of a command: never broken, and nothing printed commands a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast

from eventsweep.emvs.errors import InputError, visible


class _Unbroken:
    """A standard stream that may be closed, broken, full, or know few letters.

    Who reads no more, as `head` does, ends nothing: the work is done, and its code is its own.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream or open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        if getattr(self._stream, "errors", "") == "strict":
            with suppress(AttributeError):
                self._stream.reconfigure(errors="backslashreplace")  # type: ignore[attr-defined]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Writes as a text stream does, to nowhere once nobody reads."""
        with self._unbroken():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Writes what is kept back."""
        with self._unbroken():
            self._stream.flush()

    @contextmanager
    def _unbroken(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            if not isinstance(error, BrokenPipeError):
                raise InputError(
                    f"{self._stream.name}: cannot be written ({error.strerror}): free the disk or "
                    "write elsewhere"
                ) from error


class _Escaping:
    """A stream on which nothing that is written commands a terminal; `rich` goes past it."""

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        """Writes a text as `visible` has it."""
        return self.rich_proxied_file.write(visible(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


@contextmanager
def standard_streams() -> Iterator[None]:
    """Guards what is printed: no text of data commands a terminal, and no stream ends the work."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        cast(TextIO, _Escaping(cast(TextIO, _Unbroken(stream)))) for stream in before
    )
    try:
        yield
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        sys.stdout, sys.stderr = before
