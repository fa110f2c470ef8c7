"""Camera models: pinhole, radial-tangential (OpenCV, 4 or 5 terms) and Kannala-Brandt 4.

`DISTORT` maps a bearing (x/z, y/z) to where an ideal sensor of focal length 1 sees it; `UNDISTORT`
is its inverse, by Newton's method, NaN where the model folds over and no physical ray exists.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.emvs.errors import InputError, check_type, check_whole, quoted, shown

Model = Literal["pinhole", "radtan", "kb4"]
# A distorted position that cannot be reproduced to this many pixels has no ray.
_ROUND_TRIP_PX = 1e-6
_MOST_PX = 1 << 16  # as many columns as events can name
_LARGEST = 1e9  # px, or without unit: beyond any lens
_Lens = Callable[[NDArray[np.float64], tuple[float, ...]], NDArray[np.float64]]
TERMS = {"pinhole": (0,), "radtan": (4, 5), "kb4": (4,)}
_ITERATIONS = 100


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
        self._check_types()
        if len(self.distortion) not in TERMS[self.model]:
            raise InputError(
                f"camera model {self.model} with {len(self.distortion)} distortion terms: "
                f"needs {' or '.join(map(str, TERMS[self.model]))}"
            )
        if self.width_px < 1 or self.height_px < 1:
            raise InputError(
                f"camera of {self.width_px}x{self.height_px} px: both must be at least 1"
            )
        if max(self.width_px, self.height_px) > _MOST_PX:
            size = quoted(f"{self.width_px}x{self.height_px}")
            raise InputError(f"camera of {size} px: both must be at most {_MOST_PX}")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion)
        # compared one by one: NumPy takes no integer beyond 64 bits, as JSON may hold
        if not all(abs(n) <= _LARGEST for n in numbers) or self.fx_px <= 0 or self.fy_px <= 0:
            raise InputError(
                f"camera intrinsics {quoted(*numbers)}: must be finite, at most {_LARGEST:g}, "
                "focal lengths above 0"
            )

    def _check_types(self) -> None:
        for name in ("width_px", "height_px"):
            check_whole(f"camera's {name}", getattr(self, name))
        for name in ("fx_px", "fy_px", "cx_px", "cy_px"):
            check_type(f"camera's {name}", getattr(self, name), Real, "a number")
        check_type("camera's distortion", self.distortion, (tuple, list), "a tuple of numbers")
        for term in self.distortion:
            check_type("a term of the camera's distortion", term, Real, "a number")

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
        points = _vectors("points_cam", points_cam, 3)
        z = points[..., 2:3]
        with np.errstate(divide="ignore", invalid="ignore"):
            bearing = np.where(z > 0, points[..., :2] / z, np.nan)
        return self._to_pixels(DISTORT[self.model](bearing, self.distortion))

    def unproject(self, uv_px: ArrayLike) -> NDArray[np.float64]:
        """Finds the ray through each pixel position.

        Args:
            uv_px: (..., 2) positions on the (distorted) sensor, px.

        Returns:
            (..., 2) bearings x/z and y/z; NaN where no ray in front of the camera lands there.
        """
        uv = _vectors("uv_px", uv_px, 2)
        sensor = (uv - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)
        with np.errstate(all="ignore"):
            bearing = UNDISTORT[self.model](sensor, self.distortion)
            missed = self._to_pixels(DISTORT[self.model](bearing, self.distortion)) - uv
            good = np.abs(missed).max(axis=-1, keepdims=True) < _ROUND_TRIP_PX
        return np.where(good, bearing, np.nan)

    def bearing_table(self) -> NDArray[np.float64]:
        """The rectification table: (height, width, 2) bearing of every sensor pixel."""
        columns, rows = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        return self.unproject(np.stack([columns, rows], axis=-1))

    def ray_table(self) -> NDArray[np.float64]:
        """(height, width, 3) direction of every sensor pixel in the camera's frame, its z 1."""
        bearing = self.bearing_table()
        return np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1)

    def undistorted(self) -> Camera:
        """The pinhole camera with the same intrinsics and size."""
        return replace(self, model="pinhole", distortion=())

    def zoomed(self, factor: float) -> Camera:
        """The camera with both focal lengths multiplied; sensor, centre and distortion stay."""
        return replace(self, fx_px=self.fx_px * factor, fy_px=self.fy_px * factor)

    def to_json(self) -> dict[str, Any]:
        """Plain values, in the order of the attributes."""
        return {
            "width_px": self.width_px, "height_px": self.height_px,
            "fx_px": self.fx_px, "fy_px": self.fy_px, "cx_px": self.cx_px, "cy_px": self.cy_px,
            "model": self.model, "distortion": list(self.distortion),
        }  # fmt: skip

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Camera:
        """Reads what `to_json` wrote."""
        try:
            return cls(**{**values, "distortion": tuple(values.get("distortion", ()))})
        except TypeError as error:
            raise InputError(f"camera {values}: {error}") from error

    def _to_pixels(self, sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        return sensor * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)


def _vectors(name: str, given: ArrayLike, length: int) -> NDArray[np.float64]:
    try:
        vectors = np.asarray(given, np.float64)
    except (TypeError, ValueError):
        vectors = np.empty(0)
    if vectors.shape[-1:] != (length,):
        raise InputError(f"{name} is {shown(given)}: needs numbers of shape (..., {length})")
    return vectors


def _distort_radtan(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Brown-Conrady, as OpenCV's `projectPoints` with (k1, k2, p1, p2[, k3])."""
    k1, k2, p1, p2, k3 = (*terms, 0.0)[:5]
    x, y = bearing[..., 0], bearing[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def _undistort_radtan(sensor: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Newton's method on the forward model, numeric Jacobian; starts at the distorted position."""
    bearing = sensor.copy()
    step = 1e-7
    step_x, step_y = np.array([step, 0]), np.array([0, step])
    for _ in range(_ITERATIONS):
        wrong = _distort_radtan(bearing, terms) - sensor
        dx = (_distort_radtan(bearing + step_x, terms) - sensor - wrong) / step
        dy = (_distort_radtan(bearing + step_y, terms) - sensor - wrong) / step
        determinant = dx[..., 0] * dy[..., 1] - dy[..., 0] * dx[..., 1]
        move_x = (wrong[..., 0] * dy[..., 1] - wrong[..., 1] * dy[..., 0]) / determinant
        move_y = (wrong[..., 1] * dx[..., 0] - wrong[..., 0] * dx[..., 1]) / determinant
        move = np.stack([move_x, move_y], axis=-1)
        bearing = bearing - move
        if np.nanmax(np.abs(move), initial=0.0) < 1e-14:
            break
    # Past the turning point of the radial curve the model folds over: no physical ray is there.
    return np.where(_grows_outward(bearing, terms)[..., None], bearing, np.nan)


def _grows_outward(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.bool_]:
    """Whether the radius grows all the way from the middle: looked at in 33 places of it."""
    k1, k2, _, _, k3 = (*terms, 0.0)[:5]
    r2 = (bearing**2).sum(axis=-1)
    grows = np.ones(r2.shape, bool)
    for share in np.linspace(0, 1, 33):  # one by one: all at once would be 33 tables in memory
        inner = share * r2
        grows &= 1 + inner * (3 * k1 + inner * (5 * k2 + inner * 7 * k3)) > 0
    return grows


def _distort_kb4(bearing: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Kannala and Brandt (PAMI 2006) with four terms, as OpenCV's `fisheye`."""
    r = np.hypot(bearing[..., 0], bearing[..., 1])
    theta = np.arctan(r)
    scale = np.where(r > 1e-12, _kb4_radius(theta, terms) / np.maximum(r, 1e-12), 1.0)
    return bearing * scale[..., None]


def _undistort_kb4(sensor: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    """Newton's method on the angle from the optical axis."""
    k1, k2, k3, k4 = terms
    radius = np.hypot(sensor[..., 0], sensor[..., 1])
    theta = np.minimum(radius, np.pi / 2 - 1e-3)
    for _ in range(_ITERATIONS):
        t2 = theta * theta
        slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        move = (_kb4_radius(theta, terms) - radius) / slope
        theta = theta - move
        if np.nanmax(np.abs(move), initial=0.0) < 1e-15:
            break
    theta = np.where((theta >= 0) & (theta < np.pi / 2) & (slope > 0), theta, np.nan)
    scale = np.where(radius > 1e-12, np.tan(theta) / np.maximum(radius, 1e-12), 1.0)
    return sensor * scale[..., None]


def _kb4_radius(theta: NDArray[np.float64], terms: tuple[float, ...]) -> NDArray[np.float64]:
    k1, k2, k3, k4 = terms
    t2 = theta * theta
    return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))


_SAME: dict[str, _Lens] = {"pinhole": lambda bearing, _terms: bearing}
DISTORT = _SAME | {"radtan": _distort_radtan, "kb4": _distort_kb4}
UNDISTORT = _SAME | {"radtan": _undistort_radtan, "kb4": _undistort_kb4}
