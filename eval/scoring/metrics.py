"""Every metric: its name, unit, direction and formula, and the few lines that compute it.

e is the estimate and g the ground truth, over the pixels where both are valid. The definitions
follow Ghosh & Gallego (Adv. Intell. Syst. 2022) and the tables published since; where the field
uses a different one by the same name, both are here under names of their own. The page
`scores` discusses each. Of geometries the names are here, and a plug-in computes the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from eventsweep.eval.results.direction import Direction

Pooling = Literal["sum", "pairs", "squares", "truth", "either", "variance", "order"]
FloatArray = NDArray[np.float64]
NAN = float("nan")
OUTLIER_RELATIVE_ERROR = 0.10
PUBLISHED_BAD_PX = 5.0
PUBLISHED_BAD_RELATIVE = 0.05
CELL_THRESHOLDS: tuple[int, ...] = (1, 2, 5)
PRIMARY = ("mean_error", "median_error", "bad_published", "points")
"""Metrics that decide which map is better: how wrong depths are, how often bad, how many."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Estimates and ground truth at the pixels where both are valid.

    Attributes:
        estimate_m: (N,) estimated depth, m.
        truth_m: (N,) true depth, m.
        truth_count: number of pixels with valid ground truth, N or more.
        baseline_focal_px_m: baseline times focal length, px·m; NaN for a rig of one camera.
        signed_cells: (N,) depth cells from truth to estimate, positive where that is nearer; None
            where no planes are known.
        confidence: (N,) confidence of the estimates, larger is surer; None where there is none.
    """

    estimate_m: FloatArray
    truth_m: FloatArray
    truth_count: int
    baseline_focal_px_m: float
    signed_cells: FloatArray | None = None
    confidence: FloatArray | None = None

    @property
    def count(self) -> int:
        """The number of pairs."""
        return len(self.estimate_m)

    @property
    def signed_error_m(self) -> FloatArray:
        """E - g, m: positive where the estimate is too far."""
        return self.estimate_m - self.truth_m

    @property
    def error_m(self) -> FloatArray:
        """|e - g|, m."""
        return np.abs(self.signed_error_m)

    @property
    def cells(self) -> FloatArray | None:
        """Depth cells between e and g; None where no planes are known."""
        return None if self.signed_cells is None else np.abs(self.signed_cells)

    @property
    def log_ratio(self) -> FloatArray:
        """Ln g - ln e."""
        return np.log(self.truth_m) - np.log(self.estimate_m)

    @property
    def signed_disparity_px(self) -> FloatArray:
        """(1/e - 1/g) b f, px: positive where the estimate is too near."""
        return (1 / self.estimate_m - 1 / self.truth_m) * self.baseline_focal_px_m

    @property
    def disparity_error_px(self) -> FloatArray:
        """|1/e - 1/g| b f, px."""
        return np.abs(self.signed_disparity_px)


@dataclass(frozen=True, slots=True, repr=False)
class Quantity:
    """What a reader must know of a number to compare it.

    Attributes:
        name: key in result files.
        title: heading in tables.
        unit: unit of the value; empty for a plain ratio.
        direction: which end is better.
        formula: in words and signs.
    """

    name: str
    title: str
    unit: str
    direction: Direction
    formula: str

    def __repr__(self) -> str:
        unit = f" [{self.unit}]" if self.unit else ""
        about = f"{self.name!r}{unit}, better: {self.direction}; {self.formula}"
        return f"{type(self).__name__}({about})"


@dataclass(frozen=True, slots=True, repr=False)
class Metric(Quantity):
    """One number about a depth map.

    Attributes:
        compute: makes it of the pairs.
        needs_pairs: NaN, rather than computed, where the method reports no depth at all.
        pooling: what the value of several windows' pixels together is made of, see
            `eval.scoring.pooling`: the windows' values, added (`sum`) or averaged by their number
            of pairs (`pairs`; of squares, `squares`), of true pixels (`truth`) or of both
            (`either`); the pairs' mean logarithmic ratio, too (`variance`); or all pairs in order
            (`order`).
    """

    compute: Callable[[Pairs], SupportsFloat]
    needs_pairs: bool = True
    pooling: Pooling = "pairs"

    def __call__(self, pairs: Pairs) -> float:
        """The metric's value; NaN where it is undefined."""
        undefined = self.needs_pairs and not pairs.count
        return NAN if undefined else float(self.compute(pairs))


def _delta(pairs: Pairs, power: int) -> float:
    ratio = np.maximum(pairs.estimate_m / pairs.truth_m, pairs.truth_m / pairs.estimate_m)
    return 100 * float(np.mean(ratio < 1.25**power))


def _bad(pairs: Pairs, threshold_px: float) -> float:
    if np.isnan(pairs.baseline_focal_px_m):
        return NAN
    return 100 * float(np.mean(pairs.disparity_error_px > threshold_px))


def _bad_published(pairs: Pairs) -> float:
    if np.isnan(pairs.baseline_focal_px_m):
        return NAN
    far_off = pairs.disparity_error_px > PUBLISHED_BAD_PX
    relative = pairs.error_m / pairs.estimate_m > PUBLISHED_BAD_RELATIVE
    return 100 * float(np.mean(far_off & relative))


def _delta_metric(power: int) -> Metric:
    title = "δ < 1.25" + ("", "²", "³")[power - 1]
    formula = f"share with max(e/g, g/e) < 1.25^{power}"
    return Metric(f"delta_{power}", title, "%", "higher", formula, partial(_delta, power=power))


def _bad_metric(threshold_px: int) -> Metric:
    formula = f"share with |1/e - 1/g| b f > {threshold_px} px"
    compute = partial(_bad, threshold_px=threshold_px)
    return Metric(f"bad_{threshold_px}px", f"bad {threshold_px} px", "%", "lower", formula, compute)


# fmt: off
METRICS: tuple[Metric, ...] = (
    Metric("points", "points", "px", "higher", "number of pixels with e and g",
           lambda p: p.count, needs_pairs=False, pooling="sum"),
    Metric("completeness", "completeness, any error", "%", "higher",
           "points / #g, whatever their error",
           lambda p: 100 * p.count / p.truth_count if p.truth_count else NAN,
           needs_pairs=False, pooling="truth"),
    Metric("mean_error", "mean error", "m", "lower", "mean |e - g|", lambda p: np.mean(p.error_m)),
    Metric("median_error", "median error", "m", "lower", "median |e - g|",
           lambda p: np.median(p.error_m), pooling="order"),
    Metric("rmse", "RMSE", "m", "lower", "sqrt(mean (e - g)²)",
           lambda p: np.sqrt(np.mean(p.error_m**2)), pooling="squares"),
    Metric("abs_rel", "AbsRel", "%", "lower", "mean |e - g| / g",
           lambda p: 100 * np.mean(p.error_m / p.truth_m)),
    Metric("aerr_r", "AErrR", "%", "lower", "mean |e - g| / e (as published)",
           lambda p: 100 * np.mean(p.error_m / p.estimate_m)),
    # The variance is mean(d²) - mean(d)² without the cancellation.
    Metric("silog", "SILog", "x100", "lower", "mean d² - (mean d)², d = ln g - ln e",
           lambda p: 100 * np.var(p.log_ratio), pooling="variance"),
    Metric("log_rmse", "log RMSE", "x100", "lower", "sqrt(mean d²), d = ln g - ln e",
           lambda p: 100 * np.sqrt(np.mean(p.log_ratio**2)), pooling="squares"),
    *(_delta_metric(power) for power in (1, 2, 3)),
    *(_bad_metric(threshold_px) for threshold_px in (1, 2, 3, 5)),
    Metric("bad_published", "bad pixels", "%", "lower",
           "share with |1/e - 1/g| b f > 5 px and |e - g| / e > 0.05 (as published)",
           _bad_published),
    Metric("outlier_share", "outliers", "%", "lower", "share with |e - g| / g > 0.10",
           lambda p: 100 * np.mean(p.error_m / p.truth_m > OUTLIER_RELATIVE_ERROR)),
    # Medians: of a mean, a few outliers would decide the sign.
    Metric("bias", "bias", "m", "none", "median of e - g; above 0 is too far",
           lambda p: np.median(p.signed_error_m), pooling="order"),
    Metric("bias_px", "bias, disparity", "px", "none",
           "median of (1/e - 1/g) b f; above 0 is too near",
           lambda p: np.median(p.signed_disparity_px), pooling="order"),
)

# fmt: on


def cell_offset(
    estimate_m: FloatArray, truth_m: FloatArray, rho: NDArray[np.floating]
) -> FloatArray:
    """Counts the planes from truth to estimate, in whole and parts of a cell: (N,) depth cells.

    Positive where the estimate is nearer. Between two planes, position is linear in inverse depth;
    beyond the outermost ones it goes on with the step of the outermost cell. `rho` holds 2 or more
    inverse depths in either order, 1/m.
    """
    planes = np.sort(rho.astype(np.float64))
    return _position(1 / estimate_m, planes) - _position(1 / truth_m, planes)


def _position(rho: FloatArray, planes: FloatArray) -> FloatArray:
    cell = np.clip(np.searchsorted(planes, rho, side="right") - 1, 0, len(planes) - 2)
    position: FloatArray = cell + (rho - planes[cell]) / (planes[cell + 1] - planes[cell])
    return position


def _beyond(pairs: Pairs, cells: int) -> float:
    return NAN if pairs.cells is None else 100 * float(np.mean(pairs.cells > cells))


def _bad_cells_metric(cells: int) -> Metric:
    name, title = f"bad_{cells}cell", f"bad {cells} cells"
    formula = f"share with more than {cells} depth cells between e and g"
    return Metric(name, title, "%", "lower", formula, partial(_beyond, cells=cells))


CELL_METRICS: tuple[Metric, ...] = (
    Metric("mean_cells", "mean cells", "cells", "lower", "mean depth cells between",
           lambda p: NAN if p.cells is None else np.mean(p.cells)),
    Metric("median_cells", "median cells", "cells", "lower", "median depth cells between",
           lambda p: NAN if p.cells is None else np.median(p.cells), pooling="order"),
    *(_bad_cells_metric(cells) for cells in CELL_THRESHOLDS),
    Metric("bias_cells", "bias, cells", "cells", "none",
           "median of depth cells from g to e; above 0 is too near",
           lambda p: NAN if p.signed_cells is None else np.median(p.signed_cells),
           pooling="order"),
)  # fmt: skip

WITHIN_CM, WITHIN_PERCENT = (1, 2, 5, 10), (1, 2, 5)
"""Distances up to which a geometry's point is right: in cm, and as a share of its depth, %."""
PRIMARY_OF_GEOMETRIES = ("accuracy", "completion", "surface_f1_5cm")
"""Metrics that decide which geometry is better: how wrong, how much is missing, both."""
SURFACES: dict[str, str] = {
    "plane": "locally plane surfaces",
    "curved": "curved surfaces and creases",
    "edge": "surfaces beside a depth discontinuity",
    "thin": "thin things, few pixels wide and far before what is behind them",
    "far": "surfaces beyond the stated distance",
    "once": "surfaces that one view saw",
    "few": "surfaces that 2 to 9 views saw",
    "many": "surfaces that 10 views or more saw",
}
"""Regions of true surfaces: by class, then by the number of views that saw them."""


def _within() -> Iterator[Quantity]:
    limits = [(f"{cm}cm", f"{cm} cm") for cm in WITHIN_CM]
    limits += [(f"{percent}pct", f"{percent} % of the depth") for percent in WITHIN_PERCENT]
    for name, limit in limits:
        for kind, formula in (
            ("precision", f"share of the geometry's points with a < {limit}"),
            ("recall", f"share of the true points with c < {limit}"),
            ("f1", f"2 P R / (P + R) of surface precision and recall within {limit}"),
        ):
            title = f"surface {'F1' if kind == 'f1' else kind} {limit}"
            yield Quantity(f"surface_{kind}_{name}", title, "%", "higher", formula)


GEOMETRY_METRICS: dict[str, Quantity] = {
    one.name: one
    for one in (
        Quantity("accuracy", "accuracy", "m", "lower", "mean a"),
        Quantity("accuracy_median", "accuracy, median", "m", "lower", "median a"),
        Quantity("completion", "completion", "m", "lower", "mean c"),
        Quantity("completion_median", "completion, median", "m", "lower", "median c"),
        Quantity("chamfer", "Chamfer distance", "m", "lower", "(mean a + mean c) / 2"),
        *_within(),
    )
}
"""Metrics of a geometry: a is the distance of one of its points from the nearest true surface, c
that of a true point from its nearest point."""
