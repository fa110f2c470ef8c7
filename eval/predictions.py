"""Depth maps of somebody else's method: found, checked like a submission, and read one by one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from eval.depth_images import is_integral, read_confidence, read_numbers
from eval.prediction_files import DESCRIPTION, Description, read_description, timed_files

UNIT_FACTOR = 30.0
"""A median depth farther than this from the true one is of another unit, or no depth at all."""


@dataclass(frozen=True)
class View:
    """A reference view that wants a depth map.

    Attributes:
        t_us: its time.
        width_px: its columns.
        height_px: its rows.
        focal_px: its focal length.
        baseline_m: distance of the rig's first two cameras; None for a rig of one.
        true_depth_m: its median true depth; None where that is not known.
    """

    t_us: int
    width_px: int
    height_px: int
    focal_px: float
    baseline_m: float | None
    true_depth_m: float | None = None


@dataclass(frozen=True)
class Prediction:
    """The depth maps of one method for one case.

    Attributes:
        name: of the method, as scores call it.
        files: by time, µs.
        description: what their numbers mean.
    """

    name: str
    files: Mapping[int, Path]
    description: Description

    @classmethod
    def open(cls, folder: Path, case: str) -> Prediction:
        """Finds the files for a case: in the folder's subfolder of that name, or in itself.

        Raises:
            InputError: no folder, no depth map in it, times that cannot be told, or a
                description that cannot be used.
        """
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; needs one with depth maps")
        description = read_description(folder / DESCRIPTION)
        own = folder / case
        files = timed_files(own if own.is_dir() else folder, description)
        name = re.sub(r"[^\w.+@~-]", "_", description.name or folder.resolve().name)
        return cls(f"Given/{name}", files, description)

    def check(self, views: Sequence[View]) -> None:
        """Refuses a prediction that is not complete, as a submission checker does.

        Raises:
            InputError: a view without a file; says how many, and the nearest time there is.
        """
        missing = [view.t_us for view in views if self._file(view.t_us) is None]
        if not missing:
            return
        near_us = self._nearest_us(missing[0])
        raise InputError(
            f"{self.name}: {len(missing)} of {len(views)} reference views have no depth map; the "
            f"first is that at {missing[0]} µs, the nearest file, {self.files[near_us].name}, lies "
            f"{near_us - missing[0]:+d} µs beside it: add files, or set time_unit, time_offset_us "
            f"or tolerance_us in {DESCRIPTION}"
        )

    def unused(self, views: Iterable[View]) -> list[str]:
        """Names of files that belong to no view."""
        used = {self._file(view.t_us) for view in views}
        return sorted(path.name for path in self.files.values() if path not in used)

    def depth_m(self, view: View) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Reads the depth map of a view: (H, W) z-depth in metres, and where there is one.

        Raises:
            InputError: no file for it, a damaged one, one of another size, numbers without the
                scale, baseline or focal length that give them a meaning, or in another unit.
        """
        self.check([view])
        path = self.files[self._nearest_us(view.t_us)]
        stored = read_numbers(path, view.height_px, view.width_px)
        numbers = stored * self._scale(path)
        if self.description.quantity == "disparity":
            _check_disparity(path)
            numbers = self._baseline_focal(path, view) / numbers
        depth_m = numbers.astype(np.float32)
        mask = np.isfinite(depth_m) & (depth_m > 0)
        self._check_unit(path, depth_m[mask], view)
        return np.where(mask, depth_m, np.float32(0)), mask

    def confidence(self, view: View) -> NDArray[np.float64] | None:
        """Reads how sure the method is: (H, W), larger is surer; None where it does not say.

        Raises:
            InputError: no file for the view, or a confidence that is no image of its size.
        """
        self.check([view])
        path = self.files[self._nearest_us(view.t_us)]
        return read_confidence(path, view.height_px, view.width_px)

    def _check_unit(self, path: Path, depth_m: NDArray[np.float32], view: View) -> None:
        if self.description.scale is not None or view.true_depth_m is None or not depth_m.size:
            return
        median_m = float(np.median(depth_m))
        if 1 / UNIT_FACTOR <= median_m / view.true_depth_m <= UNIT_FACTOR:
            return
        raise InputError(
            f"{path}: its median depth would be {median_m:.3g} m, but the true one is "
            f"{view.true_depth_m:.3g} m: set scale in {DESCRIPTION} (0.001 for millimetres, 1 if "
            "the numbers are meant as they are), or quantity if they are disparities"
        )

    def _file(self, t_us: int) -> Path | None:
        near_us = self._nearest_us(t_us)
        return self.files[near_us] if abs(near_us - t_us) <= self.description.tolerance_us else None

    def _nearest_us(self, t_us: int) -> int:
        return min(self.files, key=lambda at_us: abs(at_us - t_us))

    def _scale(self, path: Path) -> float:
        if self.description.scale is None and is_integral(path):
            raise InputError(
                f"{path}: whole numbers without a unit: set scale in {DESCRIPTION}, such as 0.001 "
                "for millimetres of depth or 0.00390625 for disparities in 1/256 px"
            )
        return self.description.scale or 1.0

    def _baseline_focal(self, path: Path, view: View) -> float:
        baseline_m = self.description.baseline_m or view.baseline_m
        if baseline_m is None:
            raise InputError(
                f"{path}: disparity for a rig of one camera: set baseline_m in {DESCRIPTION}"
            )
        return baseline_m * (self.description.focal_px or view.focal_px)


def _check_disparity(path: Path) -> None:
    if path.suffix.lower() == ".npz":
        raise InputError(
            f"{path}: holds depth_m, but quantity in {DESCRIPTION} is disparity: correct it, or "
            "save disparities as .npy"
        )
