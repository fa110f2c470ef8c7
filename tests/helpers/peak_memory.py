"""The most memory that a program needs at once, alone or with the processes that it starts."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

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


def memory_mb(group: int) -> float:
    """Memory of a process group; what its processes share of it counts once.

    Program files count once and in full, those of the process that maps most: each one's
    share would change with whatever else runs on the machine.
    """
    total_kb = files_kb = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if os.getpgid(int(folder.name)) == group:
                own, files = (folder / "smaps_rollup").read_text(), (folder / "status").read_text()
                total_kb += sum(_kb(name, own) for name in ("Pss_Anon", "Pss_Shmem"))
                files_kb = max(files_kb, _kb("RssFile", files))
        except (OSError, TypeError):  # it has just ended
            continue
    return (total_kb + files_kb) / 1024


def _kb(name: str, text: str) -> int:
    return int(re.search(rf"^{name}:\s*(\d+)", text, re.MULTILINE)[1])


def peaks_mb(command: list[str], quarters: int = 4) -> list[float]:
    """Runs a command and returns its peak memory in each quarter of its run, MB."""
    process, samples = subprocess.Popen(command, start_new_session=True), []
    while process.poll() is None:
        samples.append(memory_mb(process.pid))
        time.sleep(0.1)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    size = -(-len(samples) // quarters)
    return [max(samples[k : k + size]) for k in range(0, len(samples), size)]
