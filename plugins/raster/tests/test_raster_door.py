"""The renderer chosen by name: what it simulates, where, and what is said of what it lacks."""

import sys
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from programs import NARROW, python
from refusals import refused

RASTER = {"light": {"renderer": "raster"}, "duration_s": 0.03}


def simulated(scene, out, notice=lambda _line: None, **changed):
    config = SimConfig.model_validate(RASTER | changed)
    return Sequence.open(simulate(scene, made.tiny_rig(), config, 0, out, notice=notice))


def counts(sequence):
    return np.array([len(sequence.events(k, 0, 30_001)) for k in range(2)])


def test_it_makes_the_events_that_mujoco_makes(tmp_path):
    scene, lines = made.noise_scene(tmp_path), []
    ours = simulated(scene, tmp_path / "ours", lines.append)
    theirs = simulated(scene, tmp_path / "theirs", light={"renderer": "auto"})
    assert not lines
    assert ours.manifest.renderer.startswith("raster, mujoco ")
    np.testing.assert_allclose(counts(ours), counts(theirs), rtol=0.02)
    np.testing.assert_allclose(
        ours.truth_depth_m(0, 30_000), theirs.truth_depth_m(0, 30_000), rtol=1e-5
    )


def test_what_it_lacks_is_said_in_one_line(tmp_path):
    def glass_and_mirror(spec):
        spec.materials[0].reflectance = 0.5
        spec.geoms[0].rgba, spec.geoms[0].material = (1, 1, 1, 0.5), ""

    lines = []
    drawn = simulated(
        replace(made.noise_scene(tmp_path), edit=glass_and_mirror), tmp_path / "s", lines.append
    )
    assert drawn.manifest.renderer.startswith("mujoco ")
    assert lines[0] == "noise: drawn by MuJoCo, because renderer raster lacks glass in mirrors"


def test_a_renderer_that_nobody_offers_is_refused(tmp_path):
    wrong = {"renderer": "rastr"}
    refused(
        "unknown renderer 'rastr'.*raster", simulated, made.noise_scene(tmp_path), tmp_path / "s",
        light=wrong,
    )  # fmt: skip


WITHOUT_GRAPHICS = """
import ctypes, ctypes.util, sys
from pathlib import Path
ctypes.util.find_library = lambda name: None
folder = Path(sys.argv[1])
import mujoco_scenes as made
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
config = SimConfig.model_validate({"light": {"renderer": "raster"}, "duration_s": 0.01})
simulate(made.noise_scene(folder), made.tiny_rig(), config, 0, folder / "s")
drawn = [name for name in sys.modules if name.startswith("OpenGL") or name == "glfw"]
loaded = [line for line in open("/proc/self/maps") if "libGL" in line or "libEGL" in line]
print(drawn, loaded)
"""
HERE = [folder for folder in sys.path if folder.endswith("simulation")]


def test_it_needs_no_graphics_library(tmp_path):
    done = python("-c", WITHOUT_GRAPHICS, tmp_path, path=HERE, env={"MUJOCO_GL": ""})
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[] []\n"


def bits():
    """A hash of a picture with everything that a processor might compute its own way."""
    from eventsweep.emvs.geometry.rig import Rig
    from test_raster_models import LENS, PINHOLE, POSE, RANGE_M, built

    rig = Rig("two", (PINHOLE, LENS), (np.eye(4),) * 2, ("left", "right"))
    digest = sha256()
    for name in ("a spot", "gloss", "cube textures", "sky"):
        with RasterRenderer(built(name), rig, 4, RANGE_M, floats=True, border_px=3) as drawn:
            for camera in range(2):
                frame = drawn.frame(camera, POSE)
                for values in (*frame.samples, frame.intensity, frame.nearest_depth_m):
                    digest.update(values.tobytes())
    return digest.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("processor", NARROW)
def test_every_processor_draws_the_same_bits(tmp_path, processor):
    environment = {"NUMBA_CACHE_DIR": str(tmp_path), **NARROW[processor]}
    code = "import test_raster_door; print(test_raster_door.bits())"
    done = python("-c", code, path=sys.path, env=environment)
    assert done.stdout.strip() == bits(), done.stderr
