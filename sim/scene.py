"""What a scene is: geometry in MJCF, textures, and the head's motion, generated or recorded."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.datasets.posed import CONVERTED, unit_stated
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.sim.config import ReplayConfig, SimConfig
from eventsweep.sim.mjcf import read_spec
from eventsweep.sim.motion import Animation, Motion
from eventsweep.sim.motion.curves import CurveMotion, moved
from eventsweep.sim.motion.replay import Replay

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]
# Of a unit vector along the view: less than this in the horizontal plane has no heading.
_STEEP = 0.1


@dataclass(frozen=True)
class Scene:
    """One scene: static geometry, its textures, and how the head moves through it.

    Attributes:
        name: what the command line calls it.
        summary: one sentence.
        mjcf: the scene's MJCF file, without cameras and without the rig.
        textures: returns pixels (H, W, 3) uint8 for textures that the MJCF names; deterministic.
        motion: `motion(duration_s, seed)` is the head's curve over [0, `duration_s`]; the seed
            varies the motion (phases, amplitudes), never the geometry.
        depth_range_m: nearest and farthest z-depth that the cameras see; a hint for mappers.
        rig: default rig, see `sim.rigs`.
        duration_s: default length, s.
        edit: adds procedural geometry to the parsed spec, if any.
        hdr: draw light in floating point: the scene has parts brighter than 1 or darker than 8 bits
            can tell apart.
        log_eps: what to add to intensity before the logarithm where the user's configuration does
            not say; None for `SimConfig`'s own default. A scene with dark parts needs less.
        frames_rate_hz: pictures per second of an ordinary camera where the user's configuration
            does not say, Hz; 0 for none.
        animate: moves the bodies that move by themselves, if any.
        clip_m: where the clipping planes lie, m; by default at half the nearest and four times the
            farthest depth.
        lamp_at: (4, 4) where MuJoCo's headlight stays; by default it goes with the rig.
        carrier: the body that carries the rig; a camera may lie inside its geoms, whose back faces
            are not drawn.
    """

    name: str
    summary: str
    mjcf: Path
    textures: Callable[[], Mapping[str, NDArray[np.uint8]]]
    motion: Callable[[float, int], Motion]
    depth_range_m: tuple[float, float]
    rig: str = "davis346"
    duration_s: float = 0.5
    edit: Callable[[mujoco.MjSpec], None] | None = None
    hdr: bool = False
    log_eps: float | None = None
    animate: Animation | None = None
    frames_rate_hz: float = 0.0
    clip_m: tuple[float, float] | None = None
    lamp_at: Array | None = None
    carrier: str = ""

    def __repr__(self) -> str:
        near_m, far_m = self.depth_range_m
        return (
            f"Scene({self.name!r}, {self.duration_s:g} s, {near_m:g} to {far_m:g} m, rig "
            f"{self.rig}: {self.summary})"
        )

    def configured(self, config: SimConfig) -> SimConfig:
        """Returns `config` with the scene's own defaults for what its user did not set.

        Raises:
            InputError: a setting that has no effect, see `SimConfig.check_heeded`.
        """
        own: dict[str, object] = {}
        if self.log_eps is not None and "log_eps" not in config.model_fields_set:
            own["log_eps"] = self.log_eps
        if config.frames.rate_hz is None:
            own["frames"] = config.frames.model_copy(update={"rate_hz": self.frames_rate_hz})
        full = config.model_copy(update=own)
        full.check_heeded()
        return full

    def spec(self) -> mujoco.MjSpec:
        """Returns the scene as an editable MuJoCo specification, textures in place.

        Raises:
            InputError: the MJCF cannot be parsed, or lacks a texture that `textures` provides.
        """
        if not self.mjcf.is_file():
            raise InputError(f"scene {self.name} has no file {self.mjcf}: create it or fix `mjcf`")
        spec = read_spec(self.mjcf)
        for name, pixels in self.textures().items():
            put_texture(spec, name, pixels)
        if self.edit is not None:
            self.edit(spec)
        return spec


def put_texture(spec: mujoco.MjSpec, name: str, pixels: NDArray[np.uint8]) -> None:
    """Puts `pixels` (H, W, 3) uint8, first row at the top of the picture, into texture `name`."""
    texture = spec.texture(name)
    if texture is None:
        known = ", ".join(sorted(t.name for t in spec.textures)) or "none"
        raise InputError(
            f"no texture named {name!r} in the MJCF (it has: {known}): declare it there"
        )
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
        raise InputError(
            f"texture {name!r} is {pixels.dtype} {pixels.shape}: needs uint8 (H, W, 3)"
        )
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()


@dataclass(frozen=True, eq=False)
class ReplayedMotion:
    """Stands in a scene for its own motion, at whose start the recorded one is placed."""

    recorded: Trajectory
    config: ReplayConfig
    T_body_cam: Array
    own: Callable[[float, int], Motion]

    def __call__(self, duration_s: float, seed: int) -> CurveMotion:
        """The head's curve over [0, `duration_s`]."""
        names = ("position_hz", "rotation_hz", "start_s", "scale")
        limits = ("max_gap_s", "max_speed_m_s", "max_rate_rad_s")
        settings = {name: getattr(self.config, name) for name in (*names, *limits)}
        replay = Replay(**settings, duration_s=duration_s, T_body_cam=self.T_body_cam)
        as_recorded = replay.motion(self.recorded)
        T_world_start = as_recorded.T_world_body(0.0)
        T_scene_start = self.own(duration_s, seed).T_world_body(0.0)
        return moved(as_recorded, _placed(T_world_start, T_scene_start, self.config), np.eye(4))


def replayed(scene: Scene, config: SimConfig) -> tuple[Scene, SimConfig]:
    """Returns the scene with the configured trajectory for a motion, and the file's hash noted.

    Raises:
        InputError: a file that cannot be read, or is not the one whose hash is given.
    """
    path = config.replay.trajectory
    if path is None:
        return scene, config
    with unit_stated(CONVERTED):
        recorded, digest = read_poses(path), hashlib.sha256(path.read_bytes()).hexdigest()
    if config.replay.sha256 not in ("", digest):
        raise InputError(f"{path}: its SHA-256 is not {config.replay.sha256}: restore that file")
    noted = config.replay.model_copy(update={"sha256": digest})
    motion = ReplayedMotion(recorded, noted, _hand_eye(noted), scene.motion)
    return replace(scene, motion=motion), config.model_copy(update={"replay": noted})


def _hand_eye(config: ReplayConfig) -> Array:
    if config.hand_eye is None:
        if config.imu_cam is not None:
            raise InputError("replay.imu_cam without replay.hand_eye: give both, or neither")
        return np.eye(4)
    from eventsweep.emvs.datasets.custom import (
        read_hand_eye,  # the readers of all formats come with it
    )

    return read_hand_eye(Path(config.hand_eye), config.imu_cam)


def _placed(T_world_start: Array, T_scene_start: Array, config: ReplayConfig) -> Array:
    """`T_scene_world` (4, 4) that carries the recorded start where `config` wants it."""
    T_scene_world = np.eye(4)
    if config.place == "start":
        T_scene_world = T_scene_start @ se3.inverse(T_world_start)
    elif config.place == "level":
        turn = _heading(T_scene_start, "the scene's") - _heading(T_world_start, "the trajectory's")
        T_scene_world = _turned(turn, T_world_start[:3, 3], T_scene_start[:3, 3])
    start_m = (T_scene_world @ T_world_start)[:3, 3]
    shifted_m = start_m + np.asarray(config.shift_m)
    return _turned(float(np.radians(config.heading_deg)), start_m, shifted_m) @ T_scene_world


def _heading(T_world_cam: Array, whose: str) -> float:
    """Direction of view seen from above, rad."""
    x, y = T_world_cam[:2, 2].tolist()
    if np.hypot(x, y) < _STEEP:
        raise InputError(
            f"place=level, but {whose} first view is straight up or down: use place=start, or give "
            "the hand-eye calibration"
        )
    return float(np.arctan2(y, x))


def _turned(angle_rad: float, from_m: Array, to_m: Array) -> Array:
    """Turns about the vertical through a point, which goes to another."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    T = np.eye(4)
    T[:2, :2] = [[cosine, -sine], [sine, cosine]]
    T[:3, 3] = to_m - T[:3, :3] @ from_m
    return T
