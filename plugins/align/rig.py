"""What is aligned with what: a recording's frame camera, event camera, target and depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.image_stores import FrameCamera, frame_cameras
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.align.depths import Depths, DepthSource
from eventsweep.plugins.align.views import Array, View, bearings, carried

_STILL_PX = 1.0
"""Depth is carried anew where it would move further than this."""
_TRIED_US, _SHORTEST_US, _LONGEST_US = 10_000, 1_000, 50_000
_EVERY = 8


@dataclass(frozen=True, eq=False)
class Mounted:
    """A camera on the body: name, lens, and (4, 4) `T_body_cam`."""

    name: str
    camera: Camera
    T_body_cam: Array


@dataclass(frozen=True)
class Correction:
    """What a frame camera's calibration lacks.

    Attributes:
        late_us: to be added to the times of the frames, µs.
        turn_rad: rotation vector of the frame camera in its own axes, rad.
        shift_px: to be added to the principal point of the frame camera.
    """

    late_us: float = 0.0
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_px: tuple[float, float] = (0.0, 0.0)

    def lens(self, camera: Camera) -> Camera:
        """The corrected lens of a frame camera."""
        right_px, down_px = self.shift_px
        return replace(camera, cx_px=camera.cx_px + right_px, cy_px=camera.cy_px + down_px)

    def placed(self, T_body_cam: Array) -> Array:
        """The corrected place of a frame camera on the body."""
        turned = T_body_cam.copy()
        turned[:3, :3] = T_body_cam[:3, :3] @ Rotation.from_rotvec(self.turn_rad).as_matrix()
        return turned


@dataclass(frozen=True, eq=False)
class Setup:
    """A recording, and which of its parts go into whose pixels.

    Attributes:
        recording: poses, calibration, events.
        depth: where depth comes from.
        frames: the camera whose frames are aligned; None without frames.
        events: number of the event camera whose events are aligned.
        target: whose pixels everything gets.
        correction: of the frame camera.
    """

    recording: Recording
    depth: DepthSource
    frames: FrameCamera | None
    events: int
    target: Mounted
    correction: Correction = field(default=Correction())

    @property
    def event_camera(self) -> Mounted:
        """The event camera, as it is mounted."""
        return _event_camera(self.recording, self.events)

    def corrected(self, correction: Correction) -> Setup:
        """The same with another calibration of the frame camera, which may be the target."""
        assert self.frames is not None
        target = self.target
        if target.name == self.frames.name and self.frames.shares is None:
            target = self._frame_camera(correction)
        return replace(self, target=target, correction=correction)

    def view(self, mounted: Mounted, t_us: float) -> View:
        """A mounted camera at a time."""
        T_world_body = self.recording.trajectory.at(np.asarray(t_us))
        return View(mounted.camera, T_world_body @ mounted.T_body_cam)

    def frame_time_us(self, index: int) -> float:
        """When a frame was taken, on the corrected clock, µs."""
        assert self.frames is not None
        return float(self.frames.pictures.t_us[index]) + self.correction.late_us

    def frame_view(self, index: int) -> View:
        """The frame camera when it took a frame."""
        assert self.frames is not None
        return self.view(self._frame_camera(self.correction), self.frame_time_us(index))

    def _frame_camera(self, correction: Correction) -> Mounted:
        assert self.frames is not None
        frames = self.frames
        place = correction.placed(frames.T_body_cam)
        return Mounted(frames.name, correction.lens(frames.camera), place)

    def covered(self, margin_us: float = 0.0) -> list[int]:
        """The frames whose time the poses cover."""
        if self.frames is None:
            return []
        first_us, last_us = self.recording.trajectory.span_us
        t_us = self.frames.pictures.t_us + self.correction.late_us
        good = (t_us - margin_us >= first_us) & (t_us + margin_us <= last_us)
        return np.flatnonzero(good).tolist()

    def carried(self, view: View, t_us: float) -> Array:
        """(H, W) inverse depth of a view, from the depth nearest to a time; see `views.carried`."""
        return carried(self.depth.nearest(t_us), view)

    def slices(self, first_us: int, last_us: int) -> Iterator[tuple[int, int, Depths]]:
        """Cuts a span into slices of so little motion that one carried map holds for each.

        Yields:
            Begin and end, µs, half open; and the event camera's map in the middle.
        """
        t0_us = first_us
        while t0_us < last_us:
            t1_us = min(t0_us + self._step_us(t0_us, last_us), last_us)
            middle_us = (t0_us + t1_us) / 2
            view = self.view(self.event_camera, middle_us)
            yield t0_us, t1_us, [(self.carried(view, middle_us), view)]
            t0_us = t1_us

    def _step_us(self, t0_us: int, last_us: int) -> int:
        """How long the event camera moves what it sees by less than `_STILL_PX`, µs."""
        later_us = min(t0_us + _TRIED_US, last_us)
        before, after = (self.view(self.event_camera, t) for t in (t0_us, later_us))
        moved = []
        for rho, source in self.depth.nearest(t0_us):
            some = rho[::_EVERY, ::_EVERY]
            bearing = bearings(source.camera)[::_EVERY, ::_EVERY][some >= 0]
            points, scale = source.points(bearing, some[some >= 0]), some[some >= 0]
            moved.append(after.seen(points, scale)[0] - before.seen(points, scale)[0])
        far = np.linalg.norm(np.concatenate(moved), axis=-1)
        far = far[np.isfinite(far)]
        most_px = float(np.percentile(far, 95)) if len(far) else 0.0
        wanted_us = (later_us - t0_us) * _STILL_PX / max(most_px, 1e-9)
        return int(np.clip(wanted_us, _SHORTEST_US, _LONGEST_US))


def set_up(
    recording: Recording, depth: DepthSource, *, frames: str = "", events: str = "", into: str = ""
) -> Setup:
    """Finds cameras by name.

    Args:
        recording: what has them.
        depth: where depth comes from.
        frames: the frame camera; by default the first, of its own pixels where there is one.
        events: the event camera; by default the first.
        into: whose pixels everything gets; by default the event camera's.

    Raises:
        InputError: a camera that is not there.
    """
    names = recording.rig.camera_names
    found = {each.name: each for each in frame_cameras(recording)}
    eye = names.index(_known(recording, events, names)) if events else 0
    chosen = found[_known(recording, frames, tuple(found))] if frames else (
        next(iter(found.values()), None)
    )  # fmt: skip
    cameras = {name: _event_camera(recording, k) for k, name in enumerate(names)}
    for name, each in found.items():
        cameras.setdefault(name, Mounted(name, each.camera, each.T_body_cam))
    target = _known(recording, into or names[eye], tuple(cameras))
    return Setup(recording, depth, chosen, eye, cameras[target])


def _known(recording: Recording, name: str, names: tuple[str, ...]) -> str:
    if name in names:
        return name
    raise InputError(
        f"{recording.name}: no camera {name!r} here; choose from {', '.join(names) or 'none'}"
    )


def _event_camera(recording: Recording, k: int) -> Mounted:
    rig = recording.rig
    return Mounted(rig.camera_names[k], rig.cameras[k], rig.T_body_cam[k])
