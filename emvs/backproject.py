"""From a window of a recording to rays: every camera's events, read once and let go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.progress import Progress
from emvs.rays import Rays, event_rays
from emvs.view import ReferenceView
from emvs.window import Window


def back_project(
    recording: Recording,
    config: MapperConfig,
    window: Window,
    view: ReferenceView,
    progress: Progress,
) -> tuple[list[Rays], NDArray[np.uint32]]:
    """Casts the rays of every camera in the window into the reference view (paper, Alg. 1, line 3).

    Returns:
        The rays of each camera, and (2, H, W) uint32 events of camera 0 per pixel.

    Raises:
        InputError: a camera without an event that can vote.
    """
    all_rays = []
    for k, camera in enumerate(recording.rig.cameras):
        events = recording.events(k, window.t0_us, window.t1_us)
        rays = event_rays(
            events, camera, recording.rig.T_body_cam[k], recording.trajectory, view.T_world_rv,
            view.camera, packets=config.is_reference,
        )  # fmt: skip
        _check_any(recording.rig.camera_names[k], rays, window)
        if k == 0:
            event_image = _event_image(events, camera.width_px, camera.height_px)
        all_rays.append(_count_left_out(rays, window.left_out[k]))
        progress("rays", k + 1, len(recording.rig))
    return all_rays, event_image


def _check_any(name: str, rays: Rays, window: Window) -> None:
    if len(rays) == 0:
        raise InputError(
            f"camera {name} has {rays.counts.events} events in the window of "
            f"{(window.t1_us - window.t0_us) / 1e6:.6f} s, and none that can vote: needs at least "
            "1 (1025 in the mcemvs setting); choose another window or check poses and calibration"
        )


def _count_left_out(rays: Rays, left_out: int) -> Rays:
    counts = rays.counts
    counts = replace(
        counts, events=counts.events + left_out, without_pose=counts.without_pose + left_out
    )
    return replace(rays, counts=counts)


def _event_image(events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
    """Events per pixel, (2, H, W): polarity 0, polarity 1."""
    image = np.empty((2, height_px, width_px), np.uint32)
    for polarity in (0, 1):
        chosen = events.p == polarity
        cell = events.y[chosen].astype(np.int32) * width_px + events.x[chosen]
        counts = np.bincount(cell, minlength=width_px * height_px)
        image[polarity] = counts.reshape(height_px, width_px)
    return image
