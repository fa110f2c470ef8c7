"""From the parameters that libraries name in their messages to the flags of the verb that runs.

A library says `set unit to 'ns'`, `set force=True`, `resume=False` or `replay.imu_cam`. Where the
verb has such a flag, the command line names it; where it has none, the library's words stay.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from eventsweep.emvs.errors import InputError

_OPPOSITES = {"resume=False": "fresh"}
"""Flags that say the opposite of a parameter."""
_NAMED = re.compile(
    r"(?P<set>\bset )?(?<![\w./-])(?P<name>[a-z]\w*(?:\.[a-z]\w*)*)"
    r"(?P<value>=True|=False)?(?P<to> to\b)?"
)

_running: list[Callable[[], Iterable[Any]]] = []
"""What gives the flags of the verb that runs; asked for only where a message needs them."""


def runs(flags: Callable[[], Iterable[Any]]) -> None:
    """Notes the verb that runs: a function that gives its arguments as cyclopts describes them."""
    _running[:] = [flags]


def with_flags(said: str | InputError) -> str:
    """A library's message with the command line's flags in place of parameters."""
    words, parameter = str(said), said.parameter if isinstance(said, InputError) else ""
    if not _running or not (parameter or _NAMED.search(words)):
        return words
    flags = _flags(_running[0]())
    if parameter and words.startswith(f"{parameter} "):
        flag = flags.get(parameter, f"--{parameter.replace('_', '-')}")
        words = flag + words.removeprefix(parameter)
    return _NAMED.sub(lambda match: _flag(match, flags), words)


def _flags(arguments: Iterable[Any]) -> Mapping[str, str]:
    """Flags by the names that libraries have for them: whole, and without the first table."""
    names = [name for argument in arguments for name in argument.names if name.startswith("--")]
    whole = {name[2:].replace("-", "_"): name for name in names}
    shorter = {key.partition(".")[2]: name for key, name in whole.items() if "." in key}
    return {**shorter, **whole}


def _flag(match: re.Match[str], flags: Mapping[str, str]) -> str:
    """A parameter that is set, given a value or of a group becomes its flag; other words stay."""
    name, value, to = match["name"], match["value"] or "", match["to"] or ""
    name = _OPPOSITES.get(name + value, name)
    is_meant = match["set"] or value or "." in name
    if not is_meant or name not in flags:
        return match[0]
    if match["set"] and to and not value:
        return f"say {flags[name]}"
    return f"{'add ' if match['set'] else ''}{flags[name]}{to}"
