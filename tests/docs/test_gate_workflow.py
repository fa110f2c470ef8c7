"""The workflow for others runs: its own steps, in its own order, with a small mapper of one's own.

Only the step that installs is left out, since what it installs is what is being tested:
`eventsweep` is the checkout's. Its list of system libraries is held against that of
`docs/install.md`.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree as xml

import pytest
import yaml

from eventsweep.emvs.utils import kernel_cache
from places import ROOT

FILE = ROOT / "docs" / "gate-workflow.yml"
INSTALLS = "Install graphics libraries and eventsweep"
MAPPER = """#!{python}
import argparse, json, os
from pathlib import Path
import numpy as np
from eventsweep.emvs.data.sequence import Sequence

parser = argparse.ArgumentParser()
for name in ("--sequence", "--views", "--out"):
    parser.add_argument(name, type=Path)
asked = parser.parse_args()
camera = Sequence.open(asked.sequence).rig.cameras[0]
depth_m = np.full((camera.height_px, camera.width_px), float(os.environ["MY_DEPTH_M"]))
asked.out.mkdir()
for window in json.loads(asked.views.read_text())["windows"]:
    np.savez(asked.out / f"{{window['t_ref_us']}}.npz", depth_m=depth_m)
"""


def steps():
    """Name and command of every step that runs one."""
    (job,) = yaml.safe_load(FILE.read_text(encoding="utf-8"))["jobs"].values()
    return {step["name"]: step["run"] for step in job["steps"] if "run" in step}


def programs(folder):
    """`eventsweep` and `my-mapper`, as an installation would put them on the path."""
    folder.mkdir()
    shell = f'#!/bin/sh\nexec {sys.executable} -m eventsweep "$@"\n'
    texts = {"eventsweep": shell, "my-mapper": MAPPER.format(python=sys.executable)}
    for name, text in texts.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A checkout of somebody else's repository, and the programs of its machine."""
    folder = tmp_path_factory.mktemp("theirs")
    return folder, programs(tmp_path_factory.mktemp("machine") / "bin")


def done(place, command, depth_m="2.0"):
    """Runs a step as GitHub's runner does: bash, stopping at the first error."""
    folder, bin_folder = place
    env = os.environ | {
        "PATH": f"{bin_folder}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT),
        "GITHUB_STEP_SUMMARY": str(folder / "summary.md"), "MY_DEPTH_M": depth_m,
    }  # fmt: skip
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", command],
        cwd=folder, env=env, capture_output=True, text=True, check=False,
    )  # fmt: skip


def mapped(place, depth_m):
    """All steps up to the gate, each of which must succeed."""
    for name, command in steps().items():
        if name not in (INSTALLS, "Gate"):
            end = done(place, command.replace("--seconds 0.2", "--seconds 0.05"), depth_m)
            assert end.returncode == 0, (name, end.stderr)


def anew(place):
    """What the next run on a fresh runner finds: sequences come from its cache."""
    folder, _ = place
    assert done(place, "rm -r maps my-mapper").returncode == 0
    return folder


@pytest.mark.slow
def test_the_workflow_gates_a_mapper_of_ones_own(place):
    folder, _ = place
    (update,) = re.findall(r"# +(eventsweep gate .*--update.*)", FILE.read_text(encoding="utf-8"))
    mapped(place, "2.0")
    assert done(place, steps()["Gate"]).returncode == 2  # no baseline yet
    assert done(place, update).returncode == 0
    mapped_again = done(place, steps()["Gate"])
    assert mapped_again.returncode == 0, mapped_again.stdout
    assert "gate: green" in mapped_again.stdout

    anew(place)
    mapped(place, "2.5")
    worse = done(place, steps()["Gate"])
    assert worse.returncode == 1
    assert "desk Given/my-mapper" in worse.stdout.splitlines()[-1]
    failures = xml.parse(folder / "gate.xml").getroot()[0].findall("testcase/failure")
    assert failures
    assert "gate: red" in (folder / "summary.md").read_text()


@pytest.mark.slow
def test_a_run_on_another_sequence_is_red(place):
    """As after a change of the cache's key: nothing can be compared, and the gate says so."""
    folder = anew(place)
    assert done(place, "mv sequences/desk sequences/first").returncode == 0
    first, shorter = "--seconds 0.2 --seed 0", "--seconds 0.04 --seed 1"
    simulate = steps()["Simulate, once"]
    assert first in simulate
    other = {**steps(), "Simulate, once": simulate.replace(first, shorter)}
    for name, command in other.items():
        end = done(place, command) if name != INSTALLS else None
        assert end is None or end.returncode == (1 if name == "Gate" else 0), (name, end.stderr)
    assert "could be compared" in (folder / "summary.md").read_text()


def test_the_workflow_installs_what_the_page_does_keeps_kernels_and_is_strict(monkeypatch):
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    (needed,) = re.findall(r"apt-get install (libegl1.*)", page)
    install = steps()[INSTALLS]
    (asked,) = re.findall(r"--no-install-recommends (.*)", install)
    assert set(asked.split()) == set(needed.split())
    settings = yaml.safe_load(FILE.read_text(encoding="utf-8"))["env"]
    assert 'pip install "$EVENTSWEEP"' in install
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert settings["EVENTSWEEP"].endswith(f"/eventsweep-{project['version']}-py3-none-any.whl")
    assert "--strict" in steps()["Gate"]
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    (job,) = yaml.safe_load(FILE.read_text(encoding="utf-8"))["jobs"].values()
    kept = [step["with"]["path"] for step in job["steps"] if "cache" in step.get("uses", "")]
    assert next(kernel_cache._homes(None)) in [Path(path).expanduser() for path in kept]
