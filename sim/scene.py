"""What a scene is: geometry in MJCF, textures and head motion in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from sim.config import SimConfig
from sim.motion.curves import Motion

if TYPE_CHECKING:
    import mujoco


class Animation(Protocol):
    """Moves a scene's bodies; a pure function of time, whatever was asked for before."""

    @property
    def max_interval_us(self) -> int:
        """Frames must never be further apart, µs, lest a body cross the view between two."""
        ...

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, t_s: float) -> None:
        """Sets joint positions (and mocap poses) in `data` for `t_s`, s from the start."""
        ...


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

    def configured(self, config: SimConfig) -> SimConfig:
        """Returns `config` with the scene's own defaults for what its user did not set."""
        own: dict[str, object] = {}
        if self.log_eps is not None and "log_eps" not in config.model_fields_set:
            own["log_eps"] = self.log_eps
        if config.frames.rate_hz is None:
            own["frames"] = config.frames.model_copy(update={"rate_hz": self.frames_rate_hz})
        return config.model_copy(update=own)

    def spec(self) -> mujoco.MjSpec:
        """Returns the scene as an editable MuJoCo specification, textures in place.

        Raises:
            InputError: the MJCF cannot be parsed, or lacks a texture that `textures` provides.
        """
        from sim.graphics import import_mujoco

        mujoco = import_mujoco()
        if not self.mjcf.is_file():
            raise InputError(f"scene {self.name} has no file {self.mjcf}: create it or fix `mjcf`")
        try:
            spec = mujoco.MjSpec.from_file(str(self.mjcf))
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{self.mjcf} is no usable MJCF ({reason}): correct it") from error
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
            f"texture {name!r} came as {pixels.dtype} {pixels.shape}: need uint8 (H, W, 3)"
        )
    texture.height, texture.width, texture.nchannel = pixels.shape
    texture.data = np.ascontiguousarray(pixels).tobytes()
