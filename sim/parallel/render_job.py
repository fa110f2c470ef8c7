"""A render job: chunks of time, which any process may render in any order.

A chunk's render times start afresh at its beginning, so a chunk is the same whoever renders it, and
whatever was rendered before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim import ground_truth
from eventsweep.sim.compensation.interval import Interval, interval_between
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion import Motion
from eventsweep.sim.rendering.adaptive_sampling import RigFrame, adaptive_frames
from eventsweep.sim.rendering.base import Drawing, Renderer, Samples
from eventsweep.sim.rendering.drawing import MUJOCO
from eventsweep.sim.rendering.lens import border_of, widened
from eventsweep.sim.rendering.moving_bodies import MovingBodies
from eventsweep.sim.sampling import border_px
from eventsweep.sim.scene import Scene

# Chunks in which surfaces are drawn in one order; a new one costs a frame.
_ORDERED_ALIKE = 8
_LARGE_PX = 500_000
# What bodies that move by themselves cover and uncover is taken from frames so close together.
_BODIES_PX = 8.0
TruthImages = dict[str, NDArray[Any]]


class RenderedFrame(NamedTuple):
    """What the event simulation needs of what all cameras see at one time.

    Attributes:
        chunk: index of the chunk that it belongs to.
        t_us: time, µs.
        intensity: per camera, (H, W) float32, linear.
        depth_m: per camera, (H, W) float32 nearest depth; none unless light is carried by it, or
            events are to have depth.
        truth: per camera, all ground truth by name; none unless this is one of its times.
        samples: per camera, see `sim.rendering.base.Frame`; none of plain frames.
        intervals: per camera, the way from the frame before; none of plain or first frames.
    """

    chunk: int
    t_us: int
    intensity: tuple[NDArray[np.float32], ...]
    depth_m: tuple[NDArray[np.float32], ...]
    truth: tuple[TruthImages, ...]
    samples: tuple[Samples, ...] = ()
    intervals: tuple[Interval, ...] = ()


def longest_chunk_us(config: SimConfig, rig: Rig) -> int:
    """Chunks are no longer than this, µs: longer ones need fewer frames where motion is slow.

    Of a large sensor's, a worker's memory would not hold the frames of a longer one.
    """
    if config.sampling == "linear":
        return 12_500
    large = max(camera.width_px * camera.height_px for camera in rig.cameras) > _LARGE_PX
    return 25_000 if large else 50_000


def chunk_bounds_us(
    truth_us: Sequence[int], longest_us: int, period_us: int | None = None
) -> list[int]:
    """Rising times at which chunks meet, µs.

    Every truth time and every multiple of a period; gaps split evenly where they are too long.
    """
    multiples = range(0, truth_us[-1], period_us) if period_us else ()
    stops_us = sorted({*truth_us, *multiples})
    bounds = [stops_us[0]]
    for before_us, after_us in pairwise(stops_us):
        gap_us = after_us - before_us
        count = -(-gap_us // longest_us)
        bounds += [before_us + gap_us * k // count for k in range(1, count + 1)]
    return bounds


@dataclass(frozen=True)
class RenderJob:
    """Everything that decides what is rendered; goes to worker processes as it is.

    The times of ground truth, `truth_us`, are among those where chunks meet, `bounds_us`; all in
    µs.
    """

    scene: Scene
    rig: Rig
    config: SimConfig
    seed: int
    truth_us: Sequence[int]
    bounds_us: tuple[int, ...]
    drawing: Drawing = MUJOCO

    @property
    def duration_us(self) -> int:
        """Length of the sequence, µs."""
        return self.bounds_us[-1]

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return len(self.bounds_us) - 1

    @property
    def event_depth(self) -> bool:
        """Whether every event gets its depth."""
        return "event_depth" in self.config.truth

    @property
    def fine(self) -> bool:
        """Whether frames are fine, and light between them is carried along the motion."""
        return self.config.sampling != "linear"

    @property
    def supersample(self) -> int:
        """Samples per pixel and axis."""
        assert self.config.supersample is not None
        return self.config.supersample

    @property
    def labelled(self) -> bool:
        """Whether every event gets its cause: an ideal sensor knows but one."""
        sensor = self.config.sensor.resolved()
        return not (sensor.ideal_pixels and sensor.ideal_readout)

    def motion(self) -> Motion:
        """The head's curve."""
        return self.scene.motion(self.duration_us * 1e-6, self.seed)

    def renderer(self) -> Renderer:
        """Opens a renderer for the calling process and thread."""
        floats = self.config.light.floats(self.scene.hdr)
        return self.drawing.open(
            self.scene, self.rig, self.supersample, floats=floats, border_px=border_px(self.config)
        )


class ChunkRenderer:
    """Renders the chunks of a job, in any order, by a renderer that was opened in this thread."""

    def __init__(self, job: RenderJob, renderer: Renderer) -> None:
        self.job = job
        self._renderer, self._motion = renderer, job.motion()
        self._config = _capped(job)
        self._last: RigFrame | None = None
        self._ordered_for = -1
        self._drawn = widened(job.rig, border_px(job.config) or 0)
        self._bodies = None
        if job.scene.animate is not None:
            self._bodies = MovingBodies(renderer, border_px=border_px(job.config))

    def frames(self, chunk: int, *, begins: bool) -> Iterator[RenderedFrame]:
        """What the cameras see after the chunk's beginning up to its end.

        With `begins`, the frame at the beginning as well: nobody has taken it.
        """
        bounds_us = self.job.bounds_us
        self.order(chunk, bounds_us[chunk - chunk % _ORDERED_ALIKE])
        yield from self.between(list(bounds_us[chunk : chunk + 2]), chunk, begins=begins)

    def between(self, stops_us: list[int], chunk: int, *, begins: bool) -> Iterator[RenderedFrame]:
        """The same of any two times, µs; `order` comes first."""
        before = None
        known = self._last if self._last and self._last.t_us == stops_us[0] else None
        for rig_frame in adaptive_frames(
            self._renderer, self._motion, stops_us, self._config, known, self._bodies
        ):
            if begins or rig_frame.t_us > stops_us[0]:
                yield self._rendered(chunk, before, rig_frame)
            before = self._last = rig_frame.without_light()
            del rig_frame  # or its light would stay while the next is drawn

    def order(self, chunk: int, start_us: int) -> None:
        """Draws near surfaces first, in an order that depends on the next chunk alone.

        Where the order changes, the frame at the meeting of two chunks is drawn anew, so that it
        does not matter who drew the chunk before. `start_us` is where the first of those drawn
        alike begins.
        """
        first = chunk - chunk % _ORDERED_ALIKE
        if self.job.fine and first != self._ordered_for:
            self._renderer.near_first(self._motion.T_world_body(start_us * 1e-6))
            self._ordered_for, self._last = first, None

    def _rendered(self, chunk: int, before: RigFrame | None, rig_frame: RigFrame) -> RenderedFrame:
        frames, job = rig_frame.frames, self.job
        with_depth = job.event_depth or job.fine
        return RenderedFrame(
            chunk,
            rig_frame.t_us,
            tuple(frame.intensity for frame in frames),
            tuple(frame.nearest_depth_m for frame in frames) if with_depth else (),
            self._truth(rig_frame) if rig_frame.t_us in job.truth_us else (),
            tuple(frame.samples for frame in frames if frame.samples is not None),
            self._intervals(before, rig_frame) if before is not None and job.fine else (),
        )

    def _intervals(self, before: RigFrame, after: RigFrame) -> tuple[Interval, ...]:
        middle = self._motion.T_world_body(0.5e-6 * (before.t_us + after.t_us))
        rig, intervals = self.job.rig, []
        for k, (camera, T) in enumerate(zip(self._drawn.cameras, rig.T_body_cam, strict=True)):
            poses = before.T_world_body @ T, middle @ T, after.T_world_body @ T
            shape = camera.height_px, camera.width_px
            bodies = (before.bodies[k], after.bodies[k]) if self._bodies else None
            moved = self._bodies.moved if self._bodies else None
            span_us = before.t_us, after.t_us
            border = border_of(rig.cameras[k], camera)
            intervals.append(interval_between(span_us, poses, shape, bodies, moved, border))
        return tuple(intervals)

    def _truth(self, rig_frame: RigFrame) -> tuple[TruthImages, ...]:
        self._renderer.at(rig_frame.t_us * 1e-6)
        return tuple(self._truth_of(k, rig_frame) for k in range(len(self.job.rig)))

    def _truth_of(self, k: int, rig_frame: RigFrame) -> TruthImages:
        wanted, pose = self.job.config.truth, rig_frame.T_world_body
        camera, T_body_cam = self.job.rig.cameras[k], self.job.rig.T_body_cam[k]
        depth_m = self._renderer.depth(k, pose)
        grey = np.rint(255 * np.clip(rig_frame.frames[k].intensity, 0, 1)).astype(np.uint8)
        images: TruthImages = {"depth_m": depth_m, "intensity": grey}
        if "flow" in wanted:
            images["flow_px"] = self._flow(k, rig_frame, depth_m)
        if "segmentation" in wanted:
            images["segmentation"] = self._renderer.segmentation(k, pose)
        if "boundary" in wanted:
            images["boundary"] = ground_truth.boundary(depth_m).astype(np.uint8)
        if "twist" in wanted:
            t_s, end_s = rig_frame.t_us * 1e-6, self.job.duration_us * 1e-6
            images["twist"] = ground_truth.twist(self._motion, T_body_cam, t_s, end_s)
        if camera.model != "pinhole":
            view = camera.undistorted()
            images["view_depth_m"] = self._renderer.depth(k, pose, view=view)
        return images

    def _flow(
        self, k: int, rig_frame: RigFrame, depth_m: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        later_us = next((t for t in self.job.truth_us if t > rig_frame.t_us), None)
        if later_us is None:
            return np.full((*depth_m.shape, 2), np.nan, np.float32)
        camera, T_body_cam = self.job.rig.cameras[k], self.job.rig.T_body_cam[k]
        bearing, T_world_cam = self._bearings[k], rig_frame.T_world_body @ T_body_cam
        T_later_world = se3.inverse(self._motion.T_world_body(later_us * 1e-6) @ T_body_cam)
        flow_px = ground_truth.flow_px(camera, bearing, depth_m, T_later_world @ T_world_cam)
        if self._bodies is not None:
            geoms = self._renderer.segmentation(k, rig_frame.T_world_body)
            moved = self._bodies.moved(rig_frame.t_us, later_us)
            for geom in np.unique(geoms[self._bodies.moves[geoms]]):
                shown, T = geoms == geom, T_later_world @ moved[geom] @ T_world_cam
                flow_px[shown] = ground_truth.body_flow_px(camera, bearing, depth_m, shown, T)
        return flow_px

    @cached_property
    def _bearings(self) -> list[NDArray[np.float64]]:
        return [camera.bearing_table() for camera in self.job.rig.cameras]


def _capped(job: RenderJob) -> SimConfig:
    """The parameters, with frames no further apart than the animation allows.

    Frames are spaced by how far the pixels move that are seen; what would cross the view between
    two frames is seen in neither.
    """
    if job.scene.animate is None:
        return job.config
    # An animation's interval is for frames half a pixel apart.
    spacing_px = min(job.config.spacing_px, _BODIES_PX)
    own_us = round(job.scene.animate.max_interval_us * spacing_px / 0.5)
    longest_us = min(job.config.longest_interval_us, own_us)
    shortest_us = min(job.config.min_frame_interval_us, longest_us)
    intervals = {"max_frame_interval_us": longest_us, "min_frame_interval_us": shortest_us}
    return job.config.model_copy(update=intervals | {"max_displacement_px": spacing_px})
