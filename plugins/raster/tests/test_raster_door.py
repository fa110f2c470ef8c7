"""The renderer chosen by name: what it simulates, where, and what is said of what it lacks."""

import re

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from programs import NARROW, python
from refusals import command_refused

SHORT = "--rig", "davis346", "--seconds", "0.01"
MODEL = f"<mujoco><worldbody>{made.BOXES}<site name='eye' pos='0 0 1'/></worldbody></mujoco>"
RASTER = {"light": {"renderer": "raster"}, "duration_s": 0.03}


def simulated(scene, out, **changed):
    config = SimConfig.model_validate(RASTER | changed)
    return Sequence.open(simulate(scene, made.tiny_rig(), config, 0, out))


def counts(sequence):
    return np.array([len(sequence.events(k, 0, 30_001)) for k in range(2)])


def test_it_makes_the_events_that_mujoco_makes(tmp_path):
    scene = made.noise_scene(tmp_path)
    ours = simulated(scene, tmp_path / "ours")
    theirs = simulated(scene, tmp_path / "theirs", light={"renderer": "mujoco"})
    assert ours.manifest.renderer.startswith("raster, mujoco ")
    np.testing.assert_allclose(counts(ours), counts(theirs), rtol=0.02)
    np.testing.assert_allclose(
        ours.truth_depth_m(0, 30_000), theirs.truth_depth_m(0, 30_000), rtol=1e-5
    )


@pytest.mark.parametrize("scene", ["desk", "model.xml"])
def test_a_renderer_that_nobody_offers_is_refused(tmp_path, capsys, monkeypatch, scene):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.xml").write_text(MODEL)
    asked = "simulate", scene, "--sim.light.renderer", "rastr", "--out", "s", *SHORT
    line = command_refused(capsys, *asked)
    assert "unknown renderer 'rastr': choose from auto, mujoco, classic, float, raster" in line
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


# Whoever loads a graphics library, or looks for one, dies: in workers as well.
BROKEN = """
import sys
from importlib.abc import MetaPathFinder

class NoGraphics(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        whole = name.partition(".")[0] in ("OpenGL", "glfw")
        if whole or name.startswith(("mujoco.egl", "mujoco.osmesa", "mujoco.glfw")):
            raise AssertionError(name)

sys.meta_path.insert(0, NoGraphics())
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_it_opens_no_graphics_library(tmp_path, workers):
    (tmp_path / "sitecustomize.py").write_text(BROKEN)
    (tmp_path / "model.xml").write_text(MODEL)
    asked = ["simulate", tmp_path / "model.xml", *SHORT, "--workers", workers, "--out"]
    asked += [tmp_path / "s", "--sim.model.motion", "walk", "--mount", "eye"]
    asked += ["--sim.light.renderer"]
    unable = {"MUJOCO_GL": "egl"}
    done = python("-m", "eventsweep", *asked, "mujoco", path=[tmp_path], env=unable)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("AssertionError: ")
    done = python("-m", "eventsweep", *asked, "auto", path=[tmp_path], env=unable)
    assert done.returncode == 0, done.stderr
    assert "drawn by raster" in done.stdout
    assert sum(Sequence.open(tmp_path / "s").manifest.event_counts) > 100


WITHOUT = """
import ctypes.util, sys
ctypes.util.find_library = lambda name: None
from eventsweep.eval.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def test_who_has_no_graphics_library_is_told_of_it_and_it_works(tmp_path):
    def run(*asked):
        out = "--out", tmp_path / "s", *SHORT
        return python("-c", WITHOUT, "simulate", "planes", *out, *asked, env={"MUJOCO_GL": ""})

    refusal = run("--sim.light.renderer", "mujoco")
    assert refusal.returncode == 2
    assert not (tmp_path / "s").exists()
    cure = re.search("say (--sim.light.renderer) (raster)", refusal.stderr)
    for words in (cure.groups(), ("--force",)):
        done = run(*words)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("processor", NARROW)
def test_every_processor_and_number_of_threads_gives_the_same_bytes(processor, tmp_path):
    older = NARROW[processor] | {
        "OPENBLAS_CORETYPE": "Haswell", "NUMBA_NUM_THREADS": "1",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR X86_V3",
    }  # fmt: skip
    asked = "simulate", "desk", "--sim.light.renderer", "raster", "--seconds", "0.01", "--out"
    for name, settings in (("own", {"NUMBA_NUM_THREADS": "2"}), ("older", older)):
        env = {**settings, "EVENTSWEEP_CACHE": str(tmp_path / f"{name} textures")}
        python("-m", "eventsweep", *asked, tmp_path / name, env=env, check=True, timeout=1500)
    own, other = (Sequence.open(tmp_path / name) for name in ("own", "older"))
    assert min(own.event_count(0), own.event_count(1)) > 4000
    assert other.manifest.digest() == own.manifest.digest()
