"""Scenes of other packages: found by entry point, simulated like ours, refused in one line."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from eventsweep import scenes
from eventsweep.eval.cli.main import main
from places import ROOT

MODULE = """
from pathlib import Path
import numpy as np
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

def textures():
    return {"noise": np.random.default_rng(0).integers(20, 250, (64, 64, 3), np.uint8)}

def motion(duration_s, seed):
    return HeadSway.seeded(look_at((0, 0, 1), (2, 0, 1)), (.05, .02, .02), (2, 3, 1), (.5,), seed)

SCENE = Scene("green-house", "Noise on a wall.", Path(__file__).with_name("wall.xml"), textures,
              motion, (1.0, 3.0), rig="oblique", duration_s=0.02)
WRONG = 7
"""
MJCF = """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
<asset>
<texture name="noise" type="2d" builtin="flat" width="2" height="2"/>
<material name="noise" texture="noise" specular="0"/></asset>
<worldbody><geom type="box" size=".1 3 3" pos="2.5 0 1" material="noise"/></worldbody></mujoco>"""


@pytest.fixture
def package(tmp_path):
    """A package beside the project, as an installer leaves it."""
    info = tmp_path / "site" / "theirs-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info.parent / "theirs_scenes.py").write_text(MODULE)
    (info.parent / "wall.xml").write_text(MJCF)
    return info


@pytest.fixture
def here(package, monkeypatch):
    """The package, found by this process, too."""
    monkeypatch.setattr(scenes, "_points", cache(scenes._points.__wrapped__))
    monkeypatch.syspath_prepend(package.parent)
    yield package
    sys.modules.pop("theirs_scenes", None)


def offers(package, *lines):
    (package / "entry_points.txt").write_text("\n".join(["[eventsweep.scenes]", *lines]) + "\n")


def eventsweep(package, folder, *words):
    path = os.pathsep.join([str(ROOT), str(package.parent)])
    return subprocess.run(
        [sys.executable, "-m", "eventsweep", *words], cwd=folder, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": path}, check=False,
    )  # fmt: skip


@pytest.mark.slow
def test_a_scene_of_another_package_is_listed_and_simulated(package, tmp_path):
    offers(package, "green_house = theirs_scenes:SCENE")
    listed = eventsweep(package, tmp_path, "list", "scenes")
    assert "green-house" in listed.stdout
    assert "Noise on a wall" in listed.stdout
    words = ("--out", "out", "--sim.sampling", "fast", "--quiet")
    done = eventsweep(package, tmp_path, "simulate", "green-house", *words)
    assert done.returncode == 0, done.stderr
    assert (Path(tmp_path) / "out" / "manifest.json").is_file()


@pytest.mark.parametrize(("line", "message"), [
    ("green-house = nowhere:SCENE", "theirs: its scene (green-house = nowhere:SCENE) cannot"),
    ("green-house = theirs_scenes:GONE", "cannot be loaded"),
    ("green-house = theirs_scenes:WRONG", "theirs_scenes:WRONG is a int, not a Scene"),
])  # fmt: skip
def test_one_that_fails_is_told_in_one_line(here, tmp_path, capsys, line, message):
    offers(here, line)
    assert main(["simulate", "green-house", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_name_of_ours_stays_ours(here, tmp_path):
    offers(here, "planes = nowhere:SCENE")
    words = ("--seconds", "0.005", "--sim.sampling", "fast", "--rig", "oblique", "--quiet")
    assert main(["simulate", "planes", "--out", str(tmp_path / "out"), *words]) == 0
