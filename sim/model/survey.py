"""Looks around in a scene before it is simulated: how near things are, and what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from emvs.errors import InputError
from emvs.geometry.rig import Rig
from sim.config import SimConfig
from sim.rendering.renderer import Frame, StereoRenderer
from sim.sampling import MIRRORS, why_linear
from sim.scene import Scene, replayed

_LOOKS = 9
# Between neighbouring pixels, in log intensity: what a contrast threshold of 0.2 notices.
_EDGE = 0.1
_FEW_EDGES = 0.002
_SIZE_STEPS = 2


def survey(
    scene: Scene, rig: Rig, config: SimConfig, seed: int, notice: Callable[[str], None]
) -> Scene:
    """Returns the scene with the depth range that its cameras see; tells what may be unwanted.

    Args:
        scene: whose depth range is the clipping planes'.
        rig: the cameras.
        config: the parameters.
        seed: of the motion.
        notice: told in one line each.

    Raises:
        InputError: no surface is seen, or one reaches through the nearer clipping plane.
    """
    duration_s = config.duration_s or scene.duration_s
    moved, _ = replayed(scene, config)
    motion = moved.motion(duration_s, seed)
    near_m, far_m, edges = np.inf, 0.0, []
    with StereoRenderer(
        scene.spec(), rig, 1, scene.depth_range_m,
        animate=scene.animate, clip_m=scene.clip_m, lamp_at=scene.lamp_at,
    ) as renderer:  # fmt: skip
        for t_s in np.linspace(0, duration_s, _LOOKS).tolist():
            renderer.at(t_s)
            T_world_body = motion.T_world_body(t_s)
            for k in range(len(rig)):
                frame = renderer.frame(k, T_world_body)
                depth_m = frame.nearest_depth_m[np.isfinite(frame.nearest_depth_m)]
                near_m = min(near_m, float(depth_m.min(initial=np.inf)))
                far_m = max(far_m, float(depth_m.max(initial=0.0)))
                edges.append(_edge_share(frame, config.log_eps))
    if not far_m:
        raise InputError(
            f"no camera of rig {rig.name} sees a surface of {scene.name}: mind where the rig is "
            "mounted and looks (bodies and sites look along x, z up)"
        )
    _tell(scene, near_m, float(np.mean(edges)), notice)
    return replace(scene, depth_range_m=(_rounded(0.9 * near_m), _rounded(1.1 * far_m)))


def _edge_share(frame: Frame, log_eps: float) -> float:
    """Share of pixels that differ from the next one in their row or column."""
    log = np.log(frame.intensity + log_eps)
    across, down = np.abs(np.diff(log, axis=1)), np.abs(np.diff(log, axis=0))
    return float(np.mean(across > _EDGE) + np.mean(down > _EDGE))


def _tell(scene: Scene, near_m: float, edges: float, notice: Callable[[str], None]) -> None:
    assert scene.clip_m is not None
    if near_m < 1.5 * scene.clip_m[0]:
        notice(
            f"{scene.name}: a surface is {near_m:.3g} m away, at the nearer clipping plane "
            f"({scene.clip_m[0]:.3g} m), and may be cut: lower visual/map/znear in the model"
        )
    if edges < _FEW_EDGES:
        notice(
            f"{scene.name}: {100 * edges:.2g} % of the pixels lie on edges, so there will be few "
            "events: give surfaces textures, or add lights"
        )
    if why_linear(scene) == MIRRORS:
        notice(
            f"{scene.name}: a surface mirrors, which takes plain frames close together: set the "
            "reflectance of its material to 0 for a simulation several times as fast"
        )


def _rounded(value: float) -> float:
    return float(f"{value:.{_SIZE_STEPS}g}")
