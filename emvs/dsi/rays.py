"""Events and poses to rays: the ray of event k meets inverse depth rho at u = a + rho b.

Events come in the order of time, from all over the image, and every vote of a large plane waits for
memory. So rays are grouped by bands of image rows: a thread's votes then stay within a few
kilobytes of its plane. The votes are the same; only the order of their sum changes, and that is the
same for any number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.dsi import rays_kernels
from eventsweep.emvs.dsi.rays_kernels import EVENT_BLOCK, RAY_BLOCK, count_bands, move_to_bands
from eventsweep.emvs.dsi.voting_kernels import CHUNK
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.runtime import in_threads

Float32s = NDArray[np.float32]
Knots = tuple[NDArray[np.generic], ...]
PACKET = 1024  # events that share one pose in the authors' implementation
_PACKET_POSE = 512  # ... that of this event of the packet
# With fewer rows than these a thread's neighbouring votes meet in one cell and wait for each other,
# with more the band leaves the cache: the page `mapper` has the times.
BAND_ROWS = 8


@dataclass(frozen=True)
class RayCounts:
    """What became of one camera's events.

    Attributes:
        events: events that came.
        without_pose: outside the trajectory's span.
        without_ray: at a pixel that no ray in front of the camera reaches.
        backwards: whose ray runs away from the reference view's forward direction.
        dropped: in the tail that the compatibility setting drops.
    """

    events: int
    without_pose: int = 0
    without_ray: int = 0
    backwards: int = 0
    dropped: int = 0

    @property
    def rays(self) -> int:
        """Events that have a ray to vote with."""
        return self.events - self.without_pose - self.without_ray - self.backwards - self.dropped

    @classmethod
    def tallied(cls, events: int, cast: int, tally: NDArray[np.int64]) -> RayCounts:
        """From how many events came and were cast, and (4,) those by their outcome."""
        kinds = rays_kernels.NO_POSE, rays_kernels.NO_RAY, rays_kernels.BACKWARDS
        without_pose, without_ray, backwards = (int(tally[kind]) for kind in kinds)
        return cls(events, without_pose, without_ray, backwards, events - cast)

    @classmethod
    def total(cls, counts: Sequence[RayCounts]) -> RayCounts:
        """Adds up what became of events."""
        names = (field.name for field in fields(cls))
        return cls(**{name: sum(getattr(count, name) for count in counts) for name in names})


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of one camera in the reference view.

    The ray meets inverse depth `rho` at pixel `(a_u + rho b_u, a_v + rho b_v)`; that point lies in
    front of the event's camera where `1 - c_z rho > 0`.

    Attributes:
        a_u, b_u, a_v, b_v: (N,) float32; px, px m.
        c_z: (N,) float32, the camera centre's depth in the reference view, m; empty where
            `in_planes` found that no vote needs it.
        c_z_max: (ceil(N / CHUNK),) float32, the largest `c_z` of each chunk.
        counts: what became of the events.
    """

    a_u: Float32s
    b_u: Float32s
    a_v: Float32s
    b_v: Float32s
    c_z: Float32s
    c_z_max: Float32s
    counts: RayCounts

    @classmethod
    def of(cls, columns: Sequence[Float32s], counts: RayCounts) -> Rays:
        """Rays from their five columns a_u, b_u, a_v, b_v, c_z, each (N,) float32."""
        a_u, b_u, a_v, b_v, c_z = columns
        c_z_max = np.maximum.reduceat(c_z, np.arange(0, len(c_z), CHUNK)) if len(c_z) else c_z
        return cls(a_u, b_u, a_v, b_v, c_z, c_z_max, counts)

    @property
    def columns(self) -> tuple[Float32s, Float32s, Float32s, Float32s, Float32s]:
        """The five columns, one value per ray."""
        return self.a_u, self.b_u, self.a_v, self.b_v, self.c_z

    @classmethod
    def joined(cls, parts: Sequence[Rays]) -> Rays:
        """The rays of several parts, in the order given."""
        if len(parts) == 1:
            return parts[0]
        columns = zip(*(part.columns for part in parts), strict=True)
        counts = RayCounts.total([part.counts for part in parts])
        return cls.of([np.concatenate(pieces) for pieces in columns], counts)

    def part(self, first: int, last: int, counts: RayCounts) -> Rays:
        """Rays `first` to `last` (exclusive) as views, with counts of their own."""
        return Rays.of([column[first:last] for column in self.columns], counts)

    def in_planes(self, rho: Float32s) -> Rays:
        """The same rays to vote in planes `rho`, 1/m; a fifth smaller where none lies behind."""
        in_front = 1 - self.c_z_max.max(initial=0) * rho.max() > 0  # float32, as votes are cast
        return replace(self, c_z=np.empty(0, np.float32)) if in_front else self

    def __len__(self) -> int:
        return len(self.a_u)


def rays_between(
    events: Events,
    camera: Camera,
    T_body_cam: NDArray[np.float64],
    poses: Knots,
    rv_camera: Camera,
    *,
    packets: bool = False,
) -> Rays:
    """Casts every event's ray into the reference view (paper, Alg. 1, line 3), in their order.

    Every event has its own pose: rotation along the great arc, position along the line. With
    `packets`, 1024 events share one pose and the tail is dropped, as the authors' program does.

    Args:
        events: one camera's, sorted.
        camera: that camera.
        T_body_cam: (4, 4), where it sits on the body.
        poses: `knots` of trajectory and reference view, which cameras can share.
        rv_camera: pinhole camera of the reference view.
        packets: the compatibility setting.

    Raises:
        InputError: an event outside the sensor, or events not sorted.
    """
    events.checked(camera.width_px, camera.height_px)
    chosen, pose_us = voters(events, packets=packets)
    columns = tuple(np.empty(len(chosen), np.float32) for _ in range(5))
    outcome = np.empty(len(chosen), np.uint8)
    in_threads(
        rays_kernels.rays, -(-len(chosen) // EVENT_BLOCK), chosen.x, chosen.y, pose_us,
        _bearings(camera), *poses, T_body_cam, rv_camera.K, *columns, outcome,
    )  # fmt: skip
    counts = RayCounts.tallied(len(events), len(chosen), np.bincount(outcome, minlength=4))
    if counts.rays < len(outcome):
        votes = outcome == rays_kernels.VOTES
        columns = tuple(column[votes] for column in columns)
    return Rays.of(columns, counts)


@lru_cache(maxsize=16)
def _bearings(camera: Camera) -> NDArray[np.float64]:
    """A camera's table of bearings, kept for its further sub-intervals and windows."""
    return camera.bearing_table()


def voters(events: Events, *, packets: bool) -> tuple[Events, NDArray[np.int64]]:
    """The events that are cast, and the (N,) int64 times of their poses, µs."""
    if not packets:
        return events, events.t_us
    kept = events.slice(0, max(len(events) - 1, 0) // PACKET * PACKET)
    return kept, np.repeat(kept.t_us[_PACKET_POSE::PACKET], PACKET)


def knots(trajectory: Trajectory, T_world_rv: NDArray[np.float64]) -> Knots:
    """The body's poses in the reference view, as `emvs.dsi.rays_kernels.rays` takes them.

    Times, positions and rotations, and from each to the next the turn's axis and angle.

    Raises:
        InputError: a trajectory of one pose.
    """
    if len(trajectory) < 2:
        raise InputError("trajectory with one pose: needs at least 2, to interpolate between them")
    T_world_body = se3.from_quat_xyzw(trajectory.positions_m, trajectory.quats_xyzw)
    T_rv_body = se3.inverse(T_world_rv) @ T_world_body
    position_m, quat = se3.to_quat_xyzw(T_rv_body)
    rotation = Rotation.from_quat(quat)
    turn = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
    angle = np.linalg.norm(turn, axis=1)
    axis = turn / np.maximum(angle, np.finfo(float).tiny)[:, None]
    return trajectory.t_us, position_m, quat, axis, angle


def grouped_by_rows(rays: Rays, rho: float, height_px: int, band_rows: int = BAND_ROWS) -> Rays:
    """Groups rays by bands of the image rows where they meet the plane `rho` (1/m), stably.

    A middle plane keeps all planes' votes near together. Rays above, below or nowhere come first or
    last.
    """
    bands = -(-height_px // band_rows)
    blocks = -(-len(rays) // RAY_BLOCK)
    place = np.zeros((blocks, bands), np.int64)
    args = rays.a_v, rays.b_v, np.float32(rho), band_rows, bands
    in_threads(count_bands, blocks, *args, place)
    # Where the first ray of each band of each block goes: bands one after another, then blocks.
    before = np.cumsum(place.T).reshape(bands, blocks).T - place
    ordered = tuple(np.empty_like(column) for column in rays.columns)
    in_threads(move_to_bands, blocks, *args, before, rays.columns, ordered)
    return Rays.of(ordered, rays.counts)
