"""Every metric of a geometry against true surfaces: names, units, directions and formulas.

a is the distance of a point of the geometry from the nearest true surface, c that of a true point
from the nearest point of the geometry. What computes them is a plug-in, see `plugins.geometry`.
"""

from __future__ import annotations

from collections.abc import Iterator

from eventsweep.eval.scoring.metrics import Quantity

WITHIN_CM, WITHIN_PERCENT = (1, 2, 5, 10), (1, 2, 5)
"""Distances up to which a point is right: in cm, and as a share of its depth, %."""
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
