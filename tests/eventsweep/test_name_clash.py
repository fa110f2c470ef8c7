"""The program beside a user's own `eval.py`, `sim/`, `scenes.py` and `emvs/`: neither is hidden."""

from pathlib import Path

import pytest

import eventsweep
from programs import python
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


def works(folder: Path, *arguments: str) -> str:
    """What Python prints in a folder that is also the first of its path; our code comes later."""
    env = {"EVENTSWEEP_CACHE": str(folder / "cache")}
    done = python(*arguments, path=["."], cwd=folder, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["eval", "sim", "scenes", "emvs"])
def test_the_folder_is_as_hostile_as_it_seems(project, name):
    done = python("-c", f"import {name}", path=["."], cwd=project)
    assert "package of the user" in done.stderr


def test_the_command_line_and_every_public_name_work_there(project):
    assert "Alg1/H" in works(project, "-m", "eventsweep", "list")
    names = [name for name in eventsweep.__all__ if name != "__version__"]
    works(project, "-c", f"import eventsweep as es\nfor name in {names!r}:\n    getattr(es, name)")


@pytest.mark.slow
def test_the_installed_script_works_there_too(project):
    script = project / "bin" / "eventsweep"
    script.parent.mkdir()
    script.write_text("from eventsweep.__main__ import main\nmain()\n")
    assert "Alg1/H" in works(project, str(script), "list")


@pytest.mark.slow
def test_its_worker_processes_see_our_packages(project):
    (project / "tiny.toml").write_text(SUITE)
    for words, file in (
        ("simulate planes --out one --seconds 0.02 --rig rpg --workers 2", "one/manifest.json"),
        ("suite tiny.toml --out suite --workers 1", "suite/suite.json"),
    ):
        works(project, "-m", "eventsweep", *words.split(), "--quiet")
        assert (project / file).exists()
