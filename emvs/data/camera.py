"""Camera models: pinhole, radial-tangential (OpenCV, 4 or 5 terms) and Kannala-Brandt 4."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emvs.data import distortion
from emvs.errors import InputError

Model = Literal["pinhole", "radtan", "kb4"]
# A distorted position that cannot be reproduced to this many pixels has no ray.
_ROUND_TRIP_PX = 1e-6


@dataclass(frozen=True)
class Camera:
    """Intrinsics and distortion of one camera; pixel centres lie at integer coordinates.

    Attributes:
        width_px: sensor columns.
        height_px: sensor rows.
        fx_px: focal length, horizontal.
        fy_px: focal length, vertical.
        cx_px: principal point, column.
        cy_px: principal point, row.
        model: `pinhole`, `radtan` (k1, k2, p1, p2[, k3] as OpenCV orders them) or `kb4` (k1..k4).
        distortion: the model's coefficients, without unit.

    Raises:
        InputError: a value that no camera has.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    model: Model = "pinhole"
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model not in get_args(Model):
            raise InputError(
                f"camera model {self.model!r}: needs one of {', '.join(get_args(Model))}"
            )
        if len(self.distortion) not in distortion.TERMS[self.model]:
            raise InputError(
                f"camera model {self.model} with {len(self.distortion)} distortion terms: "
                f"needs {' or '.join(map(str, distortion.TERMS[self.model]))}"
            )
        if self.width_px < 1 or self.height_px < 1:
            raise InputError(
                f"camera of {self.width_px}x{self.height_px} px: both must be at least 1"
            )
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        if not np.all(np.isfinite(numbers)) or self.fx_px <= 0 or self.fy_px <= 0:
            raise InputError(f"camera intrinsics {numbers}: must be finite, focal lengths above 0")

    @property
    def K(self) -> NDArray[np.float64]:
        """The (3, 3) intrinsic matrix, px."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])

    def project(self, points_cam: ArrayLike) -> NDArray[np.float64]:
        """Projects points onto the (distorted) sensor.

        Args:
            points_cam: (..., 3) points in the camera frame, m.

        Returns:
            (..., 2) pixel coordinates; NaN where z <= 0.
        """
        points = np.asarray(points_cam, np.float64)
        z = points[..., 2:3]
        with np.errstate(divide="ignore", invalid="ignore"):
            bearing = np.where(z > 0, points[..., :2] / z, np.nan)
        return self._to_pixels(distortion.DISTORT[self.model](bearing, self.distortion))

    def unproject(self, uv_px: ArrayLike) -> NDArray[np.float64]:
        """Finds the ray through each pixel position.

        Args:
            uv_px: (..., 2) positions on the (distorted) sensor, px.

        Returns:
            (..., 2) bearings x/z and y/z; NaN where no ray in front of the camera lands there.
        """
        uv = np.asarray(uv_px, np.float64)
        sensor = (uv - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        with np.errstate(all="ignore"):
            bearing = distortion.UNDISTORT[self.model](sensor, self.distortion)
            missed = self._to_pixels(distortion.DISTORT[self.model](bearing, self.distortion)) - uv
            good = np.abs(missed).max(axis=-1, keepdims=True) < _ROUND_TRIP_PX
        return np.where(good, bearing, np.nan)

    def bearing_table(self) -> NDArray[np.float64]:
        """The rectification table: (height, width, 2) bearing of every sensor pixel."""
        columns, rows = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        return self.unproject(np.stack([columns, rows], axis=-1))

    def undistorted(self) -> Camera:
        """The pinhole camera with the same intrinsics and size."""
        return replace(self, model="pinhole", distortion=())

    def to_json(self) -> dict[str, Any]:
        """Plain values, in the order of the attributes."""
        return {
            "width_px": self.width_px, "height_px": self.height_px,
            "fx_px": self.fx_px, "fy_px": self.fy_px, "cx_px": self.cx_px, "cy_px": self.cy_px,
            "model": self.model, "distortion": list(self.distortion),
        }  # fmt: skip

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Camera:
        """Reads what `to_json` wrote.

        Raises:
            InputError: a missing, unknown or impossible value.
        """
        try:
            return cls(**{**values, "distortion": tuple(values.get("distortion", ()))})
        except TypeError as error:
            raise InputError(f"camera {values}: {error}") from error

    def _to_pixels(self, sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        return sensor * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)
