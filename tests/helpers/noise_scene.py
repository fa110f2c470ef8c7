"""A scene of noise on boxes, simulated in many small parts, and how to stop that."""

import hashlib
from pathlib import Path

import numpy as np

import mujoco_scenes as made
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

# Every chunk is a part, so that there is something to resume after each.
CONFIG = SimConfig(
    truth_interval_s=0.01, truth=("flow", "segmentation", "boundary", "twist", "event_depth")
)
MJCF = """<mujoco>{dark}<asset>
<texture name="noise" type="2d" builtin="flat" width="2" height="2"/>
<material name="noise" texture="noise" emission="1" specular="0" texuniform="true"/></asset>
<worldbody>
<geom name="box" type="box" size=".1 .1 .1" pos="1 .1 1" material="noise"/>
<geom name="wall" type="box" size=".1 3 3" pos="2.5 0 1" material="noise"/>
</worldbody></mujoco>"""


def textures():
    return {"noise": np.random.default_rng(0).integers(20, 250, (64, 64, 3), np.uint8)}


def motion(duration_s, seed):
    rest = look_at((0, 0, 1), (2, 0, 1))
    return HeadSway.seeded(rest, (0.03, 0.02, 0.02), (2, 3, 1), (0.8, 0.3), seed, (0.2, 0, 0))


def scene_in(folder: Path) -> Scene:
    mjcf = folder / "noise.xml"
    mjcf.write_text(MJCF.format(dark=made.DARK))
    return Scene("noise", "Noise on boxes.", mjcf, textures, motion, (0.7, 3.0), duration_s=0.05)


def contents(path: Path) -> dict[str, str]:
    files = sorted(p for p in path.rglob("*") if p.is_file())
    return {str(p.relative_to(path)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


class Killed(BaseException):
    """Stands for what the code cannot foresee."""


def stop_at(t_us):
    def progress(_stage, done_us, _total_us):
        if done_us >= t_us:
            raise Killed

    return progress
