"""Possible mistakes in a recording: conventions, orders, units, swaps, amounts, and their cures.

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
from eventsweep.plugins.diagnose.check.limits import MARGIN
from eventsweep.plugins.diagnose.check.orientations import axes_words, rereadings, signed_axes
from eventsweep.plugins.diagnose.parameters import (
    ROWS,
    TURNS,
    with_baseline,
    with_hand_eye,
    with_lenses,
    with_second,
)

Floats = NDArray[np.float64]
Alter = Callable[[Recording], Recording]


@dataclass(frozen=True)
class Alternative:
    """One possible mistake.

    Attributes:
        name: of the mistake, such as `poses inverted`.
        change: gives the corrected recording; of an amount, by how much as well.
        cure: what to do about it.
        of_pair: whether it concerns two cameras, and not camera 0 and its poses.
        margin: the least gain that counts, in logarithms.
    """

    name: str
    change: Callable[..., Recording]
    cure: str
    of_pair: bool = False
    margin: float = MARGIN

    @property
    def kind(self) -> str:
        """What is corrected; of a rotation whatever its axis."""
        return self.name.partition(" about ")[0]


@dataclass(frozen=True)
class Amount(Alternative):
    """A number that may be off; its cure holds the amount as `{amount}`.

    Attributes:
        unit: of the amounts; empty for factors.
        grid: amounts to try, the neutral one among them.
        hurts: the error from which a map suffers, in `unit`; of factors, in logarithms.
    """

    unit: str = ""
    grid: tuple[float, ...] = ()
    hurts: float = 0.0

    @property
    def is_factor(self) -> bool:
        """Whether amounts multiply: steps and differences are those of logarithms."""
        return 0.0 not in self.grid

    @property
    def neutral(self) -> float:
        """The amount that changes nothing."""
        return 1.0 if self.is_factor else 0.0

    def distance(self, amount: float) -> float:
        """How far an amount is from the neutral one."""
        return float(abs(np.log(amount)) if self.is_factor else abs(amount))

    def moved(self, amount: float, by: float) -> float:
        """An amount so far from another; `by` is a logarithm where amounts are factors."""
        return float(amount * np.exp(by) if self.is_factor else amount + by)

    def by(self, amount: float) -> Alter:
        """The change by an amount."""
        return lambda recording: self.change(recording, amount)


def amounts(*names: str) -> list[Alternative]:
    """Numbers that may be off, by their names in the table of parameters."""
    return [
        Amount(
            search.name.format(turn=turn, axis=axis), partial(search.change, k),
            search.cure.replace("{axis}", axis), row.of_pair, search.margin, search.unit,
            search.grid, hurts,
        )
        for row in map(ROWS.__getitem__, names) if (search := row.search)
        for k, ((axis, turn), hurts) in enumerate(zip(TURNS.items(), search.hurts, strict=False))
    ]  # fmt: skip


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


class Chosen(DerivedRecording):
    """Some cameras of a recording, in the order given."""

    def __init__(self, recording: Recording, cameras: tuple[int, ...]) -> None:
        super().__init__(recording)
        self._cameras, rig = cameras, recording.rig
        lenses = tuple(rig.cameras[k] for k in cameras)
        places = tuple(rig.T_body_cam[k] for k in cameras)
        self._rig = Rig(rig.name, lenses, places, tuple(rig.camera_names[k] for k in cameras))

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


def alternatives_of(recording: Recording, *, first: bool, paired: bool) -> list[Alternative]:
    """All that is tried with some cameras.

    Args:
        recording: which.
        first: whether what concerns camera 0 alone is tried, too.
        paired: whether there is a second camera. One alone does not determine its focal length:
            depth scales with it, and rays meet about as sharply.
    """
    alternatives: list[Alternative] = []
    if first:
        alternatives += of_poses(recording)
        alternatives += amounts(*(("focal",) if paired else ()), "pose-delay", "hand-eye")
    if paired:
        alternatives += [*of_pair(), *amounts("delay", "baseline", "stereo")]
    return alternatives


def of_poses(recording: Recording) -> list[Alternative]:
    """Possible mistakes about one camera and its poses, besides their clock and unit."""
    T_body_cam = recording.rig.T_body_cam[0]
    alternatives = [
        Alternative(
            "poses inverted",
            _poses(lambda p: Trajectory.from_matrices(p.t_us, se3.inverse(p.at(p.t_us)))),
            "the file holds T_cam_world: invert every pose, R^T and -R^T t",
        ),
        Alternative(
            "rotations inverted",
            _quats(lambda quats_xyzw: Rotation.from_quat(quats_xyzw).inv().as_quat()),
            "the file stores R_cam_world with positions in the world: transpose the rotations",
        ),
        Alternative(
            "quaternions w first", _quats(lambda quats_xyzw: np.roll(quats_xyzw, -1, axis=1)),
            "the file stores qw qx qy qz: write them as qx qy qz qw",
        ),
        Alternative(
            "columns mirrored", partial(MirroredRecording, columns=True),
            "count columns from the left: x = width - 1 - x",
        ),
        Alternative(
            "rows mirrored", partial(MirroredRecording, rows=True),
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
                "hand-eye inverted", partial(with_hand_eye, change=se3.inverse),
                "the calibration stores T_cam_body instead of T_body_cam: invert it",
            ),
            Alternative(
                "hand-eye beside poses of the camera",
                partial(with_hand_eye, change=lambda _T: np.eye(4)),
                "the poses are the camera's already: leave the hand-eye transformation out",
            ),
        ]  # fmt: skip
    return alternatives


def _centres(rig: Rig) -> list[Alternative]:
    """What a principal point far from the middle looks like."""
    alternatives = []
    if any(map(is_centre_exchanged, rig.cameras)):

        def back(camera: Camera) -> Camera:
            return replace(camera, cx_px=camera.cy_px, cy_px=camera.cx_px)

        alternatives.append(Alternative(
            "principal point exchanged", partial(with_lenses, change=back),
            "exchange cx and cy: their order in files is fx fy cx cy",
        ))  # fmt: skip
    if any(image_times(camera) != 1 for camera in rig.cameras):
        factor = 1 / image_times(rig.cameras[0])
        alternatives.append(Alternative(
            "calibration of another resolution", partial(with_lenses, change=_of_this_resolution),
            f"multiply fx, fy, cx and cy by {factor:.3g}, or calibrate at this resolution",
        ))  # fmt: skip
    return alternatives


def _of_this_resolution(camera: Camera) -> Camera:
    f = 1 / image_times(camera)
    centre = {name: (getattr(camera, name) + 0.5) * f - 0.5 for name in ("cx_px", "cy_px")}
    return replace(camera.zoomed(f), **centre)


def of_pair() -> list[Alternative]:
    """Possible mistakes between the two cameras of a rig."""
    return [
        Alternative(
            "cameras swapped", partial(AlteredRecording, streams=(1, 0)),
            "swap the event files of the two cameras", True,
        ),
        Alternative(
            "extrinsics inverted", partial(with_second, change=se3.inverse),
            "the calibration stores T_cam1_cam0 instead of T_cam0_cam1: invert it", True,
        ),
        *(
            Alternative(
                f"{what} in {unit}", partial(change, factor=factor),
                f"write the {what} in metres: {unit} are {factor:g} m", True,
            )
            for what, change in (("positions", _scaled_poses), ("baseline", with_baseline))
            for unit, factor in (("mm", 0.001), ("cm", 0.01), ("km", 1000.0))
        ),
    ]  # fmt: skip


def _scaled_poses(recording: Recording, factor: float) -> Recording:
    poses = recording.trajectory
    larger = replace(poses, positions_m=poses.positions_m * factor)
    return AlteredRecording(recording, trajectory=larger)


def _poses(change: Callable[[Trajectory], Trajectory]) -> Alter:
    altered = lru_cache(maxsize=1)(change)  # all windows have the same poses
    return lambda recording: AlteredRecording(recording, trajectory=altered(recording.trajectory))


def _quats(change: Callable[[Floats], Floats]) -> Alter:
    return _poses(lambda poses: replace(poses, quats_xyzw=change(poses.quats_xyzw)))


# Other axes of a camera, as columns: where their x, y and z point in ours: right, down, ahead.
CONVENTIONS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "OpenGL axes": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),  # right, up, back
    "ROS axes": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),  # ahead, left, up
    "NED axes": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),  # ahead, right, down
    "camera upside down": ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
}


def _axes() -> list[Alternative]:
    """The 23 other right-handed axes."""
    axes = {name: np.array(columns, np.float64).T for name, columns in CONVENTIONS.items()}
    known = [np.eye(3), *axes.values()]
    for R in signed_axes(right_handed=True):
        if not any(np.array_equal(R, other) for other in known):
            axes[f"axes {axes_words(R)}"] = R
    return [
        Alternative(
            name, _turned_back(R_cam_axes),
            "the axes of the posed body differ from the camera's (x right, y down, z forward): "
            f"set the hand-eye rotation {R_cam_axes.T.astype(int).tolist()}",
        )
        for name, R_cam_axes in axes.items()
    ]  # fmt: skip


def _turned_back(R_cam_axes: Floats) -> Alter:
    T_axes_cam = se3.from_rotation(Rotation.from_matrix(R_cam_axes.T), np.zeros(3))
    return partial(with_hand_eye, change=lambda T_body_cam: T_body_cam @ T_axes_cam)
