"""The tracks of a ranking: what is judged in each, by which metric, and which numbers are kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

SEMI_DENSE = "semi-dense"
"""The track of a suite's results: depth where a method reports some."""


@dataclass(frozen=True)
class Track:
    """One contest.

    Attributes:
        title: as a page shows it.
        ranked_by: the metric by which methods are placed.
        shown: metrics beside it.
        about: what is judged, for a reader of the page.
    """

    title: str
    ranked_by: str
    shown: tuple[str, ...]
    about: str

    @property
    def metrics(self) -> tuple[str, ...]:
        """What an entry keeps."""
        return (self.ranked_by, *self.shown)


OTHERS = {
    "dense": Track(
        "Dense depth", "recall_5pct", ("completeness", "abs_rel", "delta_1", "median_error"),
        "Every true pixel counts: one without depth is as wrong as one that is off by more than "
        "5 % of its depth. Other errors are of the pixels that have depth.",
    ),
    "geometry": Track(
        "Geometry of a whole sequence", "surface_f1_5cm",
        ("accuracy", "completion", "surface_precision_5cm", "surface_recall_5cm"),
        "Clouds, meshes and centres of splats in the world, against every surface that the "
        "cameras saw.",
    ),
    "odometry": Track(
        "Odometry", "ate_share", ("ate_rmse", "ate_rotation_rmse", "drift", "time_covered"),
        "Poses found from events, aligned rigidly with the true ones; errors are of the time "
        "covered.",
    ),
}  # fmt: skip
"""The tracks beside it, by the name that entries give."""


def found_in(metrics: Iterable[str]) -> list[str]:
    """The tracks that a table of these metrics can enter."""
    there = set(metrics)
    return [name for name, track in OTHERS.items() if track.ranked_by in there]
