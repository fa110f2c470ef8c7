"""Folders of the user's that are called as our packages are: the command line does not care."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from eventsweep import installation
from places import ROOT
from small_suite import case, suite_text

HOSTILE = 'raise RuntimeError("this is the package of the user")\n'

SUITE = 'speed_case = "wall"\n' + suite_text(
    case("wall", [(0.0, 0.02)], 0.02), mappers={"default": {"methods": ["Alg1/H"], "planes": 10}}
)


def hide(folder: Path, names: tuple[str, ...]) -> Path:
    """A project that has packages, or where a name ends so, modules of these names."""
    for name in names:
        path = folder / name if name.endswith(".py") else folder / name / "__init__.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(HOSTILE)
    return folder


@pytest.fixture
def project(tmp_path):
    return hide(tmp_path, ("eval", "sim", "scenes"))


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


def test_the_folder_is_as_hostile_as_it_seems(project):
    assert "package of the user" in python(project, "-c", "import eval.cli.main").stderr


@pytest.mark.parametrize("names", [("eval",), ("sim",), ("eval.py",), ("emvs", "scenes.py")])
def test_the_command_line_works_beside_packages_of_the_same_name(tmp_path, names):
    assert "Alg1/H" in works(hide(tmp_path, names), "list")


def test_the_installed_script_works_there_too(project):
    script = project / "bin" / "eventsweep"
    script.parent.mkdir()
    script.write_text("from eventsweep.__main__ import main\nmain()\n")
    done = python(project, str(script), "list")
    assert done.returncode == 0, done.stderr
    assert "Alg1/H" in done.stdout


@pytest.mark.slow
def test_its_worker_processes_see_our_packages(project):
    short = ("--seconds", "0.02", "--rig", "rpg", "--workers", "2", "--quiet")
    works(project, "simulate", "planes", "--out", "sequence", *short)
    assert (project / "sequence" / "manifest.json").exists()
    (project / "tiny.toml").write_text(SUITE)
    works(project, "suite", "tiny.toml", "--out", "suite", "--workers", "1", "--quiet")
    assert (project / "suite" / "suite.json").exists()


def test_without_a_clash_the_path_stays_as_it_is(monkeypatch):
    before = list(sys.path)
    monkeypatch.setattr(sys, "path", list(before))
    installation.put_first()
    assert sys.path == before


@pytest.mark.parametrize(
    ("hidden", "name", "culprit"),
    [
        ("eval", "score", "eval"),
        ("eval.py", "score", "eval.py"),
        ("eval", "Results", "eval"),
        ("sim", "SimConfig", "sim"),
        ("scenes", "simulate", "scenes"),
        ("emvs", "open_recording", "emvs"),
        ("emvs", "map_window", "emvs"),
    ],
)
def test_the_library_says_what_hides_it(tmp_path, hidden, name, culprit):
    done = python(hide(tmp_path, (hidden,)), "-c", f"import eventsweep as es; es.{name}")
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: {tmp_path / culprit} is not eventsweep's own package")
    assert "rename it" in last
    assert "package of the user" not in done.stderr


def test_the_library_says_so_when_the_other_package_was_imported_before(tmp_path):
    (tmp_path / "eval").mkdir()
    (tmp_path / "eval" / "__init__.py").touch()
    code = "from eval import __file__; import eventsweep as es; es.score"
    last = python(tmp_path, "-c", code).stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: {tmp_path / 'eval'} is not eventsweep's own package eval")


def test_the_command_line_says_so_too(tmp_path):
    (tmp_path / "eval").mkdir()
    (tmp_path / "eval" / "__init__.py").touch()
    code = "from eval import __file__; from eventsweep.__main__ import main; main()"
    done = python(tmp_path, "-c", code, "list")
    assert done.returncode == 2
    assert done.stderr.startswith(f"eventsweep: {tmp_path / 'eval'} is not eventsweep's own")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "name", ["open_recording", "MapperConfig", "map_window", "DepthMap", "InputError", "methods"]
)
def test_what_does_not_need_the_hidden_package_works(project, name):
    done = python(project, "-c", f"import eventsweep as es; es.{name}")
    assert done.returncode == 0, done.stderr


def test_a_folder_that_is_no_package_hides_nothing(tmp_path):
    (tmp_path / "eval").mkdir()
    done = python(tmp_path, "-c", "import eventsweep as es; es.score")
    assert done.returncode == 0, done.stderr
