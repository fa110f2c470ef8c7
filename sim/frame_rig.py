"""Pictures of the frame cameras beside the event cameras, drawn for them alone.

Each has its own size, lens and place. While its shutter is open, pictures are drawn so close
together that nothing moves further than `DENSE_PX` between two, and light is linear in between.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.ground_truth import flow_px
from eventsweep.sim.motion import Motion
from eventsweep.sim.parallel.render_job import RenderJob
from eventsweep.sim.rendering.base import Renderer
from eventsweep.sim.sensor.frame_camera import (
    DENSE_PX,
    Exposure,
    develop,
    exposure_spans_us,
    gain_for,
)

# Pictures of an exposure, at most: of faster motion the blur is sampled more coarsely.
_MOST_PICTURES = 256


def pictures_beside(job: RenderJob) -> Iterator[tuple[int, Photo]]:
    """What every frame camera of `job.rig.frame_cameras` took, in order of time.

    Yields:
        The camera's number, and its picture.
    """
    spans_us = exposure_spans_us(job.config.frames, job.duration_us)
    if job.rig.frame_cameras is None or not spans_us:
        return
    floats = job.config.light.floats(job.scene.hdr)
    rig = job.rig.frame_cameras
    opened = job.drawing.open(job.scene, rig, job.supersample, floats=floats, border_px=None)
    with opened as renderer:
        rays = [camera.bearing_table() for camera in rig.cameras]
        for span_us in spans_us:
            for k in range(len(rig)):
                yield k, _picture(job, renderer, k, rays[k], span_us)


def _picture(
    job: RenderJob,
    renderer: Renderer,
    k: int,
    bearing: NDArray[np.float64],
    span_us: tuple[int, int],
) -> Photo:
    motion, exposure, before = job.motion(), Exposure(*span_us), None
    for t_us in _times_us(job, renderer, motion, k, bearing, span_us):
        renderer.at(t_us * 1e-6)
        now = t_us, renderer.frame(k, motion.T_world_body(t_us * 1e-6)).intensity
        if before is not None:
            exposure.add(before, now)
        before = now
    light = exposure.light()
    gain = gain_for(light, job.config.frames)
    return Photo(*span_us, gain, develop(light, gain, job.config.frames.bits))


def _times_us(
    job: RenderJob, renderer: Renderer, motion: Motion, k: int, bearing: NDArray[np.float64],
    span_us: tuple[int, int],
) -> list[int]:  # fmt: skip
    """Times of an exposure's pictures, both ends among them, µs."""
    rig: Rig = renderer.rig
    first, last = (motion.T_world_body(t_us * 1e-6) @ rig.T_body_cam[k] for t_us in span_us)
    renderer.at(span_us[0] * 1e-6)
    depth_m = renderer.depth(k, motion.T_world_body(span_us[0] * 1e-6))
    moved = flow_px(rig.cameras[k], bearing, depth_m, se3.inverse(last) @ first)
    length_us = span_us[1] - span_us[0]
    count = int(np.ceil(np.nanmax(np.linalg.norm(moved, axis=-1), initial=0.0) / DENSE_PX))
    if job.scene.animate is not None:
        count = max(count, -(-length_us // job.scene.animate.max_interval_us))
    count = min(max(count, 1), _MOST_PICTURES, length_us)
    times_us: list[int] = np.linspace(*span_us, count + 1).astype(np.int64).tolist()
    return times_us


def silent_beside(job: RenderJob) -> str:
    """Why a rig's frame cameras take no pictures; empty where they do, or there are none."""
    if job.rig.frame_cameras is None or job.config.frames.rate_hz:
        return ""
    names = ", ".join(job.rig.frame_cameras.camera_names)
    return f"{job.rig.name}: {names} takes no frames: set frames.rate_hz"
