"""What is refused ends in one line, of a call or of a command, and all is left as it was."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from eventsweep.emvs.errors import InputError


def line_of(call, /, *arguments, **settings) -> str:
    """The one line with which a call refuses its input; what it shows can be printed."""
    __tracebackhide__ = True
    line = refused("", call, *arguments, **settings)
    assert line.isprintable(), line
    return line


def refused(words, call, /, *arguments, **settings) -> str:
    """The one line with which a call refuses its input, and which holds the words.

    These are a pattern, or several that it must all hold; a path stands for itself.
    """
    __tracebackhide__ = True
    with pytest.raises(InputError) as caught:
        call(*arguments, **settings)
    line = str(caught.value)
    assert len(line.splitlines()) == 1, line
    for word in words if isinstance(words, (list, tuple)) else [words]:
        pattern = word if isinstance(word, str) else re.escape(str(word))
        assert re.search(pattern, line), f"{word} is not in: {line}"
    return line


def command_refused(capsys, *words, errno=False) -> str:
    """The one line of a command that must fail: code 2, nothing printed, no raw error number."""
    from eventsweep.eval.cli.main import main

    capsys.readouterr()
    assert main([str(word) for word in words]) == 2
    out, line = capsys.readouterr()
    assert out == ""
    assert line.startswith("eventsweep: ")
    assert line.count("\n") == 1, line
    assert errno or "Errno" not in line
    return line


def contents(folder: Path) -> dict[Path, bytes | str]:
    """Every file's bytes, and every folder, below one."""
    return {path: path.read_bytes() if path.is_file() else "folder" for path in folder.rglob("*")}


@contextmanager
def untouched(folder: Path) -> Iterator[None]:
    """Nothing below the folder is made, changed, written anew or removed meanwhile."""

    def state():
        return contents(folder), {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}

    before = state()
    yield
    assert state() == before


def all_bytes(folder: Path) -> dict[str, bytes]:
    """The content of every file below a folder, by its path in it."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
