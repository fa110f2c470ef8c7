"""`eventsweep completion`: verbs, flags and names completed by the shell."""

from __future__ import annotations

import sys
from typing import Annotated, Literal

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import QUIET, Quiet, app

Shell = Literal["bash", "zsh", "fish"]

# Behind the shell's name; bash and zsh read their start-up file, fish looks for the script itself.
_NEXT = {
    "bash": "start a new shell, or `source ~/.bashrc`",
    "zsh": "start a new shell; ~/.zshrc needs `autoload -Uz compinit && compinit`",
    "fish": "start a new shell",
}


@app.command
def completion(
    shell: Shell | None = None,
    /,
    *,
    script: Annotated[bool, Parameter(name="--print", negative=())] = False,
    common: Quiet = QUIET,
) -> None:
    """Install completion of verbs, flags and names for your shell.

    Args:
        shell: Shell to install for; by default the one you are using.
        script: Print the script instead of installing it.
    """
    chosen = shell or _present_shell()
    if script:
        sys.stdout.write(app.generate_completion(shell=chosen))
        return
    console = common.console()
    console.wrote(app.install_completion(shell=chosen))
    console.say(f"to use it, {_NEXT[chosen]}")


def _present_shell() -> Shell:
    from cyclopts.completion.detect import ShellDetectionError, detect_shell

    try:
        found = detect_shell()
    except ShellDetectionError:
        found = "powershell"
    if found == "powershell":
        raise InputError("your shell is not bash, zsh or fish, or is unknown: name one")
    return found
