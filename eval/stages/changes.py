"""What a study makes of a scene: another rig, way, light or texture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.motion import Motion
from eventsweep.sim.scene import Scene

if TYPE_CHECKING:
    import mujoco

Image = NDArray[np.uint8]
WAY_M = 0.25


@dataclass(frozen=True)
class Straight:
    """A straight way through the middle of another motion, in one direction, without turning.

    A heading of 0 is along camera 0's x axis, 90 along its z axis; the way is of `WAY_M`.
    """

    T_world_middle: NDArray[np.float64]
    heading_deg: float
    duration_s: float

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at `t_s`."""
        angle = np.deg2rad(self.heading_deg)
        ahead = np.array([np.cos(angle), 0.0, np.sin(angle)])
        pose = self.T_world_middle.copy()
        pose[:3, 3] += WAY_M * (t_s / self.duration_s - 0.5) * (pose[:3, :3] @ ahead)
        return pose


def changed(scene: Scene, rig: Rig, change: Mapping[str, float]) -> tuple[Scene, Rig]:
    """The scene and the rig with a change.

    It may hold `baseline_m`, `heading_deg` (the head then goes straight), `light`, a factor on
    every lamp, and `texture_density`, how many times as dense the patterns of surfaces are.

    Raises:
        InputError: a density that is neither a whole number nor one over a whole number.
    """
    if "baseline_m" in change:
        rig = with_baseline(rig, change["baseline_m"])
    if "heading_deg" in change:
        scene = going_straight(scene, change["heading_deg"])
    if "light" in change:
        scene = lit(scene, change["light"])
    if "texture_density" in change:
        scene = patterned(scene, change["texture_density"])
    return scene, rig


def with_baseline(rig: Rig, baseline_m: float) -> Rig:
    """The rig with its first two cameras this far apart, in the direction that they have."""
    T_1 = rig.T_body_cam[1].copy()
    T_1[:3, 3] = rig.T_body_cam[0][:3, 3] + (T_1[:3, 3] - rig.T_body_cam[0][:3, 3]) * (
        baseline_m / rig.baseline_m()
    )
    return replace(rig, T_body_cam=(rig.T_body_cam[0], T_1, *rig.T_body_cam[2:]))


def going_straight(scene: Scene, heading_deg: float) -> Scene:
    """The scene with a straight way through the middle of its own motion."""

    def motion(duration_s: float, seed: int) -> Motion:
        middle = scene.motion(duration_s, seed).T_world_body(duration_s / 2)
        return Straight(middle, heading_deg, duration_s)

    return replace(scene, motion=motion)


def lit(scene: Scene, factor: float) -> Scene:
    """The scene with every lamp `factor` times as bright, drawn in floats whatever the factor."""

    def edit(spec: mujoco.MjSpec) -> None:
        if scene.edit is not None:
            scene.edit(spec)
        for lamp in (*spec.lights, spec.visual.headlight):
            for kind in ("ambient", "diffuse", "specular"):
                setattr(lamp, kind, np.asarray(getattr(lamp, kind)) * factor)

    return replace(scene, edit=edit, hdr=True)


def patterned(scene: Scene, density: float) -> Scene:
    """The scene with every texture repeated, or of a part of it, `density` times as dense."""
    times, share = round(density), round(1 / density) if density > 0 else 0
    if not (density > 0 and np.isclose(density, times if density > 1 else 1 / share)):
        raise InputError(
            f"texture_density is {density:g}: needs a whole number such as 2, or one over it"
        )

    def textures() -> Mapping[str, Image]:
        return {name: _repeated(image, times, share) for name, image in scene.textures().items()}

    return replace(scene, textures=textures)


def _repeated(image: Image, times: int, share: int) -> Image:
    """A texture, or each of the six faces of a cube's, which lie one above the other."""
    height, width = image.shape[:2]
    faces = image.reshape(6, width, width, 3) if height == 6 * width else image[None]
    rows, columns = (max(2, size // max(share, 1)) for size in faces.shape[1:3])
    made = [np.tile(face[:rows, :columns], (max(times, 1), max(times, 1), 1)) for face in faces]
    return np.concatenate(made)
