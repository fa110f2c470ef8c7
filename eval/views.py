"""What the report shows, as plain arrays: it knows no file layout, and no method by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from emvs.data.image_stores import Photo
from emvs.geometry.camera import Camera
from eval.figures.plots import DsiSlice
from eval.scoring.pairing import Truth
from eval.scoring.results import Results, Row

FloatImage = NDArray[np.floating]
CountImage = NDArray[np.integer]


@dataclass(frozen=True, slots=True)
class MethodView:
    """One method's map of one window.

    Attributes:
        name: as the paper names it, for example `Alg1/H`.
        depth_m: (H, W) z-depth, m.
        mask: (H, W) where there is one.
        confidence: (H, W) fused ray density at the maximum.
        piece: one row of the DSI; None where it was not kept.
    """

    name: str
    depth_m: FloatImage
    mask: NDArray[np.bool_]
    confidence: FloatImage
    piece: DsiSlice | None = None


@dataclass(frozen=True, slots=True)
class WindowView:
    """One window: what the cameras saw, and every method's map.

    Attributes:
        name: as in the result rows, for example `w000`.
        t_us: time of the reference view, µs.
        methods: the maps.
        depth_range_m: nearest and farthest plane, m.
        frame: (H, W) linear intensity, 0..255; None where there is none.
        photo: what an ordinary camera in the same place took; None where there is none.
        camera: the reference view's; None where the page needs no point cloud.
        brighter: (H, W) events of positive polarity per pixel; None where not counted.
        darker: (H, W) events of negative polarity per pixel; None where not counted.
        truth: ground truth; None for a recording without.
        events_caption: which stretch of time the counts cover.
        counts: per stage or camera, event statistics: numbers of events by outcome.
    """

    name: str
    t_us: int
    methods: tuple[MethodView, ...]
    depth_range_m: tuple[float, float]
    frame: NDArray[np.uint8] | None = None
    brighter: CountImage | None = None
    darker: CountImage | None = None
    truth: Truth | None = None
    events_caption: str = "per pixel, whole window"
    counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    photo: Photo | None = None
    camera: Camera | None = None


@dataclass(frozen=True, slots=True)
class CaseView:
    """One case: a sequence or recording, mapped.

    Attributes:
        name: as in the result rows.
        summary: what it shows, in a sentence.
        windows: those that the report shows.
        window_count: how many there are.
        facts: (name, value) pairs: rig, duration, renderer, and the like.
    """

    name: str
    summary: str
    windows: tuple[WindowView, ...]
    window_count: int
    facts: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ReportData:
    """Everything in a report.

    Attributes:
        cases: the cases.
        results: the scores and where they came from; without rows where nothing was scored.
        ranking_metric: the metric that orders the methods.
        configuration: the run's configuration, as text.
    """

    cases: tuple[CaseView, ...]
    results: Results
    ranking_metric: str = "mean_error"
    configuration: str = ""

    def rows_of(self, case: str, window: str) -> tuple[Row, ...]:
        """The rows of one case and window."""
        rows = self.results.rows
        return tuple(row for row in rows if row.case == case and row.window == window)
