"""Possible mistakes in a recording: conventions, orders, units, swaps, and their cures.

Each alternative corrects one possible mistake. If rays meet more sharply under it than in the
recording as given, that mistake was made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.cameras import image_times, is_centre_exchanged
from eventsweep.plugins.diagnose.check.orientations import axes_words, rereadings, signed_axes

Matrix = NDArray[np.float64]
Alter = Callable[[Recording], Recording]
MARGIN = 0.04
"""The least gain in log sharpness that counts."""


@dataclass(frozen=True)
class Alternative:
    """One possible mistake.

    Attributes:
        name: of the mistake, such as `poses inverted`.
        change: gives the corrected recording.
        cure: what to do about it.
        of_pair: whether it concerns two cameras, and not camera 0 and its poses.
    """

    name: str
    change: Alter
    cure: str
    of_pair: bool = False


class MirroredRecording(DerivedRecording):
    """A recording whose events are mirrored: columns counted from the right, or rows from below."""

    def __init__(self, recording: Recording, *, columns: bool = False, rows: bool = False) -> None:
        super().__init__(recording)
        self._columns, self._rows = columns, rows

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`, mirrored on its sensor."""
        events, sensor = self.recording.events(camera, t0_us, t1_us), self.rig.cameras[camera]
        x = (sensor.width_px - 1 - events.x).astype(np.uint16) if self._columns else events.x
        y = (sensor.height_px - 1 - events.y).astype(np.uint16) if self._rows else events.y
        return Events(x, y, events.t_us, events.p)


def of_poses(recording: Recording) -> list[Alternative]:
    """Possible mistakes about one camera and its poses, besides their clock and unit."""
    T_body_cam = recording.rig.T_body_cam[0]
    alternatives = [
        Alternative(
            "poses inverted", _poses(_inverted),
            "the file holds T_cam_world: invert every pose, R^T and -R^T t",
        ),
        Alternative(
            "rotations inverted", _poses(_rotations_inverted),
            "the file stores R_cam_world with positions in the world: transpose the rotations",
        ),
        Alternative(
            "quaternions w first", _poses(_w_last),
            "the file stores qw qx qy qz: write them as qx qy qz qw",
        ),
        Alternative(
            "columns mirrored", lambda r: MirroredRecording(r, columns=True),
            "count columns from the left: x = width - 1 - x",
        ),
        Alternative(
            "rows mirrored", lambda r: MirroredRecording(r, rows=True),
            "count rows from the top: y = height - 1 - y",
        ),
        *_centres(recording.rig),
        *_axes(),
        *(
            Alternative(name, _poses(reread), cure)
            for name, reread, cure in rereadings(recording.trajectory)
        ),
    ]  # fmt: skip
    if not np.allclose(T_body_cam[:3, :3], np.eye(3), atol=0.02):
        alternatives += [
            Alternative(
                "hand-eye inverted", _hand_eye(se3.inverse),
                "the calibration stores T_cam_body instead of T_body_cam: invert it",
            ),
            Alternative(
                "hand-eye beside poses of the camera", _hand_eye(lambda _T: np.eye(4)),
                "the poses are the camera's already: leave the hand-eye transformation out",
            ),
        ]  # fmt: skip
    return alternatives


def _centres(rig: Rig) -> list[Alternative]:
    """What a principal point far from the middle looks like."""
    alternatives = []
    if any(map(is_centre_exchanged, rig.cameras)):
        alternatives.append(Alternative(
            "principal point exchanged", partial(with_lenses, change=_centre_back),
            "exchange cx and cy: their order in files is fx fy cx cy",
        ))  # fmt: skip
    if any(image_times(camera) != 1 for camera in rig.cameras):
        factor = 1 / image_times(rig.cameras[0])
        alternatives.append(Alternative(
            "calibration of another resolution", partial(with_lenses, change=_of_this_resolution),
            f"multiply fx, fy, cx and cy by {factor:.3g}, or calibrate at this resolution",
        ))  # fmt: skip
    return alternatives


def with_lenses(recording: Recording, change: Callable[[Camera], Camera]) -> Recording:
    """The recording with each camera's calibration changed."""
    rig = recording.rig
    return AlteredRecording(recording, rig=replace(rig, cameras=tuple(map(change, rig.cameras))))


def _centre_back(camera: Camera) -> Camera:
    return replace(camera, cx_px=camera.cy_px, cy_px=camera.cx_px)


def _of_this_resolution(camera: Camera) -> Camera:
    f = 1 / image_times(camera)
    return replace(
        camera.zoomed(f), cx_px=(camera.cx_px + 0.5) * f - 0.5, cy_px=(camera.cy_px + 0.5) * f - 0.5
    )


def of_pair() -> list[Alternative]:
    """Possible mistakes between the two cameras of a rig."""
    return [
        Alternative(
            "cameras swapped", lambda r: AlteredRecording(r, streams=(1, 0)),
            "swap the event files of the two cameras", True,
        ),
        Alternative(
            "extrinsics inverted", lambda r: AlteredRecording(r, rig=between(r.rig, se3.inverse)),
            "the calibration stores T_cam1_cam0 instead of T_cam0_cam1: invert it", True,
        ),
        *(
            Alternative(
                f"{what} in {unit}", partial(change, factor=factor),
                f"write the {what} in metres: {unit} are {factor:g} m", True,
            )
            for what, change in (("positions", _scaled_poses), ("baseline", with_baseline))
            for unit, factor in _UNITS.items()
        ),
    ]  # fmt: skip


class Chosen(DerivedRecording):
    """Some cameras of a recording, in the order given."""

    def __init__(self, recording: Recording, cameras: tuple[int, ...]) -> None:
        super().__init__(recording)
        self._cameras, rig = cameras, recording.rig
        pick = [(rig.cameras[k], rig.T_body_cam[k], rig.camera_names[k]) for k in cameras]
        self._rig = Rig(rig.name, *zip(*pick, strict=True))

    @property
    def rig(self) -> Rig:
        """The chosen cameras."""
        return self._rig

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant of a chosen camera, µs."""
        return self.recording.event_span_us(self._cameras[camera])

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a chosen camera with `t0_us <= t < t1_us`."""
        return self.recording.events(self._cameras[camera], t0_us, t1_us)


_UNITS = {"mm": 0.001, "cm": 0.01, "km": 1000.0}


def _scaled_poses(recording: Recording, factor: float) -> Recording:
    p = recording.trajectory
    moved = Trajectory(p.t_us, p.positions_m * factor, p.quats_xyzw)
    return AlteredRecording(recording, trajectory=moved)


def with_baseline(recording: Recording, factor: float) -> Recording:
    """The recording with its two cameras so many times as far from each other."""

    def change(T_0_1: Matrix) -> Matrix:
        longer = T_0_1.copy()
        longer[:3, 3] *= factor
        return longer

    return AlteredRecording(recording, rig=between(recording.rig, change))


def _poses(change: Callable[[Trajectory], Trajectory]) -> Alter:
    altered = lru_cache(maxsize=1)(change)  # all windows have the same poses
    return lambda r: AlteredRecording(r, trajectory=altered(r.trajectory))


def _inverted(poses: Trajectory) -> Trajectory:
    return Trajectory.from_matrices(poses.t_us, se3.inverse(poses.at(poses.t_us)))


def _rotations_inverted(poses: Trajectory) -> Trajectory:
    turned = Rotation.from_quat(poses.quats_xyzw).inv().as_quat()
    return Trajectory(poses.t_us, poses.positions_m, turned)


def _w_last(poses: Trajectory) -> Trajectory:
    return Trajectory(poses.t_us, poses.positions_m, np.roll(poses.quats_xyzw, -1, axis=1))


def _hand_eye(change: Callable[[Matrix], Matrix]) -> Alter:
    def changed(recording: Recording) -> Recording:
        rig = recording.rig
        inside = [se3.inverse(rig.T_body_cam[0]) @ T for T in rig.T_body_cam]
        T_body_cam0 = change(rig.T_body_cam[0])
        moved = replace(rig, T_body_cam=tuple(T_body_cam0 @ T for T in inside))
        return AlteredRecording(recording, rig=moved)

    return changed


def between(rig: Rig, change: Callable[[Matrix], Matrix]) -> Rig:
    """A rig of two whose `T_cam0_cam1` is changed."""
    T_0_1 = se3.inverse(rig.T_body_cam[0]) @ rig.T_body_cam[1]
    return replace(rig, T_body_cam=(rig.T_body_cam[0], rig.T_body_cam[0] @ change(T_0_1)))


# Other axes of a camera, as columns: where their x, y and z point in ours: right, down, ahead.
CONVENTIONS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "OpenGL axes": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),  # right, up, back
    "ROS axes": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),  # ahead, left, up
    "NED axes": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),  # ahead, right, down
    "camera upside down": ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
}


def turns() -> dict[str, Matrix]:
    """The 23 other right-handed axes, by name: `R_cam_given` (3, 3)."""
    named = {name: np.array(columns, np.float64).T for name, columns in CONVENTIONS.items()}
    known = [np.eye(3), *named.values()]
    others = (
        R for R in signed_axes(right_handed=True) if not any(np.array_equal(R, k) for k in known)
    )
    return named | {f"axes {axes_words(R)}": R for R in others}


def _axes() -> list[Alternative]:
    alternatives = []
    for name, R_cam_given in turns().items():
        T_given_cam = se3.from_rotation(Rotation.from_matrix(R_cam_given.T), np.zeros(3))
        cure = (
            "the axes of the posed body differ from the camera's (x right, y down, z forward): "
            f"set the hand-eye rotation {R_cam_given.T.astype(int).tolist()}"
        )
        alternatives.append(Alternative(name, hand_eye_times(T_given_cam), cure))
    return alternatives


def hand_eye_times(T_given_cam: Matrix) -> Alter:
    """Turns the first camera on the body, and the others with it."""
    return _hand_eye(lambda T_body_cam: T_body_cam @ T_given_cam)
