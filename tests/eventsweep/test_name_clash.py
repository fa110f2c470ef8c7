"""The program beside a user's own `eval.py`, `sim/`, `scenes.py` and `emvs/`: neither is hidden."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import eventsweep
from places import ROOT
from small_suite import case, suite_text

HOSTILE = 'raise RuntimeError("this is the package of the user")\n'

SUITE = 'speed_case = "wall"\n' + suite_text(
    case("wall", [(0.0, 0.02)], 0.02), mappers={"default": {"methods": ["Alg1/H"], "planes": 10}}
)


@pytest.fixture
def project(tmp_path):
    """A project with packages and modules that are called as parts of ours are."""
    for name in ("eval.py", "sim", "scenes.py", "emvs"):
        path = tmp_path / name if name.endswith(".py") else tmp_path / name / "__init__.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(HOSTILE)
    return tmp_path


def python(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Runs Python in a folder, which is also the first of PYTHONPATH; our code comes later."""
    environment = os.environ | {
        "PYTHONPATH": f".{os.pathsep}{ROOT}",
        "EVENTSWEEP_CACHE": str(folder / "cache"),
    }
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def works(folder: Path, *arguments: str) -> str:
    done = python(folder, "-m", "eventsweep", *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["eval", "sim", "scenes", "emvs"])
def test_the_folder_is_as_hostile_as_it_seems(project, name):
    assert "package of the user" in python(project, "-c", f"import {name}").stderr


def test_the_command_line_works_there(project):
    assert "Alg1/H" in works(project, "list")


@pytest.mark.slow
def test_the_installed_script_works_there_too(project):
    script = project / "bin" / "eventsweep"
    script.parent.mkdir()
    script.write_text("from eventsweep.__main__ import main\nmain()\n")
    done = python(project, str(script), "list")
    assert done.returncode == 0, done.stderr
    assert "Alg1/H" in done.stdout


def test_every_public_name_works_there(project):
    names = [name for name in eventsweep.__all__ if name != "__version__"]
    code = f"import eventsweep as es\nfor name in {names!r}:\n    getattr(es, name)"
    done = python(project, "-c", code)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_its_worker_processes_see_our_packages(project):
    short = ("--seconds", "0.02", "--rig", "rpg", "--workers", "2", "--quiet")
    works(project, "simulate", "planes", "--out", "sequence", *short)
    assert (project / "sequence" / "manifest.json").exists()
    (project / "tiny.toml").write_text(SUITE)
    works(project, "suite", "tiny.toml", "--out", "suite", "--workers", "1", "--quiet")
    assert (project / "suite" / "suite.json").exists()
