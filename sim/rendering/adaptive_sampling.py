"""Adaptive sampling: frames as rare as the image motion of all cameras allows.

ESIM (Rebecq et al., CoRL 2018, section 3.3) bounds the motion of one camera's pixels by first-order
optical flow. Here every pixel of every camera is moved exactly, by its depth and the relative pose,
and once more backwards from the new frame, where surfaces may have come into view. Pixels of
bodies that move by themselves are moved by the body's motion as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion import Motion
from eventsweep.sim.rendering.base import Frame, Views
from eventsweep.sim.rendering.lens import bearing_steps
from eventsweep.sim.rendering.moving_bodies import BodyPixels, MovingBodies
from eventsweep.sim.rendering.pixel_kernels import squared_displacement, squared_displacement_lens

# Aim below the limit: motion accelerates, and the backward check must pass as well.
_AIM, _CLOSE = 0.93, 0.85


class RigFrame(NamedTuple):
    """What all cameras of a rig see at one time.

    Attributes:
        t_us: time, µs.
        T_world_body: (4, 4) pose at that time.
        frames: one per camera.
        bodies: per camera, the pixels of bodies that move by themselves; none without such.
    """

    t_us: int
    T_world_body: NDArray[np.float64]
    frames: tuple[Frame, ...]
    bodies: tuple[BodyPixels, ...] = ()

    def without_light(self) -> RigFrame:
        """What is needed to foresee motion from here: a fine frame's light is large."""
        return self._replace(frames=tuple(frame._replace(samples=None) for frame in self.frames))


def truth_times_us(duration_us: int, interval_us: int, more_us: Sequence[int] = ()) -> list[int]:
    """Times of ground truth: every `interval_us` from 0, the middle, the end, and `more_us`, µs.

    Raises:
        InputError: one of `more_us` lies outside the sequence.
    """
    outside = [t_us for t_us in more_us if not 0 <= t_us <= duration_us]
    if outside:
        raise InputError(
            f"truth_times_s lists {outside[0] * 1e-6:g} s, but the sequence lasts "
            f"{duration_us * 1e-6:g} s: remove that time, or raise duration_s"
        )
    times = {*range(0, duration_us, interval_us), duration_us // 2, duration_us, *more_us}
    return sorted(times)


def adaptive_frames(
    source: Views,
    motion: Motion,
    stops_us: list[int],
    config: SimConfig,
    first: RigFrame | None = None,
    bodies: MovingBodies | None = None,
) -> Iterator[RigFrame]:
    """Yields frames from the first of `stops_us` to the last, as rarely as the motion allows.

    Between two frames no pixel of any camera moves further than `config.spacing_px`, measured
    forwards and backwards.

    Args:
        source: a renderer.
        motion: the head's curve, s.
        stops_us: rising times at which there must be a frame, µs; at least two.
        config: limits on displacement and interval.
        first: the frame at the first stop, if it is there already.
        bodies: of the scene that `source` draws, where some move by themselves.

    Raises:
        InputError: motion so fast that even the least frame interval exceeds the limit.
    """
    stops = np.asarray(stops_us)
    view = _View(source, motion, bodies)
    now = first or view.rig_frame(int(stops[0]))
    yield now
    now = now.without_light()
    step_us = config.min_frame_interval_us * 8
    while now.t_us < stops[-1]:
        next_stop_us = int(stops[np.searchsorted(stops, now.t_us, side="right")])
        longest_us = min(config.longest_interval_us, next_stop_us - now.t_us)
        before_us = now.t_us
        now = _advance(view, now, step_us, longest_us, config)
        step_us = now.t_us - before_us
        yield now
        now = now.without_light()


class _View(NamedTuple):
    """What is needed to take pictures and to foresee how far their pixels move."""

    source: Views
    motion: Motion
    bodies: MovingBodies | None

    def rig_frame(self, t_us: int) -> RigFrame:
        T_world_body = self.motion.T_world_body(t_us * 1e-6)
        self.source.at(t_us * 1e-6)
        frames = tuple(self.source.frame(k, T_world_body) for k in range(len(self.source.rig)))
        seen = self.bodies.seen(T_world_body) if self.bodies else ()
        return RigFrame(t_us, T_world_body, frames, seen)

    def moved_px(self, seen: RigFrame, then_us: int) -> float:
        """The furthest that a pixel of `seen` goes until `then_us`, or came since then, px."""
        T_world_then = self.motion.T_world_body(then_us * 1e-6)
        poses = seen.T_world_body, T_world_then
        depths_m = [frame.nearest_depth_m for frame in seen.frames]
        moved_px = largest_displacement_px(self.source.rig, depths_m, *poses)
        if self.bodies is None:
            return moved_px
        return max(moved_px, self.bodies.moved_px(seen.bodies, (seen.t_us, then_us), *poses))


def _advance(
    view: _View, now: RigFrame, guess_us: int, longest_us: int, config: SimConfig
) -> RigFrame:
    """The next frame, at most `longest_us` later."""
    limit_px = config.spacing_px
    shortest_us = min(config.min_frame_interval_us, longest_us)

    def forward_px(step_us: int) -> float:
        return view.moved_px(now, now.t_us + step_us)

    step_us, moved_px = longest_step(forward_px, limit_px, guess_us, shortest_us, longest_us)
    while moved_px <= limit_px:
        ahead = view.rig_frame(now.t_us + step_us)
        moved_px = view.moved_px(ahead, now.t_us)
        if moved_px <= limit_px:
            return ahead
        if step_us > shortest_us:
            step_us = max(shortest_us, step_us // 2)
            moved_px = forward_px(step_us)
    raise InputError(
        f"pixels move {moved_px:.2f} px in {step_us} µs at t = {now.t_us} µs, the limit is "
        f"{limit_px}: slow the motion, move surfaces away, lower min_frame_interval_us or raise "
        "max_displacement_px"
    )


def longest_step(
    moved_px: Callable[[int], float], limit_px: float, guess_us: int, shortest_us: int,
    longest_us: int,
) -> tuple[int, float]:  # fmt: skip
    """Finds nearly the longest step whose displacement stays within `limit_px`, by the secant rule.

    `moved_px` gives the displacement after a step of so many µs. The least step is returned, with
    its displacement, even where that exceeds the limit.
    """
    step_us = min(max(guess_us, shortest_us), longest_us)
    good: tuple[int, float] | None = None
    bad_us = longest_us + 1
    while True:
        now_px = moved_px(step_us)
        if now_px <= limit_px:
            good = (step_us, now_px)
            if step_us == longest_us or now_px >= _CLOSE * limit_px:
                return good
        else:
            bad_us = step_us
            if step_us == shortest_us:
                return step_us, now_px
        lower_us = good[0] + 1 if good else shortest_us
        if lower_us >= bad_us:
            assert good is not None
            return good
        # What would move a little less than the limit, if displacement grew linearly
        share = _AIM * limit_px / max(now_px, 1e-3 * limit_px)
        step_us = min(max(int(step_us * share), 1, lower_us), bad_us - 1)


@lru_cache(maxsize=16)
def _lens_tables(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    bearing, slope = bearing_steps(camera)
    return bearing.astype(np.float32), np.linalg.inv(slope).astype(np.float32)


def largest_displacement_px(
    rig: Rig,
    depths_m: Sequence[NDArray[np.float32]],
    T_world_body_a: NDArray[np.float64],
    T_world_body_b: NDArray[np.float64],
) -> float:
    """The furthest that any pixel of any camera moves from pose a to pose b, px.

    `depths_m` are (H, W) z-depth per camera, seen from pose a; inf where there is no surface. The
    result is inf if a visible point is not in front of its camera any more.

    Raises:
        InputError: depth of another size than its camera's.
    """
    T_b_a = se3.inverse(T_world_body_b) @ T_world_body_a
    largest = 0.0
    for camera, depth_m, T_body_cam in zip(rig.cameras, depths_m, rig.T_body_cam, strict=True):
        if depth_m.shape != (camera.height_px, camera.width_px):
            raise InputError(
                f"depth of shape {depth_m.shape} for a camera of {camera.width_px} x "
                f"{camera.height_px} px: give (H, W) of the same camera"
            )
        rows, T = np.empty(camera.height_px), se3.inverse(T_body_cam) @ T_b_a @ T_body_cam
        if camera.model == "pinhole":
            focal_px = np.array([camera.fx_px, camera.fy_px])
            centre_px = np.array([camera.cx_px, camera.cy_px])
            squared_displacement(depth_m, focal_px, centre_px, T, rows)
        else:
            squared_displacement_lens(depth_m, *_lens_tables(camera), T, rows)
        largest = max(largest, float(rows.max()))
    return float(np.sqrt(largest))
