"""A second run starts at once: nothing heavy is imported too early, nothing compiled again."""

import subprocess
import sys

import pytest

from cost_stream import MovingEdges
from places import with_tools

HEAVY = ("open3d", "matplotlib", "pandas", "mujoco", "dash", "OpenGL", "hypothesis")

# Ends the process where `eventsweep map` reads its first event.
FIRST_EVENT = """
import os, sys
from eventsweep.eval.cli.main import main
from eventsweep.emvs.data.sequence import Sequence

def first(*_):
    print(*sys.modules, flush=True)
    os._exit(0)

Sequence.events = first
main(["map", sys.argv[1], "--out", sys.argv[2], "--quiet"])
"""

# Ends the process where `eventsweep simulate` has its first picture.
FIRST_PICTURE = """
import os, sys
from numba.core import event
from eventsweep.eval.cli.main import main
from eventsweep.sim.rendering.renderer import StereoRenderer

picture = StereoRenderer.frame

def first(*arguments):
    picture(*arguments)
    starts = [e.data["dispatcher"] for _, e in recorder.buffer if e.is_start]
    print(len(starts), *sys.modules, flush=True)
    os._exit(0)

StereoRenderer.frame = first
with event.install_recorder("numba:compile") as recorder:
    main(["simulate", "low-texture", "--out", sys.argv[1], "--seconds", "0.01", "--quiet"])
"""

COMPILED = """
from numba.core import event
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window
from cost_stream import MovingEdges

with event.install_recorder("numba:compile") as recorder:
    config = MapperConfig(planes=9, methods=("all", "Alg2/AtHc@2"))
    map_window(MovingEdges((64, 48), 3000), config)
starts = [e.data["dispatcher"] for _, e in recorder.buffer if e.is_start]
print(*starts)
"""


def run(code, *arguments):
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=with_tools())
    return done.stdout.split()


def test_nothing_heavy_is_imported_before_the_first_event(tmp_path):
    MovingEdges((64, 48), 3000).write(tmp_path / "edges")
    names = run(FIRST_EVENT, tmp_path / "edges", tmp_path / "map")
    modules = {name.partition(".")[0] for name in names}
    assert {"numba", "eventsweep"} <= modules
    assert not modules & set(HEAVY)


@pytest.mark.slow
def test_the_first_picture_waits_for_nothing_else(tmp_path):
    run(FIRST_PICTURE, tmp_path / "first")
    compiled, *names = run(FIRST_PICTURE, tmp_path / "second")
    assert int(compiled) == 0
    assert {"mujoco", "eventsweep.sim.simulate", "eventsweep.scenes.low_texture"} <= set(names)
    # No maps, no scores, and nothing that only draws textures.
    ours = ("emvs.mapper", "emvs.datasets", "emvs.dsi", "eval.scoring")
    assert not {f"eventsweep.{name}" for name in ours} & set(names)
    assert not {"scipy.ndimage", "open3d", "matplotlib", "pandas", "dash"} & set(names)


def test_a_second_process_compiles_nothing():
    run(COMPILED)
    assert run(COMPILED) == []
