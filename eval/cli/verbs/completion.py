"""`eventsweep completion`: verbs, flags and names completed by the shell."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
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
    installed = app.install_completion(shell=chosen, add_to_startup=False)
    _load_at_startup(installed, chosen)
    console.wrote(installed)
    console.say(f"to use it, {_NEXT[chosen]}")


def _load_at_startup(script: Path, shell: Shell) -> None:
    """Adds what loads the script to the shell's start-up file, once.

    The file is replaced as a whole: where cyclopts writes into it, a kill or a full disk cuts it.
    """
    if shell == "bash":
        line = f'[ -f "{script}" ] && . "{script}"'
    elif shell == "zsh" and script.is_relative_to(Path.home() / ".zsh"):
        line = f"fpath=({script.parent} $fpath)"
    else:
        return  # the shell looks there by itself
    file = (Path.home() / f".{shell}rc").resolve()
    before = file.read_bytes() if file.exists() else b""
    if os.fsencode(line) in before:
        return
    added = os.fsencode(f"# Load eventsweep's completion\n{line}\n")
    gap = b"" if before.endswith(b"\n") or not before else b"\n"
    with atomic_path(file) as made:
        # zsh reads fpath where compinit is called, which may be anywhere.
        made.write_bytes(added + before if shell == "zsh" else before + gap + added)
        if file.exists():
            shutil.copymode(file, made)


def _present_shell() -> Shell:
    from cyclopts.completion.detect import ShellDetectionError, detect_shell

    try:
        found = detect_shell()
    except ShellDetectionError:
        found = "powershell"
    if found == "powershell":
        raise InputError("your shell is unknown, or not bash, zsh or fish: name one of these")
    return found
