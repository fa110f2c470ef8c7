"""A rig: any number of calibrated cameras, rigidly mounted on one body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, check_array, check_type, refused, shown
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras and where they sit on the body.

    Attributes:
        name: what the rig is called.
        cameras: N >= 1 cameras.
        T_body_cam: one (4, 4) rigid motion per camera, m.
        camera_names: one name per camera.
        frame_cameras: ordinary cameras on the same body, if any: a rig of their own.

    Raises:
        InputError: no camera, lists of different length, or a motion that is not rigid.
    """

    name: str
    cameras: tuple[Camera, ...]
    T_body_cam: tuple[NDArray[np.float64], ...]
    camera_names: tuple[str, ...] = ()
    frame_cameras: Rig | None = None

    def __post_init__(self) -> None:
        self._check_types()
        if not self.camera_names:
            names = tuple(f"cam{k}" for k in range(len(self.cameras)))
            object.__setattr__(self, "camera_names", names)
        if not len(self.cameras) == len(self.T_body_cam) == len(self.camera_names) >= 1:
            raise InputError(
                f"rig {self.name}: {len(self.cameras)} cameras, {len(self.T_body_cam)} positions, "
                f"{len(self.camera_names)} names: needs as many of each, at least one"
            )
        for name, T_body_cam in zip(self.camera_names, self.T_body_cam, strict=True):
            if fault := se3.fault(T_body_cam):
                raise InputError(
                    f"rig {self.name}: T_body_cam of {name} is not a rigid motion ({fault})"
                )
        if self.frame_cameras is not None:
            self._check_frame_cameras(self.frame_cameras)

    def _check_frame_cameras(self, frame_cameras: Rig) -> None:
        check_type("rig's frame_cameras", frame_cameras, Rig, "a rig, or None")
        names = (*self.camera_names, *frame_cameras.camera_names)
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None or frame_cameras.frame_cameras is not None:
            what = f"two cameras named {twice!r}" if twice else "frame cameras of frame cameras"
            raise InputError(f"rig {self.name}: {what}: give each camera one name, in one list")

    def _check_types(self) -> None:
        for name in ("cameras", "camera_names"):
            check_type(f"rig's {name}", getattr(self, name), (tuple, list), "a tuple")
        check_type("rig's T_body_cam", self.T_body_cam, (tuple, list, np.ndarray), "a tuple")
        for camera in self.cameras:
            check_type("rig's camera", camera, Camera)
        for T_body_cam in self.T_body_cam:
            check_array("rig's T_body_cam", T_body_cam, "one (4, 4) array per camera")

    def __len__(self) -> int:
        return len(self.cameras)

    def __repr__(self) -> str:
        return f"Rig({self.name!r}, {self.sizes()})"

    def sizes(self) -> str:
        """Cameras, their pixels and the first baseline in words, for people."""
        pixels = dict.fromkeys(
            f"{camera.width_px} x {camera.height_px} px" for camera in self.cameras
        )
        words = f"{len(self)} camera{'s' * (len(self) > 1)}, {' and '.join(pixels)}"
        return f"{words}, baseline {self.baseline_m():.3g} m" if len(self) > 1 else words

    def check_camera(self, camera: int) -> None:
        """Refuses a camera that is not there."""
        if camera not in range(len(self)):
            raise InputError(
                f"rig {self.name}: no camera {shown(camera)}, it has 0 to {len(self) - 1}"
            )

    def baseline_m(self, i: int = 0, j: int = 1) -> float:
        """Distance between the centres of cameras i and j."""
        self.check_camera(i)
        self.check_camera(j)
        return float(np.linalg.norm(self.T_body_cam[i][:3, 3] - self.T_body_cam[j][:3, 3]))

    def to_json(self) -> dict[str, Any]:
        """Plain values; `T_body_cam` as rows of the (4, 4) matrix."""
        values: dict[str, Any] = {
            "name": self.name,
            "cameras": [
                {"name": name, **camera.to_json(), "T_body_cam": T_body_cam.tolist()}
                for name, camera, T_body_cam in zip(
                    self.camera_names, self.cameras, self.T_body_cam, strict=True
                )
            ],
        }
        if self.frame_cameras is not None:
            values["frame_cameras"] = self.frame_cameras.to_json()["cameras"]
        return values

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Rig:
        """Reads what `to_json` wrote, or somebody by hand: a rounded rotation becomes one again."""
        faults = KeyError, TypeError, AttributeError, OverflowError, ValueError
        with refused("rig calibration: an entry is missing, or not what it should be", *faults):
            entries = [dict(entry) for entry in values["cameras"]]
            names = tuple(str(entry.pop("name")) for entry in entries)
            places = [np.array(entry.pop("T_body_cam"), np.float64) for entry in entries]
            cameras = tuple(Camera.from_json(entry) for entry in entries)
            rig = cls(str(values["name"]), cameras, tuple(map(_unrounded, places)), names)
            if "frame_cameras" not in values:
                return rig
            beside = {"name": f"{rig.name}, frames", "cameras": values["frame_cameras"]}
            return replace(rig, frame_cameras=cls.from_json(beside))


def _unrounded(T_body_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest rigid motion, where rounding alone keeps it from being one."""
    near = not se3.is_rigid(T_body_cam) and not se3.fault(T_body_cam, se3.ROUNDED)
    return se3.nearest_rigid(T_body_cam) if near else T_body_cam
