"""Event-by-event stereo (GTS): pairs that coincide in row, time and motion, triangulated.

After Ieng et al., *Neuromorphic Event-Based Generalized Time-Based Stereovision*, Frontiers in
Neuroscience 2018: the class of methods that ray density fusion argues against, since it must decide
on each pair of events by itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap
from emvs.errors import InputError
from emvs.rivals.gts_match import Stream, pairs
from emvs.rivals.gts_motion import time_slopes
from emvs.rivals.parameters import GtsParameters
from emvs.rivals.rectify import Rectified
from emvs.rivals.semi_global import disparity_range_px
from emvs.rivals.to_view import depth_map, see
from emvs.view import ReferenceView
from emvs.window import Window


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: GtsParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Depth from pairs of events of the whole window (`GTS/events`).

    Each pixel of the view takes its nearest point. Confidence is `1 / (1 + energy)`, 0..1.

    Raises:
        InputError: a rig or depth range that cannot be matched, or no pair in the window.
    """
    parameters = parameters or config.gts
    stereo = Rectified.of(recording.rig)
    range_px = disparity_range_px(stereo, view)
    left, right = (_stream(side, stereo, recording, window, parameters) for side in (0, 1))
    i, j, energy = pairs(left, right, range_px, parameters.coincidence)
    disparity_px = left.uv_px[i, 0] - right.uv_px[j, 0]
    good = disparity_px > 0
    if not good.any():
        raise InputError(
            f"GTS/events: no pair among {len(left.t_us)} and {len(right.t_us)} events from "
            f"{window.t0_us} to {window.t1_us} µs: choose a longer duration_s, or bring both "
            "cameras to one clock"
        )
    i, disparity_px, energy = i[good], disparity_px[good], energy[good]
    points_body = stereo.points_body(left.uv_px[i], disparity_px)
    T_world_body = recording.trajectory.at(left.t_us[i])
    points_world = _each(T_world_body, points_body)
    seen = see(points_world, 1 / (1 + energy), view)
    return depth_map("GTS/events", seen.depth_m, seen.value, view, config)


def _each(T_a_b: NDArray[np.float64], points_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moves each point by its own motion."""
    turned = np.einsum("nij,nj->ni", T_a_b[:, :3, :3], points_b)
    moved: NDArray[np.float64] = turned + T_a_b[:, :3, 3]
    return moved


def _stream(
    side: int, stereo: Rectified, recording: Recording, window: Window, parameters: GtsParameters
) -> Stream:
    """Events of one camera with their rectified places and their motion."""
    events = recording.events(stereo.cameras[side], window.t0_us, window.t1_us)
    uv_px = stereo.events_px(side, events).astype(np.float64)
    size_px = stereo.camera.width_px, stereo.camera.height_px
    pixels = np.rint(np.nan_to_num(uv_px, nan=-1.0)).astype(np.int64)
    inside = np.isfinite(uv_px).all(axis=1) & (pixels >= 0).all(axis=1) & (pixels < size_px).all(1)
    pixels[~inside] = -1
    since_us = events.t_us - min(window.t0_us, 0)
    slope = time_slopes(
        pixels, since_us, events.p, size_px, parameters.radius_px, round(parameters.memory_s * 1e6)
    )
    return Stream(uv_px, events.t_us, events.p, slope)
