"""How wrong a depth may be: what a method's reliability was worth where the truth is known.

Every method has a score of its own for each pixel: how far votes stand out, how well cameras and
neighbours agree, what error a network expects. Calibration windows, of motions that nothing was
trained or scored on, say which errors such a score came with. `precision.json` holds these tables;
`python tests/benchmarks calibrate_confidence` makes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap, without_border
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError, refused
from eventsweep.emvs.utils.inputs import parse_json

Float32s = NDArray[np.float32]
BAND = 0.68
"""Share of errors that the stated error holds."""
TELLING = 0.9
"""Precision that a score must be able to choose, or it says too little to state errors by it."""
WITHIN_PX = 1.0
"""What precision counts as right: so many pixels of disparity, at most."""
PRECISION = Path(str(files("eventsweep.emvs.depth"))) / "precision.json"
"""The tables that ship."""
LEAST_SCATTER_PX = 0.01
"""Added to the scatter around a surface, which may happen to be 0."""
_LISTS = "score", "error_px", "precision"


@dataclass(frozen=True, eq=False)
class Precision:
    """What a score was worth on the calibration windows.

    Attributes:
        score: (K,) rising.
        error_px: (K,) half-width of the band that holds `BAND` of the errors at that score, px of
            disparity; never rises. With `by_scatter`, as multiples of the scatter of depths around
            their fitted surface (`scatter_scale`): errors follow it in scenes of all kinds.
        precision: (K,) share of all points of this score or more that are within `WITHIN_PX`; never
            falls.
        most_step_px: largest distance of two planes in the calibration windows, px of disparity.
        by_scatter: whether `error_px` is in multiples of the scatter.
    """

    score: NDArray[np.float64]
    error_px: NDArray[np.float64]
    precision: NDArray[np.float64]
    most_step_px: float
    by_scatter: bool = False

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Precision:
        """Takes the lists of a table, and how far apart planes were.

        Raises:
            InputError: no such table.
        """
        faults = KeyError, TypeError, ValueError
        with refused("invalid precision table", *faults, cure="; calibrate again"):
            lists = [np.array(table[name], np.float64) for name in _LISTS]
            most_step_px = float(table["most_step_px"])
        known = all(column.ndim == 1 and column.shape == lists[0].shape for column in lists)
        if not known or not lists[0].size or not all(np.isfinite(column).all() for column in lists):
            raise InputError("invalid precision table: needs three finite lists of the same length")
        if not 0 < most_step_px < np.inf:
            raise InputError(
                f"invalid precision table: most_step_px is {most_step_px:g}, needs a finite "
                "number above 0"
            )
        score, error_px, precision = lists
        return cls(score, error_px, precision, most_step_px, table.get("by_scatter") is True)

    def to_json(self) -> dict[str, list[float] | float | bool]:
        """Plain numbers."""
        lists = {name: [float(f"{value:.5g}") for value in getattr(self, name)] for name in _LISTS}
        step_px = float(f"{self.most_step_px:.5g}")
        return {**lists, "most_step_px": step_px, "by_scatter": self.by_scatter}

    def states_errors(self, step_px: float) -> bool:
        """Whether it says how wrong a point is, where planes are `step_px` of disparity apart.

        Not for a score that hardly tells right from wrong, nor where planes lie farther apart than
        in any calibration window.
        """
        return float(self.precision[-1]) >= TELLING and step_px <= self.most_step_px

    def error_at(self, score: Float32s, scatter_px: Float32s | None = None) -> Float32s:
        """Half-width of the error's band at some scores, px of disparity.

        With `by_scatter`, `scatter_px` is that of the same points.
        """
        error = np.interp(score, self.score, self.error_px).astype(np.float32)
        if not self.by_scatter:
            return error
        if scatter_px is None:
            raise ValueError("errors are in multiples of the scatter: needs scatter_px")
        return np.asarray(error * scatter_scale(scatter_px), np.float32)

    def least_score(self, wanted: float, method: str) -> float:
        """The least score at which so large a share of the points was within a pixel.

        Raises:
            InputError: no score had that; says what can be had.
        """
        enough = np.flatnonzero(self.precision >= wanted)
        if not enough.size:
            raise InputError(
                f"min_precision {wanted:g}: {method} reached at most {self.precision[-1]:.3f} on "
                "the calibration windows; ask for less"
            )
        return float(self.score[enough[0]])


def scatter_scale(scatter_px: NDArray[np.floating]) -> NDArray[np.floating]:
    """What errors are multiples of, px: the scatter around the surface, and a little."""
    return np.asarray(scatter_px + np.float32(LEAST_SCATTER_PX))


@cache
def tables() -> Mapping[str, Precision]:
    """The tables that ship with the package, by method."""
    text = PRECISION.read_text(encoding="utf-8")
    return {name: Precision.from_json(table) for name, table in parse_json(text)["methods"].items()}


def table_name(method: str) -> str:
    """Under which name a method's table stands: all single cameras share one."""
    name = MethodName.of(method)
    return f"{name.family}/cam" if name.camera is not None else method


def check_precision(wanted: float | None, methods: Sequence[str], more: Iterable[str]) -> None:
    """Refuses a wanted precision before any work where a method's reliability is not calibrated.

    `more` names tables that do not ship in `precision.json`, such as those of weights.

    Raises:
        InputError: names the method and those that have it.
    """
    known = (*tables(), *more)
    for method in methods if wanted is not None else ():
        if table_name(method) not in known:
            raise InputError(
                f"min_precision: {method} has no calibrated reliability; choose from "
                f"{', '.join(known)}, or leave it out"
            )


def stated(
    depth_map: DepthMap,
    per_rho_px: float | None,
    config: MapperConfig,
    table: Precision | None = None,
) -> DepthMap:
    """The depth map with the error of each pixel, and the pixels that a wanted precision leaves.

    No error is stated where the table cannot say it (`Precision.states_errors`), or needs a scatter
    and no surface was fitted: `error_m` is None.

    Args:
        depth_map: as its method made it, with its reliability.
        per_rho_px: disparity per inverse depth, px m; None where the rig has no parallax.
        config: `min_precision`, border.
        table: what the reliability is worth; by default the one that ships, if there is one.

    Raises:
        InputError: a wanted precision that the method cannot have.
    """
    table = tables().get(table_name(depth_map.method)) if table is None else table
    score = depth_map.reliability
    if table is None or per_rho_px is None or score is None:
        if config.min_precision is not None:
            raise InputError(
                f"min_precision: {depth_map.method} has no calibrated reliability here, or the "
                "rig has no parallax; leave it out"
            )
        return depth_map
    fitted = depth_map.scatter_px is not None or not table.by_scatter
    if fitted and table.states_errors(step_of_planes_px(depth_map, per_rho_px)):
        error_px = table.error_at(score, depth_map.scatter_px)
        error_m = error_px * depth_map.depth_m**2 / np.float32(per_rho_px)
        depth_map = replace(depth_map, error_m=error_m)
    if config.min_precision is None:
        return depth_map
    least = table.least_score(config.min_precision, depth_map.method)
    kept = without_border((score >= least) & (score > 0), config.border_px)
    return replace(depth_map, mask=kept)


def step_of_planes_px(depth_map: DepthMap, per_rho_px: float) -> float:
    """The largest distance of two neighbouring planes, px of disparity."""
    return float(per_rho_px * np.abs(np.diff(depth_map.rho.astype(np.float64))).max())
