"""Worlds of panels for the simulator: the scene and the rig that show what a `RayWorld` shows."""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.scene import Scene
from eventsweep.sim.simulate import simulate
from ray_world import Panel, Pose, RayCamera, RayWorld

_MJCF = """<mujoco><visual>
<headlight ambient="{light} {light} {light}" diffuse="0 0 0" specular="0 0 0"/>
</visual><asset>{assets}</asset><worldbody>{bodies}</worldbody></mujoco>"""
_ASSETS = """<texture name="t{k}" type="2d" builtin="flat" width="2" height="2"/>
<material name="m{k}" texture="t{k}" specular="0" shininess="0" reflectance="0"/>
<mesh name="q{k}" inertia="shell" vertex="{vertices}" texcoord="{places}" face="{faces}"/>"""
_GEOM = '<geom type="mesh" mesh="q{k}" material="m{k}" contype="0" conaffinity="0" mass="1"/>'
_SLIDES = "".join(
    f'<joint name="{axis}{{k}}" type="slide" axis="{direction}"/>'
    for axis, direction in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
)
_BODY = '<body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{slides}{geom}</body>'
_FACES = "0 1 2 0 2 3 0 2 1 0 3 2"
"""Two triangles, seen from both sides."""
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


@dataclass(frozen=True)
class PanelMotion:
    """The camera's motion."""

    pose: Pose

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at a time, s."""
        return self.pose(float(t_s))


@dataclass(frozen=True)
class PanelDrift:
    """Moves the panels that move by themselves."""

    panels: tuple[Panel, ...]
    max_interval_us: int = 50_000

    def __call__(self, model: Any, data: Any, t_s: float) -> None:
        """Puts their joints where they are at a time, s."""
        for k, panel in enumerate(self.panels):
            for axis, speed_m_s in zip("xyz" * panel.moves, panel.velocity_m_s, strict=False):
                data.qpos[model.joint(f"{axis}{k}").qposadr[0]] = speed_m_s * t_s


def panel_mjcf(world: RayWorld) -> str:
    """The world as MJCF, lit by the headlight's ambient part alone; textures t0, t1, ... empty."""
    assets, bodies = [], []
    for k, panel in enumerate(world.panels):
        c, u, v = (np.array(side) for side in (panel.centre_m, panel.across_m, panel.down_m))
        corners = [c + (2 * a - 1) * u + (2 * b - 1) * v for a, b in _CORNERS]
        places = panel.repeats * np.array(_CORNERS)
        assets.append(_ASSETS.format(k=k, vertices=_words(corners), places=_words(places),
                                     faces=_FACES))  # fmt: skip
        geom = _GEOM.format(k=k)
        body = _BODY.format(slides=_SLIDES.format(k=k), geom=geom)
        bodies.append(body if panel.moves else geom)
    return _MJCF.format(light=world.ambient, assets="".join(assets), bodies="".join(bodies))


def _words(rows: Any) -> str:
    return " ".join(f"{number:.9g}" for number in np.ravel(rows))


def panel_scene(
    world: RayWorld, depth_range_m: tuple[float, float], folder: Path, *, hdr: bool = False
) -> Scene:
    """The world as a scene, whose model is written to `folder`."""
    path = folder / "panels.xml"
    path.write_text(panel_mjcf(world))

    def textures() -> Mapping[str, NDArray[np.uint8]]:
        return {f"t{k}": np.repeat(p.texture[..., None], 3, 2) for k, p in enumerate(world.panels)}

    def motion(_duration_s: float, _seed: int) -> PanelMotion:
        return PanelMotion(world.T_world_cam)

    drift = PanelDrift(world.panels) if any(panel.moves for panel in world.panels) else None
    return Scene(
        "panels", "Textured panels.", path, textures, motion, depth_range_m, hdr=hdr, animate=drift
    )


def panel_rig(camera: RayCamera) -> Rig:
    """The rig of one camera, at the body's origin."""
    size_px = camera.width_px, camera.height_px
    focal_px = camera.focal_px, camera.focal_px
    lens: Any = camera.model, camera.distortion
    one = Camera(*size_px, *focal_px, camera.cx_px, camera.cy_px, *lens)
    return Rig("panels", (one,), (np.eye(4),), ("left",))


def simulated_events(
    scene: Scene, rig: Rig, config: SimConfig, notice: Callable[[str], None] = lambda _line: None
) -> Events:
    """All events of the rig's first camera as `simulate` makes them."""
    with tempfile.TemporaryDirectory() as folder:
        simulate(scene, rig, config, 0, Path(folder) / "clip", notice=notice)
        recording = Sequence.open(Path(folder) / "clip")
        first_us, last_us = recording.event_span_us(0)
        return recording.events(0, first_us, last_us + 1)
