"""The workflow that checks entries to a ranking runs the command that the page on it names."""

import re
import subprocess
import sys
import tomllib
from hashlib import sha256

import numpy as np
import pytest
import yaml

from eventsweep.eval.cli.main import main
from places import ROOT, page
from small_suite import case, suite_text

FILE = ROOT / "plugins" / "ranking" / "submission-workflow.yml"
FACTS = """
method = "Mine"
authors = ["A. Author"]
licence = "CC-BY-4.0"
[cost]
seconds_per_window = 0.5
peak_memory_mb = 100
hardware = "a laptop"
"""


def checks():
    (job,) = yaml.safe_load(FILE.read_text(encoding="utf-8"))["jobs"].values()
    return [step["run"] for step in job["steps"] if "run" in step]


def test_what_it_runs_is_what_the_page_names_and_of_this_version():
    install, check = checks()
    assert install == 'pip install "$EVENTSWEEP"'
    assert f"\n{check}\n" in page("ranking.md").read_text(encoding="utf-8")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"eventsweep-{version}-py3-none-any.whl" in FILE.read_text(encoding="utf-8")


@pytest.mark.slow
def test_its_command_accepts_an_entry_and_refuses_a_changed_one(tmp_path):
    (tmp_path / "pair.toml").write_text(suite_text(case("wall")))
    theirs = tmp_path / "theirs" / "wall" / "seed0"
    theirs.mkdir(parents=True)
    for k, name in enumerate(("10000", "30000")):
        np.savez(theirs / f"{name}.npz", depth_m=np.full((180, 240), 2.0 + 0.1 * k))
    (tmp_path / "theirs" / "submission.toml").write_text(FACTS)
    suite, out = ["--suite", str(tmp_path / "pair.toml")], tmp_path / "submissions" / "mine"
    entering = ["submission", "enter", str(tmp_path / "theirs"), *suite, "--out", str(out)]
    assert main([*entering, "--quiet"]) == 0
    (tmp_path / "eventsweep").write_text(f'#!/bin/sh\nexec {sys.executable} -m eventsweep "$@"\n')
    (tmp_path / "eventsweep").chmod(0o755)
    command = f"PATH={tmp_path}:$PATH PYTHONPATH={ROOT} {checks()[1]} --suite pair.toml"
    codes = []
    for _ in range(2):
        done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, check=False)
        codes.append(done.returncode)
        (out / "maps.tar.zst").write_bytes(b"changed")
    assert codes == [0, 2]


def test_of_a_pull_request_nothing_but_its_entries_counts():
    (job,) = yaml.safe_load(FILE.read_text(encoding="utf-8"))["jobs"].values()
    merged, theirs = (s["with"] for s in job["steps"] if "checkout" in s.get("uses", ""))
    assert merged == {"ref": "${{ github.base_ref }}"}
    assert job["steps"][-1]["working-directory"] == theirs["path"]


EVIL = suite_text(case("wall"), name="suite-v5")


@pytest.mark.parametrize(("suite", "more", "words"), [
    ("evil.toml", [], "its suite evil.toml is not one of"),
    ("pair", [], "its suite pair is not one of"),
    ("quick", [], "its suite quick is not one of"),
    ("suite-v5", ["--suite", "evil.toml"], "is not the one that comes with the program"),
    ("suite-v5", ["--suite", "quick"], "maps.tar.zst: damaged archive"),
])  # fmt: skip
def test_an_entry_names_a_suite_that_comes_with_the_program(
    tmp_path, monkeypatch, capsys, suite, more, words
):
    folder = tmp_path / "submissions" / "mine"
    folder.mkdir(parents=True)
    (folder / "maps.tar.zst").write_bytes(b"")
    digest = sha256(b"").hexdigest()
    (folder / "entry.toml").write_text(f'suite = "{suite}"\nsha256 = "{digest}"\n')
    (tmp_path / "evil.toml").write_text(EVIL)
    monkeypatch.chdir(tmp_path)
    assert main(["submission", "check", "submissions/mine", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line


def test_a_suite_of_ones_own_has_a_name_of_its_own(tmp_path, monkeypatch, capsys):
    (tmp_path / "evil.toml").write_text(EVIL)
    monkeypatch.chdir(tmp_path)
    assert main(["submission", "make", ".", "--suite", "evil.toml", "--out", "made"]) == 2
    assert "give it another name" in capsys.readouterr().err
