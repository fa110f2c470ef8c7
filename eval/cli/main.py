"""The command line: one program, a verb per stage, and `run` for all of them.

A plug-in offers a verb as a function, whose parameters are flags, or as a program of cyclopts:

    [project.entry-points."eventsweep.verbs"]
    mine = "my_package.verb:mine"
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import EntryPoint
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.parameters import fault
from eventsweep.emvs.utils.plugins import VERBS, loaded, points
from eventsweep.eval import config
from eventsweep.eval.cli.app import app
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.cli.help import refusal
from eventsweep.eval.cli.streams import standard_streams

_CORE = (
    "compare", "completion", "convert", "fuse", "gate", "info", "list", "map", "report", "run",
    "score", "simulate", "study", "suite",
)  # fmt: skip
for _verb in _CORE:  # importing its module registers a verb
    import_module(f"eventsweep.eval.cli.verbs.{_verb}")


def _add_verb(point: EntryPoint) -> None:
    """Adds a plug-in's verb; one that cannot be loaded says so where it is called, nowhere else."""
    try:
        verb = loaded(point, "its verb {} cannot be loaded")
    except InputError as error:
        reason = str(error)

        def verb(*_words: Annotated[str, Parameter(allow_leading_hyphen=True)]) -> None:
            """Cannot be loaded."""
            raise InputError(reason)

    name = verb.name[0] if isinstance(verb, App) else point.name
    if name in set(app):
        package = point.dist.name if point.dist else point.value
        sys.stderr.write(f"{package}: its verb {name} is left out, there is one of that name\n")
    elif isinstance(verb, App):
        app.command(verb)
    else:
        app.command(verb, name=name)


for _point in points(VERBS):
    _add_verb(_point)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and ends the process with its code.

    0 on success, 1 where a suite, a gate or some windows failed, 2 on bad input, 130 when
    interrupted.
    """
    with standard_streams(), exit_code() as code:
        try:
            _check_threads()
            returned = app(arguments, exit_on_error=False, print_error=False)
            code.value = returned if isinstance(returned, int) else code.value
        except CycloptsError as error:
            raise _refusal(error) from error
    if arguments is None:
        sys.exit(code.value)
    return code.value


def _check_threads() -> None:
    """Refuses what numba ends with at its import, without the variable's name."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip() or "1"
    if not threads.isdecimal() or int(threads) < 1:
        raise InputError(
            f"NUMBA_NUM_THREADS is {quoted(threads)}: needs a whole number of at least 1; correct "
            "or unset it"
        )


def _refusal(error: CycloptsError) -> InputError:
    from pydantic import ValidationError

    cause = error.__cause__
    if isinstance(cause, ValidationError):
        group = error.argument.name.strip("-*") if error.argument else ""
        return fault(cause, config.Settings, above=f"{group}." if group else "")
    return InputError(refusal(error, app.name[0]))


if __name__ == "__main__":
    main()
