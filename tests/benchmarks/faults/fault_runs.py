"""Runs `quick` and its gate in copies of the packages, whole or with a planted fault.

`python tests/benchmarks fault_runs --page docs/gate.md` plants every fault and writes what the
gate says of each into the page. With `EVENTSWEEP_CACHE` set, a run that was stopped goes on where
it was.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from eventsweep.emvs.utils.cache import default_cache
from eventsweep.eval.results.series import SPEED_METRIC
from markdown_blocks import into_page
from planted_faults import FAULTS, ROOT, Fault, broken_copy

BASELINE = Path(os.environ.get("EVENTSWEEP_BASELINE", ROOT / "reports" / "baseline.json"))
"""What is held against; `EVENTSWEEP_BASELINE` names another one than the project's."""
LIMIT_S = 1800
"""For one run of `quick` and its gate: about a minute where nobody else works."""


class TooSlow(Exception):
    """A run took longer than `LIMIT_S`."""


def gate(copy, cache, *arguments, cases=()):
    """The gate's exit code in a copy of the packages, and its verdicts, the worst first.

    Without the mapper's speed: others at work on this machine must not decide. Strict, as
    `make gate` is.
    """
    place = copy.parent / "result"
    only = [word for case in cases for word in ("--case", case)]
    some = ("--cache", cache, "--no-speed", "--force", *only)
    run(copy, "suite", "quick", "--out", place, *some, *arguments)
    held = ("--baseline", copy.parent / "baseline.json", "--result", place, "--strict", "--json")
    timeless(BASELINE, copy.parent / "baseline.json")
    code, text = run(copy, "gate", *held, *only)
    return code, json.loads(text)


def run(copy, *arguments):
    """Runs the command of a copy of the packages, and ends it and its workers after `LIMIT_S`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "eventsweep", *map(str, arguments)],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "GITHUB_STEP_SUMMARY": ""},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, said = process.communicate(timeout=LIMIT_S)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            message = f"not done after {LIMIT_S} s; set EVENTSWEEP_CACHE to go on from here"
            raise TooSlow(message) from error
        raise
    assert process.returncode in (0, 1), said
    assert "Traceback" not in said, said
    return process.returncode, out


def timeless(baseline, path):
    """Copies a baseline without its series of speed."""
    content = json.loads(baseline.read_text(encoding="utf-8"))
    series = [each for each in content["series"] if each["metric"] != SPEED_METRIC]
    path.write_text(json.dumps({**content, "series": series}), encoding="utf-8")


def red(verdicts):
    """The verdicts that make a gate fail."""
    return [verdict for verdict in verdicts if verdict["is_red"]]


def line(fault: Fault, verdicts):
    """What the gate says of a fault, as a line of the page's table."""
    reds = red(verdicts)
    first = "nothing"
    if reds:
        verdict = reds[0]
        first = " ".join(verdict[part] for part in ("case", "method", "metric") if verdict[part])
    return f"| {fault.name} | `{fault.file}` | {len(reds)} | {first} |"


def table(cache):
    """Every fault's line; printed as they come."""
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        for fault in FAULTS:
            _, verdicts = gate(broken_copy(Path(folder) / "copy", fault), cache)
            lines.append(line(fault, verdicts))
            sys.stdout.write(lines[-1] + "\n")
            sys.stdout.flush()
    deciding = sum(verdict["decides"] and verdict["status"] != "new" for verdict in verdicts)
    head = [f"| Fault | File | Red, of {deciding} that decide | First |", "|---|---|--:|---|"]
    return "\n".join([*head, *lines]) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args()
    text = table(default_cache())
    if asked.page is not None:
        into_page(asked.page, "faults", text)


if __name__ == "__main__":
    main()
