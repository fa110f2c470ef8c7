"""Addresses such as `s3://bucket/run` in the place of paths: which commands take them, and where.

A command works in the address's mirror; what it makes there is sent when it has ended well.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import fields, is_dataclass
from functools import partial
from inspect import BoundArguments
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.address import address_of, is_address, named

Opened = Callable[[Path], AbstractContextManager[Path]]
_BESIDE = ".eventsweep-next"  # the end of a hidden folder's name, of what takes an output's place
_WITHIN = ".eventsweep-making"


def _read(path: Path) -> AbstractContextManager[Path]:
    from eventsweep.emvs.utils.mirror import fetched

    return nullcontext(fetched(path))


def _changed(path: Path) -> AbstractContextManager[Path]:
    from eventsweep.emvs.utils.mirror import changed

    return changed(path)


def _made(path: Path) -> AbstractContextManager[Path]:
    from eventsweep.emvs.utils.mirror import made
    from eventsweep.eval.cli.replaced import check_free

    check_free(path)
    return made(path)


def _replaced(path: Path, inputs: Iterable[str]) -> AbstractContextManager[Path]:
    from eventsweep.eval.cli.replaced import replaced

    folder, _, name = str(address_of(path)).rpartition("/")
    return replaced(path, f"{folder}/.{name}{_BESIDE}/{name}", inputs)


@contextmanager
def _within(opened: Opened, path: Path) -> Iterator[Path]:
    """A folder within a mirror, for commands that read what they wrote beside their output.

    Beside the mirror that would stand for another address.
    """
    with opened(path) as mirror:
        place = mirror / _WITHIN / mirror.name
        yield place
        for old in set(mirror.iterdir()) - {place.parent}:  # of one that was ended before it sent
            if old.is_dir() and not old.is_symlink():
                shutil.rmtree(old)
            else:
                old.unlink()
        for new in place.iterdir():
            new.rename(mirror / new.name)
        with suppress(OSError):  # another run for this address may be at work there
            place.rmdir()
            place.parent.rmdir()


_TAKEN: Mapping[str, Mapping[str, Opened]] = {
    "info": {"path": _read},
    "map": {"recording": _read, "out": _made},
    "report": {"folder": _changed},
    "score": {"scored": _changed},
    "run": {"out": _made},
    "simulate": {"out": _made},
    "suite": {"out": _made},
}
"""How arguments of commands are opened at addresses."""
_WORK_BESIDE = {"run"}


def shown(text: str) -> str:
    """A text with addresses in the place of their mirrors, also of what is to take their place."""
    text = re.sub(rf"([^/]+)/{re.escape(_WITHIN)}/\1", r"\1", named(text))
    return re.sub(rf"\.([^/]+){re.escape(_BESIDE)}/\1", r"\1", text)


def with_addresses(command: Callable[..., Any], bound: BoundArguments) -> Callable[..., Any]:
    """A command that works in the mirrors of the addresses among its arguments.

    Raises:
        InputError: an address where the command takes none.
    """
    verb = getattr(command, "__name__", "").replace("_", "-")
    taken = _TAKEN.get(verb, {})
    mirrored = {}
    for name, value in bound.arguments.items():
        alone = value[0] if name == "scored" and len(value) == 1 else value
        if name in taken and isinstance(alone, str | Path) and is_address(alone):
            mirrored[name] = str(address_of(alone))
            continue
        for address in _addresses(value):
            raise InputError(f"{address}: {_refusal(verb, taken, address, name)}")
    if not mirrored:
        return command

    def in_mirrors(*_arguments: Any, **_named: Any) -> Any:
        with ExitStack() as stack:
            for name, address in mirrored.items():
                opened = taken[name]
                if opened is _made and bound.arguments.get("force"):
                    inputs = [one for other, one in mirrored.items() if other != name]
                    opened = partial(_replaced, inputs=inputs)
                if opened is not _read and verb in _WORK_BESIDE:
                    opened = partial(_within, opened)
                place = stack.enter_context(opened(Path(address)))
                bound.arguments[name] = (str(place),) if name == "scored" else place
            return command(*bound.args, **bound.kwargs)

    return in_mirrors


def _refusal(verb: str, taken: Mapping[str, Opened], address: str, name: str) -> str:
    known = " and ".join(taken)
    which = f"addresses only for {known}" if known else "no addresses"
    how = ", with `aws s3 cp --recursive` for example" if address.startswith("s3:") else ""
    if name == "out":
        return f"`{verb}` takes {which}: choose a folder here, and copy it there afterwards{how}"
    return f"`{verb}` takes {which}: copy it to this machine first{how}, and name the copy"


def _addresses(value: Any) -> Iterator[str]:
    """Addresses among paths, in groups of settings and lists of them, too."""
    if isinstance(value, Path):
        if is_address(value):
            yield str(address_of(value))
    elif isinstance(value, tuple | list):
        for one in value:
            yield from _addresses(one)
    elif isinstance(value, BaseModel):
        yield from _addresses(list(vars(value).values()))
    elif is_dataclass(value) and not isinstance(value, type):
        yield from _addresses([getattr(value, field.name) for field in fields(value)])
