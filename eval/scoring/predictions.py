"""Depth maps of somebody else's method: found, checked like a submission, read one by one."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, ValidationError

from eventsweep.emvs.errors import InputError, refused, repeated
from eventsweep.emvs.parameters import FrozenModel, TimeUs, first_fault
from eventsweep.emvs.utils.inputs import (
    SETTINGS_BYTES,
    TABLE_BYTES,
    check_file,
    inside,
    parse_toml,
    read_text,
)
from eventsweep.eval.scoring.depth_files import (
    SUFFIXES,
    depths_in,
    is_integral,
    read_confidence,
    read_stored,
)
from eventsweep.eval.scoring.pairing import Estimate

UNIT_FACTOR = 30.0
"""A median depth farther than this from the true one is of another unit, or no depth at all."""
DESCRIPTION = "prediction.toml"
TIMES = "timestamps.txt"
FAMILY = "Given/"
"""What the names of predictions begin with, as scores call them."""
_UNFIT = re.compile(r"[^\w.+@~-]")
_STEM = re.compile(r"\d{1,18}(?!\d)(\.\d+)?")


class NamedFolder(NamedTuple):
    """A folder with depth maps of others, and what its user calls the method, if anything."""

    path: Path
    name: str | None = None

    @classmethod
    def of(cls, asked: str | Path) -> NamedFolder:
        """Reads `NAME=DIR` or `DIR`; what is a folder as it stands has no name before it."""
        name, equals, place = str(asked).partition("=")
        if isinstance(asked, Path) or not equals or "/" in name or Path(asked).is_dir():
            return cls(Path(asked))
        if not name.strip() or not place:
            raise InputError(f"prediction {asked!r}: needs NAME=DIR or DIR")
        return cls(Path(place), name.strip())


class PredictionFacts(FrozenModel):
    """What the numbers in a prediction's files mean: `prediction.toml`, all of it optional."""

    name: str | None = Field(None, min_length=1, description="of the method; default: the folder's")
    quantity: Literal["depth", "disparity"] = Field("depth", description="z-depth or disparity")
    scale: FiniteFloat | None = Field(
        None, gt=0, description="m or px per stored unit; needed for PNG, otherwise 1"
    )
    time_unit: Literal["us", "s"] = Field("us", description="of the times in file names")
    time_offset_us: TimeUs = Field(0, description="added to the times, µs")
    tolerance_us: TimeUs = Field(0, ge=0, description="how far a time may be off, µs")
    may_be_empty: bool = Field(False, description="a depth map without any depth is meant so")
    baseline_m: FiniteFloat | None = Field(
        None, gt=0, description="that disparities refer to; by default the rig's"
    )
    focal_px: FiniteFloat | None = Field(
        None, gt=0, description="that disparities refer to; by default the reference view's"
    )


def read_description(path: Path) -> PredictionFacts:
    """Reads `prediction.toml`; all defaults where there is none."""
    if not os.path.lexists(path):
        return PredictionFacts()
    inside(path.parent, path.name)
    try:
        return PredictionFacts.model_validate(parse_toml(read_text(path, SETTINGS_BYTES)))
    except ValidationError as error:
        known = ", ".join(PredictionFacts.model_fields)
        raise InputError(f"{path}: {first_fault(error)}; it may hold {known}") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not TOML ({error}): correct it") from error


def timed_files(root: Path, description: PredictionFacts, place: str = "") -> dict[int, Path]:
    """Finds the depth maps of a folder, or of one below it, by their times, µs."""
    folder = inside(root, place) if place else root
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.name != TIMES and not path.name.startswith(".")
    )
    if not paths:
        raise InputError(f"{folder}: no depth maps; needs files of kind {', '.join(SUFFIXES)}")
    listed = folder / TIMES
    times = _listed(listed, paths) if listed.exists() else [_stamp(path) for path in paths]
    for path in paths:
        check_file(inside(folder, path.name))
    per_unit = 1_000_000 if description.time_unit == "s" else 1
    files: dict[int, Path] = {}
    for path, time in zip(paths, times, strict=True):
        t_us = round(float(time) * per_unit) if "." in time else int(time) * per_unit
        t_us += description.time_offset_us
        if t_us in files:
            raise InputError(
                f"{folder}: {files[t_us].name} and {path.name} are both for {t_us} µs: leave one"
            )
        files[t_us] = path
    return files


def plain(name: str) -> str:
    """A name as methods and folders carry it: letters, digits and few signs."""
    return _UNFIT.sub("_", name)


def _listed(path: Path, files: Sequence[Path]) -> list[str]:
    with refused(f"{path}: cannot be read", OSError, UnicodeDecodeError):
        times = read_text(inside(path.parent, path.name), TABLE_BYTES).split()
    bad = [time for time in times if not _STEM.fullmatch(time)]
    if bad or len(times) != len(files):
        reason = f"{bad[0]!r} is not a time" if bad else f"it has {len(times)} of them"
        raise InputError(
            f"{path}: needs one time per line for each of {len(files)} files in order of names, "
            f"but {reason}"
        )
    return times


def _stamp(path: Path) -> str:
    found = _STEM.match(path.stem)
    if found is None:
        raise InputError(
            f"{path}: its name must begin with the time of its reference view, or {TIMES} beside "
            "it must list the times"
        )
    return found.group()


@dataclass(frozen=True)
class TargetView:
    """A reference view that a prediction must have a depth map for.

    Attributes:
        t_us: its time.
        width_px: its columns.
        height_px: its rows.
        focal_px: its focal length.
        baseline_m: distance of the rig's first two cameras; None for a rig of one.
        true_depth_m: the closed range that its median true depth lies in; None where that is not
            known.
    """

    t_us: int
    width_px: int
    height_px: int
    focal_px: float
    baseline_m: float | None
    true_depth_m: tuple[float, float] | None = None


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
    description: PredictionFacts

    @classmethod
    def open(cls, folder: str | Path, case: str, name: str | None = None) -> Prediction:
        """Finds the files for a case: in the folder's subfolder of that name, or in itself.

        Args:
            folder: with depth maps and perhaps `prediction.toml`.
            case: name of the case.
            name: of the method; by default that in `prediction.toml`, else the folder's.

        Raises:
            InputError: no folder, no depth map in it, a file without a time, or a
                description that cannot be used.
        """
        folder = Path(folder)
        description = described(folder)
        own = folder / case
        files = timed_files(folder, description, case if own.is_dir() else "")
        return cls(method_name(NamedFolder(folder, name), description), files, description)

    def check(self, views: Sequence[TargetView]) -> None:
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
            f"first is that at {missing[0]} µs, the nearest file, {self.files[near_us].name}, is "
            f"{near_us - missing[0]:+d} µs away: add files, or set time_unit, time_offset_us "
            f"or tolerance_us in {DESCRIPTION}"
        )

    def depth_m(self, view: TargetView) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Reads the depth map of a view: (H, W) z-depth in metres, and its mask.

        Raises:
            InputError: no file for it, a damaged one, one of another size or without any depth,
                numbers without the scale, baseline or focal length that give them a meaning, or
                in another unit.
        """
        path = self.path_of(view)
        stored = depths_in(read_stored(path, view.height_px, view.width_px))
        numbers = stored * self._scale(path)
        if self.description.quantity == "disparity":
            _check_disparity(path)
            numbers = self._baseline_focal(path, view) / numbers
        depth_m = numbers.astype(np.float32)
        mask = np.isfinite(depth_m) & (depth_m > 0)
        if not mask.any() and not self.description.may_be_empty:
            raise InputError(
                f"{path}: no {self.description.quantity} for the reference view at {view.t_us} µs: "
                f"none of its {mask.size} pixels is finite and positive; export it again, or set "
                f"may_be_empty = true in {DESCRIPTION} if the method found nothing there"
            )
        self._check_unit(path, depth_m[mask], view)
        return np.where(mask, depth_m, np.float32(0)), mask

    def confidence(self, view: TargetView) -> NDArray[np.float64] | None:
        """Reads the confidence of a view, (H, W), larger is more confident; None if it has none.

        Raises:
            InputError: no file for the view, or a confidence that is no image of its size.
        """
        return read_confidence(self.path_of(view), view.height_px, view.width_px)

    def check_signs(self, view: TargetView) -> None:
        """Refuses negative numbers that no mask hides: `depth_m` takes them for no depth."""
        path = self.path_of(view)
        stored = read_stored(path, view.height_px, view.width_px)
        count = int(np.count_nonzero(stored < 0))
        if count:
            raise InputError(
                f"{path}: {count} of {stored.size} numbers are negative, the least "
                f"{np.nanmin(stored):.3g}: write NaN or 0 where there is no depth"
            )

    def path_of(self, view: TargetView) -> Path:
        """The file of a view, which must have one."""
        self.check([view])
        return self.files[self._nearest_us(view.t_us)]

    def _check_unit(self, path: Path, depth_m: NDArray[np.float32], view: TargetView) -> None:
        if self.description.scale is not None or view.true_depth_m is None or not depth_m.size:
            return
        median_m, (near_m, far_m) = float(np.median(depth_m)), view.true_depth_m
        if near_m / UNIT_FACTOR <= median_m <= far_m * UNIT_FACTOR:
            return
        true_m = f"{near_m:.3g}" if near_m == far_m else f"{near_m:.3g} to {far_m:.3g}"
        raise InputError(
            f"{path}: its median depth would be {median_m:.3g} m, but the true one is "
            f"{true_m} m: set scale in {DESCRIPTION} (0.001 for millimetres, 1 if "
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

    def _baseline_focal(self, path: Path, view: TargetView) -> float:
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


def described(folder: Path) -> PredictionFacts:
    """What a folder says of its numbers."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; needs one with depth maps")
    return read_description(folder / DESCRIPTION)


def method_name(folder: NamedFolder, description: PredictionFacts) -> str:
    """What scores call a method: by its user, its description, or its folder."""
    return FAMILY + plain(folder.name or description.name or folder.path.resolve().name)


def check_names(names: Sequence[str]) -> None:
    """Refuses methods of one name."""
    twice = repeated(names)
    if twice is not None:
        raise InputError(
            f"two predictions are called {twice}: give them names as in NAME=DIR, or set name in "
            f"their {DESCRIPTION}"
        )


def open_predictions(
    folders: Sequence[NamedFolder], case: str, views: Sequence[TargetView]
) -> list[Prediction]:
    """Opens the predictions for a case; none may lack a view, and their names must differ."""
    predictions = [Prediction.open(folder.path, case, folder.name) for folder in folders]
    for prediction in predictions:
        prediction.check(views)
    check_names([prediction.name for prediction in predictions])
    return predictions


def estimates_of(predictions: Sequence[Prediction], view: TargetView) -> dict[str, Estimate]:
    """Reads the depth map that each prediction has for a view, by name."""
    return {
        prediction.name: Estimate(*prediction.depth_m(view), confidence=prediction.confidence(view))
        for prediction in predictions
    }
