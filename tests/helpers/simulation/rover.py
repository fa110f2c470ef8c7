"""A small robot of the tests' own: a hull on wheels of its own weight, an arm, two cameras."""

from pathlib import Path

import cv2
import numpy as np

MJCF = """<mujoco model="rover">
<compiler meshdir="." texturedir="."/>
<option timestep="0.002"/>
<visual><map znear="0.002"/></visual>
<asset>
  <texture name="leaves" type="2d" file="leaves.png"/>
  <material name="leaves" texture="leaves" texrepeat="3 3" specular="0"/>
  <mesh name="hull" file="hull.obj"/>
</asset>
<worldbody>
  <light pos="0 0 4" dir="0 0 -1"/>
  <geom name="floor" type="plane" size="6 6 .1" material="leaves"/>
  <geom name="wall" type="box" size=".1 3 1.5" pos="3 0 1.5" material="leaves"/>
  <geom name="crate" type="box" size=".3 .3 .3" pos="1.8 .5 .3" material="leaves"/>
  <body name="rover" pos="0 0 .25">
    <freejoint name="root"/>
    <geom name="hull" type="mesh" mesh="hull" mass="5" material="leaves"/>
    <geom type="sphere" size=".08" pos="-.15 0 -.1" mass=".5"/>
    <geom type="sphere" size=".08" pos=".15 .1 -.1" mass=".5"/>
    <geom type="sphere" size=".08" pos=".15 -.1 -.1" mass=".5"/>
    <site name="eye" pos=".22 0 .1"/>
    <camera name="left" pos=".22 .05 .1" xyaxes="0 -1 0 0 0 1" fovy="60" resolution="64 48"/>
    <camera name="right" pos=".22 -.05 .1" xyaxes="0 -1 0 0 0 1" fovy="60" resolution="64 48"/>
    <camera name="blind" pos=".22 0 .1" xyaxes="0 -1 0 0 0 1"/>
    <body name="arm" pos=".2 0 .05">
      <joint name="swing" type="hinge" axis="0 0 1" damping=".1"/>
      <geom name="stick" type="capsule" fromto="0 0 0 .4 0 .1" size=".015" mass=".1"
        material="leaves"/>
    </body>
  </body>
  <body name="kite" mocap="true" pos="1.5 -.4 .8">
    <geom name="sail" type="box" size=".02 .1 .1" material="leaves"/>
  </body>
</worldbody>
<actuator><motor name="push" joint="swing" gear=".5"/></actuator>
<keyframe><key name="go" qpos="0 0 .25 1 0 0 0 .3" qvel=".8 0 0 0 0 .3 1"/></keyframe>
</mujoco>"""
URDF = """<robot name="stand">
<link name="base"><visual><geometry><mesh filename="package://stand/base.obj"/></geometry></visual>
<collision><geometry><box size="4 4 .1"/></geometry></collision></link>
<link name="head"><inertial><mass value="1"/>
<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="neck" type="revolute"><parent link="base"/><child link="head"/>
<origin xyz="0 0 1" rpy="0 .6 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_HULL = (
    *((0.2 * x, 0.15 * y, -0.05) for x, y in _CORNERS),
    *((0.15 * x, 0.1 * y, 0.05) for x, y in _CORNERS),
)
_FACES = ((1, 3, 2), (1, 4, 3), (5, 6, 7), (5, 7, 8), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6),
          (3, 4, 8), (3, 8, 7), (4, 1, 5), (4, 5, 8))  # fmt: skip


def write_urdf(folder: Path) -> Path:
    """Writes a stand with a head that turns; its floor is a mesh to look at, a box to touch."""
    _write_mesh(folder / "base.obj", 10)
    path = folder / "stand.urdf"
    path.write_text(URDF)
    return path


def write(folder: Path, mjcf: str = MJCF) -> Path:
    """Writes the robot with its mesh and texture; returns its MJCF."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(20, 250, (48, 48, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, (192, 192), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(folder / "leaves.png"), picture)
    _write_mesh(folder / "hull.obj", 1)
    path = folder / "rover.xml"
    path.write_text(mjcf)
    return path


def _write_mesh(path: Path, wider: float) -> None:
    lines = [f"v {wider * x} {wider * y} {z}" for x, y, z in _HULL]
    lines += [f"f {a} {b} {c}" for a, b, c in _FACES]
    path.write_text("\n".join(lines) + "\n")
