"""Hard: a gymnasium in which balls bounce and roll, a bag swings, a tyre runs, a box falls."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.scenes.parts.furniture import BodyBuilder
from eventsweep.scenes.parts.shadows import bake
from eventsweep.scenes.parts.stock import faded, made, painted
from eventsweep.scenes.parts.texture_cache import kept
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

    from eventsweep.scenes.textures.noise import Image

_MJCF = Path(__file__).with_name("gym.xml")
_STEP_S = 0.0005
_STEPS_PER_RECORD = 2
RECORD_S = _STEP_S * _STEPS_PER_RECORD
"""Positions are recorded this often, s, and interpolated between."""


@dataclass(frozen=True)
class Bodies:
    """Where the bodies of a scene are at any time, see `sim.motion.Animation`.

    MuJoCo steps the scene's joints from their places in the MJCF with `start` velocities. The
    steps do not depend on when frames are taken, so any time can be asked for, in any order.

    Attributes:
        mjcf: the scene's file.
        build: adds the scene's geometry and joints, without shadows or pictures.
        start: velocity (linear m/s, then angular rad/s; one number for a hinge) by joint.
        max_interval_us: frames are never further apart, µs: what the bodies' speed demands.
    """

    mjcf: Path
    build: Callable[[mujoco.MjSpec], None]
    start: tuple[tuple[str, tuple[float, ...]], ...]
    max_interval_us: int

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, t_s: float) -> None:
        """Sets the joint positions in `data` for time `t_s`, s from the start.

        Raises:
            InputError: a time before the start, or another scene's model.
        """
        if t_s < 0:
            raise InputError(f"bodies at {t_s} s: their motion starts at 0 s")
        recording = _recording(self)
        if model.nq != recording.model.nq:
            raise InputError(
                f"a model of {model.nq} joint positions, but the bodies of {self.mjcf.name} have "
                f"{recording.model.nq}: pass the model of the same scene"
            )
        data.qpos[:] = recording.positions(t_s)


class _Recording:
    """Joint positions every RECORD_S, made as far as they are asked for."""

    def __init__(self, bodies: Bodies) -> None:
        mj: Any = import_mujoco()
        spec = mj.MjSpec.from_file(str(bodies.mjcf))
        bodies.build(spec)
        spec.option.timestep = _STEP_S
        self._mj = mj
        self.model = spec.compile()
        self._data = mj.MjData(self.model)
        for joint, velocity in bodies.start:
            self._data.joint(joint).qvel[:] = velocity
        self._records: list[NDArray[np.float64]] = [self._data.qpos.copy()]

    def positions(self, t_s: float) -> NDArray[np.float64]:
        """Joint positions (nq,) at `t_s`, interpolated linearly, quaternions normalised."""
        before = int(t_s / RECORD_S)
        while len(self._records) < before + 2:
            self._mj.mj_step(self.model, self._data, _STEPS_PER_RECORD)
            self._records.append(self._data.qpos.copy())
        share = t_s / RECORD_S - before
        qpos = (1 - share) * self._records[before] + share * self._records[before + 1]
        self._mj.mj_normalizeQuat(self.model, qpos)
        return qpos


@cache
def _recording(bodies: Bodies) -> _Recording:
    return _Recording(bodies)


@kept
def _textures() -> Mapping[str, Image]:
    from eventsweep.scenes import textures as tx
    from eventsweep.scenes.parts.print import plain_carton

    maple = ((0.42, 0.31, 0.20), (0.70, 0.55, 0.38))
    mat = ((0.14, 0.24, 0.42), (0.34, 0.46, 0.64))
    stripes = ((0.74, 0.3, 0.16), (0.88, 0.86, 0.8), (0.2, 0.36, 0.6))
    return made(
        381,
        {
            "parquet": lambda rng: tx.wood((896, 768), rng, planks=40, colours=maple),
            "wall": painted(0.62, (1, 0.98, 0.93), 0.05),
            "brick": lambda rng: tx.bricks((512, 512), rng, 18, 6),
            "mat": lambda rng: tx.cloth((256, 256), rng, mat),
            "plank": lambda rng: tx.wood((96, 512), rng, colours=maple),
            "banner": lambda rng: tx.label((256, 640), rng, (0.2, 0.34, 0.6)),
            "ball": lambda rng: tx.ball(192, rng, stripes, worn=0.2),
            "medicine": lambda rng: tx.ball(
                128, rng, ((0.36, 0.22, 0.14), (0.46, 0.3, 0.2), (0.6, 0.52, 0.44)), worn=0.5
            ),
            "basket": lambda rng: tx.solid(128, rng, (0.5, 0.22, 0.1), (0.78, 0.46, 0.26), bands=6),
            "tyre": lambda rng: tx.solid(128, rng, (0.05, 0.05, 0.06), (0.34, 0.34, 0.36), bands=9),
            "crate": lambda rng: tx.crate(192, rng),
            "leather": lambda rng: tx.solid(
                128, rng, (0.34, 0.12, 0.1), (0.6, 0.28, 0.22), bands=5
            ),
            "carton": faded(lambda rng: plain_carton(192, rng), 0.2),
        },
    )


def _build(spec: mujoco.MjSpec) -> None:
    """Everything that bodies touch, and the bodies."""
    _static(spec)
    _moving(spec)
    _make_solid(spec)


def _edit(spec: mujoco.MjSpec) -> None:
    _static(spec)
    bake(spec, floor="parquet")
    _moving(spec)
    _make_solid(spec)


def _static(spec: mujoco.MjSpec) -> None:
    """Wall bars, bench, mats, vaulting box, a hoop and a banner."""
    bars = BodyBuilder(spec, "bars", (-1.75, 6.86, 0))
    for x in (-0.9, 0.0, 0.9):
        bars.box((0.03, 0.06, 1.3), (x, 0, 1.3), "plank")
    for k in range(13):
        bars.rod((-0.9, -0.04, 0.2 + 0.19 * k), (0.9, -0.04, 0.2 + 0.19 * k), 0.018, "plank")
    vault = BodyBuilder(spec, "vault", (1.75, 5.6, 0), -12)
    for k in range(4):
        vault.box((0.5 - 0.03 * k, 0.28 - 0.03 * k, 0.11), (0, 0, 0.12 + 0.23 * k), "crate")
    vault.box((0.4, 0.2, 0.06), (0, 0, 0.98), "leather")
    at = BodyBuilder(spec, "gear")
    at.box((1.1, 0.16, 0.025), (-1.55, 4.6, 0.42), "plank", (0, 0, 8))
    for x in (-2.4, -0.7):
        at.box((0.03, 0.14, 0.2), (x, 4.6 + 0.14 * (x + 1.55), 0.2), "plank", (0, 0, 8))
    at.box((0.9, 0.6, 0.05), (0.35, 5.7, 0.05), "mat", (0, 0, 4))
    at.box((0.06, 0.6, 0.9), (2.6, 3.1, 0.86), "mat", (0, 12, 0))
    at.box((0.55, 0.03, 0.4), (0.65, 6.9, 2.75), "pad")
    at.box((0.9, 0.008, 0.36), (-1.7, 6.93, 3.2), "banner")
    for k in range(8):
        a, b = 0.785 * k, 0.785 * (k + 1)
        ring = [(0.65 + 0.22 * math.cos(t), 6.6 + 0.22 * math.sin(t), 2.45) for t in (a, b)]
        at.rod(ring[0], ring[1], 0.011, "red")
    at.box((0.3, 0.25, 0.22), (-2.5, 2.9, 0.22), "carton", (0, 0, 20))


def _moving(spec: mujoco.MjSpec) -> None:
    """The bodies, each on a joint of its own name."""
    import mujoco

    sphere, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    _free(spec, "basketball", (-1.35, 3.3, 1.45), sphere, (0.12, 0, 0), "basket", 0.6)
    _free(spec, "beach_ball", (-1.05, 2.1, 1.25), sphere, (0.19, 0, 0), "ball", 0.15)
    _free(spec, "medicine_ball", (1.75, 3.9, 0.165), sphere, (0.165, 0, 0), "medicine", 4.0)
    _free(spec, "small_ball", (1.2, 2.6, 1.1), sphere, (0.045, 0, 0), "ball", 0.06)
    _free(spec, "falling_box", (-0.75, 4.0, 1.5), box, (0.22, 0.17, 0.15), "carton", 1.5)
    tyre = mujoco.mjtGeom.mjGEOM_CYLINDER
    _free(spec, "tyre", (2.3, 4.75, 0.305), tyre, (0.30, 0.09, 0), "tyre", 6.0, (1, 1, 0, 0))
    bag = spec.worldbody.add_body(name="bag", pos=(0.85, 3.2, 4.3))
    half = 0.5 * 0.62  # it starts 35.5 degrees to the left
    bag.quat = [math.cos(half), 0, math.sin(half), 0]
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    bag.add_joint(name="bag", type=hinge, axis=(0, 1, 0), damping=0.05)
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    rope = [0, 0, -0.02, 0, 0, -1.85]
    bag.add_geom(
        name="bag_rope", type=capsule, size=(0.012, 0, 0), fromto=rope, material="rope", mass=0.2
    )
    body = [0, 0, -2.0, 0, 0, -2.75]
    bag.add_geom(
        name="bag", type=capsule, size=(0.19, 0, 0), fromto=body, material="leather", mass=18.0
    )


def _free(
    spec: mujoco.MjSpec,
    name: str,
    at_m: tuple[float, float, float],
    kind: mujoco.mjtGeom,
    size_m: tuple[float, float, float],
    material: str,
    mass_kg: float,
    quat: tuple[float, float, float, float] = (1, 0, 0, 0),
) -> None:
    norm = sum(q * q for q in quat) ** 0.5
    body = spec.worldbody.add_body(name=name, pos=at_m, quat=[q / norm for q in quat])
    body.add_freejoint(name=name)
    body.add_geom(name=name, type=kind, size=size_m, material=material, mass=mass_kg)


def _make_solid(spec: mujoco.MjSpec) -> None:
    """Lets all geoms of a scene touch each other; rubber on wood, nearly elastic."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity, geom.condim = 1, 1, 6
        # Negative numbers are stiffness and damping per mass: a ball keeps most of its height.
        geom.solref = [-20000.0, -12.0]
        geom.friction = [0.7, 0.008, 0.002]


def _motion(_duration_s: float, seed: int) -> HeadSway:
    rest = look_at((0, 0, 1.5), (0.1, 4.0, 1.1))
    return HeadSway.seeded(rest, (0.08, 0.04, 0.03), (1.5, 2.5, 1.5), (1.5, 0.75), seed)


SCENE = Scene(
    name="moving-objects",
    summary="hard: balls, a tyre, a box and a swinging bag cross a gymnasium, 1.5 to 8 m",
    mjcf=_MJCF,
    textures=_textures,
    motion=_motion,
    depth_range_m=(1.5, 8.0),
    edit=_edit,
    animate=Bodies(
        mjcf=_MJCF,
        build=_build,
        start=(
            ("basketball", (1.5, 0.1, 0.6, 0.0, 3.0, 1.0)),
            ("beach_ball", (2.1, 0.15, 0.9, 0.0, 4.0, 2.0)),
            ("medicine_ball", (-1.7, -0.1, 0.0, 0.0, -10.3, 0.0)),
            ("small_ball", (-2.6, 0.4, 1.2, 0.0, 0.0, 0.0)),
            ("falling_box", (0.9, 0.0, 0.5, 1.5, 3.0, 0.5)),
            ("tyre", (-1.5, 0.0, 0.0, 0.0, 0.0, 5.0)),
            ("bag", (0.0,)),
        ),
        max_interval_us=1000,
    ),
)
