"""Memory of a simulation: `python tests/benchmarks memory_simulate SCENE RIG SECONDS WORKERS`.

Samples all processes of `eventsweep simulate` ten times a second and prints the peak of each
quarter of the run: it must not grow with the sequence.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path


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


def main(scene: str, rig: str, seconds: str, workers: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "sequence"
        command = [sys.executable, "-m", "eventsweep", "simulate", scene, "--rig", rig]
        command += ["--seconds", seconds, "--workers", workers, "--out", str(out), "--quiet"]
        began_s = time.perf_counter()
        peaks = peaks_mb(command)
        took_s = time.perf_counter() - began_s
        size_mb = sum(path.stat().st_size for path in out.rglob("*.*")) / 1e6
    text = ", ".join(f"{peak:.0f}" for peak in peaks)
    sys.stdout.write(
        f"{scene}, {rig}, {seconds} s, {workers} workers: took {took_s:.0f} s, {size_mb:.0f} MB\n"
        f"peak memory by quarter of the run: {text} MB\n"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
