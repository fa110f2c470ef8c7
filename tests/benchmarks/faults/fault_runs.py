"""Runs `quick` and its gate in copies of the packages, whole or with a planted fault."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

from eventsweep.eval.results.series import SPEED_METRIC
from planted_faults import ROOT

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
