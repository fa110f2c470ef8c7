"""Small scenes and rigs for the simulator's tests, and how to stop a simulation."""

from pathlib import Path

import numpy as np

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

DARK = '<visual><headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/></visual>'
NOISE = (
    '<asset><texture name="noise" type="2d" builtin="flat" width="2" height="2"/>'
    '<material name="noise" texture="noise" emission="1" specular="0" texuniform="true"/></asset>'
)
# Every chunk is a part, so that there is something to resume after each.
CONFIG = SimConfig(
    truth_interval_s=0.01, truth=("flow", "segmentation", "boundary", "twist", "event_depth")
)
BOXES = """
<light pos="0 0 4"/>
<geom type="box" size=".3 .2 .25" pos="1.6 .5 .9" euler="10 20 30" rgba=".9 .3 .2 1"/>
<geom type="box" size=".1 .4 .1" pos="1.2 -.4 1.1" euler="-5 0 40" rgba=".2 .8 .3 1"/>
<geom type="box" size=".1 3 1.2" pos="4 0 .5" rgba=".3 .4 .9 1"/>
<geom type="plane" size="6 6 .1" rgba=".6 .6 .6 1"/>
"""


def small_rig() -> Rig:
    """Off-centre principal points, unequal focal lengths, a turned and shifted second camera."""
    left = Camera(160, 120, 118.3, 121.7, 71.4, 66.2)
    right = Camera(144, 112, 109.6, 104.2, 79.25, 48.9)
    T_body_right = np.linalg.inv(look_at((0, 0, 0), (1, 0, 0))) @ look_at(
        (0, 0, 0), (1, 0.05, 0.02)
    )
    T_body_right[:3, 3] = (0.1, 0.004, -0.003)
    return Rig("small", (left, right), (np.eye(4), T_body_right))


def tiny_rig() -> Rig:
    """Two cameras of 48x36 px, 8 cm apart."""
    T_body_right = np.eye(4)
    T_body_right[0, 3] = 0.08
    cameras = Camera(48, 36, 40, 40, 22.5, 19.0), Camera(48, 36, 40, 40, 25.0, 17.5)
    return Rig("tiny", cameras, (np.eye(4), T_body_right))


def spec(geoms: str, materials: str = ""):
    """A spec of some geoms with no light but their own."""
    assets = f"<asset>{materials}</asset>" if materials else ""
    return import_mujoco().MjSpec.from_string(_mjcf(geoms, assets))


def card_spec(corners: np.ndarray, behind_m=(0.01, 0, 0)):
    """A bright quadrilateral (4, 3) in front of nothing, thick by `behind_m`."""
    built = spec("")
    vertices = np.concatenate([corners, corners + np.array(behind_m)])
    mesh = built.add_mesh(name="card", uservert=vertices.ravel().tolist())
    material = built.add_material(name="bright", emission=1, rgba=[1, 1, 1, 1])
    built.worldbody.add_geom(
        type=import_mujoco().mjtGeom.mjGEOM_MESH, meshname=mesh.name, material=material.name
    )
    return built


def polygon_moments(corners: np.ndarray) -> tuple[float, float, float]:
    """Area and centroid of a polygon (N, 2)."""
    x, y = corners.T
    next_x, next_y = np.roll(x, -1), np.roll(y, -1)
    cross = x * next_y - next_x * y
    area = cross.sum() / 2
    return (
        abs(area),
        ((x + next_x) * cross).sum() / (6 * area),
        ((y + next_y) * cross).sum() / (6 * area),
    )


def textures():
    return {"noise": np.random.default_rng(0).integers(20, 250, (64, 64, 3), np.uint8)}


def motion(duration_s, seed):
    rest = look_at((0, 0, 1), (2, 0, 1))
    return HeadSway.seeded(rest, (0.03, 0.02, 0.02), (2, 3, 1), (0.8, 0.3), seed, (0.2, 0, 0))


def noise_scene(folder: Path) -> Scene:
    """A textured box before a textured wall, and a head that sways by the seed."""
    mjcf = folder / "noise.xml"
    box = '<geom name="box" type="box" size=".1 .1 .1" pos="1 .1 1" material="noise"/>'
    wall = '<geom name="wall" type="box" size=".1 3 3" pos="2.5 0 1" material="noise"/>'
    mjcf.write_text(_mjcf(box + wall, NOISE))
    return Scene("noise", "Noise on boxes.", mjcf, textures, motion, (0.7, 3.0), duration_s=0.05)


class Killed(BaseException):
    """Stands for what the code cannot foresee."""


def stop_at(t_us):
    def progress(_stage, done_us, _total_us):
        if done_us >= t_us:
            raise Killed

    return progress


def _mjcf(geoms: str, assets: str = "") -> str:
    return f"<mujoco>{DARK}{assets}<worldbody>{geoms}</worldbody></mujoco>"
