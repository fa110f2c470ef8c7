"""Looks around in a scene before it is simulated: depth, light, and what is wrong.

Where it is dark, the steps of 8 bits are events of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import PixelConfig, SimConfig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion import Motion
from eventsweep.sim.rendering.base import Frame, Renderer, moving_ids
from eventsweep.sim.rendering.drawing import MIRRORS, MUJOCO, drawing_of
from eventsweep.sim.scene import Scene, replayed

FEW = 0.05
"""Share of pixels that may be darker or brighter than 8 bits can tell."""
# A step of 8 bits, in log intensity, as a share of the contrast threshold.
_COARSE = 0.25
# White is 1 but for rounding.
_ROUNDED = 1e-4
_LOOKS = 9
# Between neighbouring pixels, in log intensity: what a contrast threshold of 0.2 notices.
_EDGE = 0.1
_FEW_EDGES = 0.002
_SIZE_STEPS = 2


class _Seen(NamedTuple):
    """What the cameras saw at some times.

    Attributes:
        depths_m: nearest and farthest of each picture, of all surfaces.
        still_m: the same of surfaces that stay where they are: what a map is of.
        edges: share of pixels on edges, of each picture.
        beyond_8_bits: share of pixels too dark or too bright for 8 bits, of each picture.
        beyond_far: of each camera at the start, where the farther clipping plane hides a surface.
    """

    depths_m: list[float]
    still_m: list[float]
    edges: list[float]
    beyond_8_bits: list[float]
    beyond_far: list[NDArray[np.bool_]]


def not_drawn(model: Any) -> str:
    """What a compiled model has that is not drawn, in one line; empty where all is."""
    first_wraps = model.wrap_type[model.tendon_adr]  # of joints, or of sites on the way
    spatial = int(np.count_nonzero(first_wraps != import_mujoco().mjtWrap.mjWRAP_JOINT))
    counts = {"skins": model.nskin, "flexes": model.nflex, "tendons": spatial}
    there = [f"{count} {what}" for what, count in counts.items() if count]
    return f"{', '.join(there)} are not rendered: only geoms have exact depth" if there else ""


def survey(
    scene: Scene, rig: Rig, config: SimConfig, seed: int, notice: Callable[[str], None]
) -> Scene:
    """Returns the scene with the depth range that its cameras see; warns of what looks wrong.

    Its light is drawn in floats where it is too dark or too bright for 8 bits, and a line says so.

    Args:
        scene: with clipping planes.
        rig: the cameras.
        config: the parameters.
        seed: of the motion.
        notice: called with one line each.

    Raises:
        InputError: no surface is seen.
    """
    seen = _looked(scene, rig, config, seed)
    _tell_of_far(scene, np.concatenate([hidden.ravel() for hidden in seen.beyond_far]), notice)
    if not seen.depths_m:
        raise InputError(
            f"no camera of rig {rig.name} sees a surface of {scene.name}: check where the rig is "
            "mounted and where it points (bodies and sites look along x, z up)"
        )
    _tell(scene, min(seen.depths_m), float(np.mean(seen.edges)), notice)
    known_m = range_of(seen.still_m) or range_of(seen.depths_m)
    assert known_m is not None
    beyond = float(np.mean(seen.beyond_8_bits))
    unsaid = not scene.hdr and not config.light.chosen
    if unsaid and needs_floats(scene.name, beyond, notice):
        scene = replace(scene, hdr=True)
    return replace(scene, depth_range_m=known_m)


def _tell_of_far(scene: Scene, hidden: NDArray[np.bool_], notice: Callable[[str], None]) -> None:
    if hidden.any():
        assert scene.clip_m is not None
        notice(
            f"{scene.name}: in the first pictures {np.count_nonzero(hidden)} pixels "
            f"({100 * hidden.mean():.2g} %) have no depth, because their surfaces lie beyond the "
            f"farther clipping plane ({scene.clip_m[1]:.3g} m): raise visual/map/zfar in the model"
        )


def _looked(scene: Scene, rig: Rig, config: SimConfig, seed: int) -> _Seen:
    duration_s = config.duration_s or scene.duration_s
    motion = replayed(scene, config)[0].motion(duration_s, seed)
    seen = _Seen([], [], [], [], [])
    with drawing_of(config).open(scene, rig, 1, floats=True, border_px=None) as renderer:
        moves = moving_ids(renderer) & (scene.animate is not None)
        for t_s in np.linspace(0, duration_s, _LOOKS).tolist():
            renderer.at(t_s)
            T_world_body = motion.T_world_body(t_s)
            for k in range(len(rig)):
                frame = renderer.frame(k, T_world_body)
                if t_s == 0:
                    seen.beyond_far.append(renderer.beyond_far(k, T_world_body))
                still = ~moves[renderer.segmentation(k, T_world_body)]
                seen.depths_m.extend(ends_m(frame.nearest_depth_m))
                seen.still_m.extend(ends_m(renderer.depth(k, T_world_body)[still]))
                seen.edges.append(_edge_share(frame, config.log_eps))
                seen.beyond_8_bits.append(share_beyond_8_bits(frame, config))
    return seen


def share_beyond_8_bits(frame: Frame, config: PixelConfig, *, cut: bool = False) -> float:
    """Share of pixels with a surface whose contrast 8 bits cannot tell, or whose light they cut.

    With `cut` the frame has 8 bits itself: light of 1 may be more.
    """
    threshold = min(config.contrast_threshold_pos, config.contrast_threshold_neg)
    step = np.log1p(1 / (255 * (frame.intensity + config.log_eps)))
    seen = np.isfinite(frame.nearest_depth_m)
    bright = frame.intensity > (1 - _ROUNDED if cut else 1 + _ROUNDED)
    return float(np.mean(seen & ((step > _COARSE * threshold) | bright)))


def glanced_beyond_8_bits(
    renderer: Renderer,
    motion: Motion,
    times_s: Sequence[float],
    config: PixelConfig,
    *,
    cut: bool,
) -> float:
    """The same of what all cameras see at some times, s; bodies stay where the last put them."""
    shares = []
    for t_s in times_s:
        renderer.at(t_s)
        T_world_body = motion.T_world_body(t_s)
        shares += [
            share_beyond_8_bits(renderer.glance(k, T_world_body), config, cut=cut)
            for k in range(len(renderer.rig))
        ]
    return float(np.mean(shares))


def needs_floats(name: str, beyond: float, notice: Callable[[str], None]) -> bool:
    """Whether so large a share of a view beyond 8 bits needs floats; a line says so if it does."""
    if beyond > FEW:
        notice(
            f"{name}: {100 * beyond:.0f} % of the view is too dark or too bright for 8 bits, so "
            "light is rendered in floating point"
        )
    return beyond > FEW


def ends_m(depth_m: NDArray[np.float32]) -> list[float]:
    """Least and greatest of some depths, m; empty without a surface."""
    finite = depth_m[np.isfinite(depth_m)]
    return [float(finite.min()), float(finite.max())] if finite.size else []


def range_of(depths_m: Sequence[float]) -> tuple[float, float] | None:
    """A depth range for mappers, a tenth beyond what was seen; None where nothing was."""
    if not depths_m:
        return None
    near_m, far_m = (
        float(f"{value:.{_SIZE_STEPS}g}") for value in (0.9 * min(depths_m), 1.1 * max(depths_m))
    )
    return near_m, far_m


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
    if MUJOCO.why_plain(scene) == MIRRORS:
        notice(
            f"{scene.name}: a surface is reflective, which needs closely spaced frames: set the "
            "reflectance of its material to 0 for a simulation several times as fast"
        )
