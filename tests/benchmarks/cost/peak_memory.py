"""The most memory that a program needs at once."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

VERB = "import sys; from eventsweep.eval.cli.main import main; code = main(sys.argv[1:])"
"""A program that runs `eventsweep` with its words."""

# Not `ru_maxrss`: that begins with what the parent process held when it forked.
_PEAK = """
import re, sys
from pathlib import Path
print(int(re.search(r"VmHWM:\\s*([0-9]+)", Path("/proc/self/status").read_text())[1]) / 1024)
sys.exit(globals().get("code", 0))
"""


def peak_mb(program: str, words: Sequence[str]) -> float:
    """Peak memory of a process of its own, with its libraries, MB.

    Args:
        program: Python that prints nothing; a global `code` becomes its exit code.
        words: its arguments.

    Raises:
        SystemExit: it failed; it has said why.
    """
    command = [sys.executable, "-c", program + _PEAK, *words]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: ended with {done.returncode}")
    return float(done.stdout)
