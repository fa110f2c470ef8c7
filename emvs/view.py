"""The reference view that all volumes share (paper, Alg. 1, line 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.config import DEFAULT_DEPTH_RANGE_M, MapperConfig
from emvs.data.camera import Camera
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.planes import inverse_depth_planes, reference_planes


@dataclass(frozen=True, eq=False)
class ReferenceView:
    """A pose, a pinhole camera and planes.

    Attributes:
        t_us: time of the view, µs.
        T_world_rv: (4, 4) its pose.
        camera: its pinhole camera.
        rho: (N,) float32 planes, 1/m.
    """

    t_us: int
    T_world_rv: NDArray[np.float64]
    camera: Camera
    rho: NDArray[np.float32]


def reference_view(recording: Recording, config: MapperConfig, t_us: int) -> ReferenceView:
    """Returns camera 0's pose at `t_us`, its camera without distortion, and the planes.

    Raises:
        InputError: an impossible depth range, or a time that the poses do not cover.
    """
    near_m, far_m = depth_range_m(recording, config)
    planes = reference_planes if config.is_reference else inverse_depth_planes
    return ReferenceView(
        t_us=t_us,
        T_world_rv=recording.trajectory.at(t_us) @ recording.rig.T_body_cam[0],
        camera=recording.rig.cameras[0].undistorted(),
        rho=planes(near_m, far_m, config.planes),
    )


def depth_range_m(recording: Recording, config: MapperConfig) -> tuple[float, float]:
    """Returns nearest and farthest depth: as configured, else as recorded, else 0.2 and 5 m.

    Raises:
        InputError: the two do not make a range.
    """
    near_m, far_m = recording.depth_range_m or DEFAULT_DEPTH_RANGE_M
    near_m = near_m if config.min_depth_m is None else config.min_depth_m
    far_m = far_m if config.max_depth_m is None else config.max_depth_m
    if not 0 < near_m < far_m:
        raise InputError(
            f"depth range {near_m:g}..{far_m:g} m: needs 0 < min_depth_m < max_depth_m; set both"
        )
    return near_m, far_m
