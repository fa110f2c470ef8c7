"""Pictures of a suite's cases: what the camera saw, our best method's depth, that of others."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from PIL import Image

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.outputs import atomic_dir, check_files, discard
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.figures.colormaps import depth_scale, error_scale
from eventsweep.eval.figures.images import depth_image, error_cap_cm
from eventsweep.eval.jobs.job import SEQUENCE, Job, stored
from eventsweep.eval.report.overview import overview_png
from eventsweep.eval.report.ranking import ranked_methods
from eventsweep.eval.report.run_data import CaseData, MethodData, WindowData, window_data
from eventsweep.eval.results.results import (
    PICTURES_FOLDER,
    Results,
    Sample,
    mapper_method,
    shown_name,
)
from eventsweep.eval.results.table import POOLED, each
from eventsweep.eval.scoring.predictions import FAMILY, NamedFolder, Prediction, TargetView, plain
from eventsweep.eval.scoring.run_folder import mapped_window
from eventsweep.eval.stages.predict import opened
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.eval.suite.predictions import assignment, open_predictions
from eventsweep.eval.suite.source import SequenceSource

METHODS_NAME = "methods.json"
"""Which case each method's pictures show."""
_COLUMNS = 4
_PANEL_PX, _GAP_PX, _QUALITY = 346, 4, 60


def write_pictures(
    folder: Path, suite: Suite, result: Results, predictions: Sequence[NamedFolder],
    cache: Path, archive: SequenceSource | None = None,
) -> None:  # fmt: skip
    """Writes `pictures/CASE.png`, and of each method its best and worst case for a ranking.

    All are of the first window of each case's first seed. Cases that failed, and those that the
    cache here does not hold, have none.
    """
    place = folder / PICTURES_FOLDER
    check_files(folder, (PICTURES_FOLDER,), force=True)
    views = CaseViews(suite, predictions, Cache(cache), archive)
    pictures = {f"{case}.png": png for case, png in _pictures(views, result)}
    pictures |= method_pictures(views, result)
    if not pictures:
        discard(place)
        return
    inputs = [prediction.path for prediction in predictions]
    with atomic_dir(place, force=True, inputs=inputs, part_of=folder) as made:
        for name, picture in pictures.items():
            (made / name).write_bytes(picture)


@dataclass(frozen=True)
class CaseViews:
    """Where depth maps of a suite's cases are found: those of its own jobs, and predictions."""

    suite: Suite
    predictions: Sequence[NamedFolder]
    cache: Cache
    archive: SequenceSource | None

    def score_job(self, sample: Sample) -> Job:
        """The job that made a sample."""
        assert sample.seed is not None  # a suite's sequences are simulated
        return suite_jobs(self.suite, [sample.case], [sample.seed], self.archive)[0]

    def first_window(self, score: Job, at: int = 0) -> WindowData | None:
        """The first window of a sequence, mapped by a mapper's first job; None if it is gone."""
        sequence, mapped = (stored(score.needs[k], self.cache) for k in (0, 1 + at))
        if sequence is None or mapped is None:
            return None
        window, settings = mapped_window(mapped.path), score.needs[1 + at].parameters["map"]
        return window_data(
            window,
            [window.depth_map(method) for method in window.info.methods],
            EventSequence.open(sequence.path / SEQUENCE),
            EvalConfig.model_validate(self.suite.score),
            scorable=MapperConfig.model_validate(settings).is_camera_0_view,
        )

    def others(self, score: Job) -> list[MethodData]:
        """The depth maps of others for the first window."""
        asked = assignment(self.suite, score.parameters["case"], score.parameters["seed"])
        found = open_predictions(self.predictions, self.suite, [asked])
        jobs = ((one.job(score).parameters, one.folder) for one in found)
        return [_method(opened(*job), asked.views[0]) for job in jobs]

    def by_method(self, score: Job) -> tuple[WindowData | None, dict[str, MethodData]]:
        """The first window, and every method's map of it by the name of its rows."""
        first: WindowData | None = None
        found: dict[str, MethodData] = {}
        mappers = list(score.parameters["mappers"])
        for mapper in dict.fromkeys(mappers):
            window = self.first_window(score, mappers.index(mapper))
            if window is not None and window.truth is not None:
                first = first or window
                found |= {mapper_method(m.name, mapper): m for m in window.methods}
        found |= {other.name: other for other in self.others(score)}
        return first, found


def _firsts(result: Results) -> dict[str, Sample]:
    first: dict[str, Sample] = {}
    for sample in result.samples:
        first.setdefault(sample.case, sample)
    return first


def _pictures(views: CaseViews, result: Results) -> Iterator[tuple[str, bytes]]:
    for case, sample in _firsts(result).items():
        score = views.score_job(sample)
        window = views.first_window(score)
        if window is not None:
            rows = _pooled(result, sample)
            scored = set(rows["method"])
            theirs = [other for other in views.others(score) if other.name in scored]
            data = CaseData(case, "", (window,), len(views.suite.cases[case].windows))
            yield case, _drawn(views.suite, data, theirs, sample, rows)


def _method(prediction: Prediction, view: TargetView) -> MethodData:
    depth_m, mask = prediction.depth_m(view)
    return MethodData(prediction.name, depth_m, mask, np.full(mask.shape, np.nan))


def method_pictures(views: CaseViews, result: Results) -> dict[str, bytes]:
    """Of each method its best and worst case: depth, true depth and error, and an index of them.

    Best and worst are those of the least and largest mean relative error; cases whose view is not
    camera 0's have no true depth here.
    """
    firsts = _firsts(result)
    errors: dict[str, dict[str, float]] = {}
    for case, sample in firsts.items():
        rows = _pooled(result, sample)
        for row in each(rows[(rows["metric"] == "abs_rel") & np.isfinite(rows["value"])]):
            errors.setdefault(row.method, {})[case] = row.value
    wanted: dict[str, list[tuple[str, str]]] = {}
    for method, error in errors.items():
        wanted.setdefault(min(error, key=error.__getitem__), []).append((method, "best"))
        wanted.setdefault(max(error, key=error.__getitem__), []).append((method, "worst"))
    pictures: dict[str, bytes] = {}
    index: dict[str, dict[str, Any]] = {}
    for case, shown in wanted.items():
        window, maps = views.by_method(views.score_job(firsts[case]))
        for method, which in shown:
            if window is not None and method in maps:
                file = f"{plain(method)}-{which}.webp"
                pictures[file], cap_cm = _strip(window, maps[method])
                numbers = {"abs_rel": errors[method][case], "error_cm": cap_cm}
                about = {"file": file, "case": case, **numbers}
                index.setdefault(shown_name(method, views.suite.mappers), {})[which] = about
    if index:
        pictures[METHODS_NAME] = json.dumps(index, ensure_ascii=False, indent=1).encode()
    return pictures


def _strip(window: WindowData, method: MethodData) -> tuple[bytes, float]:
    """Depth, true depth and error side by side, as a WebP file; and where errors end, cm."""
    assert window.truth is not None  # asked for where it is drawn
    truth, scale = window.truth, depth_scale(window.shown_range_m)
    cap_cm = error_cap_cm(method.errors_cm(truth))
    panels = (
        method.depth_image(scale),
        depth_image(truth.depth_m, truth.scored, scale),
        method.error_image(truth, error_scale(cap_cm)),
    )
    height = round(_PANEL_PX * truth.depth_m.shape[0] / truth.depth_m.shape[1])
    strip = Image.new("RGB", (3 * _PANEL_PX + 2 * _GAP_PX, height), "white")
    for k, panel in enumerate(panels):
        image = Image.fromarray(panel.rgba()).resize((_PANEL_PX, height), Image.Resampling.BOX)
        strip.paste(image, (k * (_PANEL_PX + _GAP_PX), 0), image)
    stream = io.BytesIO()
    strip.save(stream, format="WebP", quality=_QUALITY, method=6)
    return stream.getvalue(), cap_cm


def _pooled(result: Results, sample: Sample) -> pd.DataFrame:
    rows = result.rows[result.rows["window"] == POOLED]
    return rows[(rows["case"] == sample.case) & (rows["seed"] == sample.seed)]


def _drawn(
    suite: Suite, case: CaseData, theirs: Sequence[MethodData], sample: Sample, rows: pd.DataFrame
) -> bytes:
    (window,) = case.windows
    everything = replace(case, windows=(replace(window, methods=(*window.methods, *theirs)),))
    metric = EvalConfig.model_validate(suite.score).ranking_metric
    ours = [name for name in ranked_methods(rows, metric) if not name.startswith(FAMILY)]
    title = f"{case.name}, seed {sample.seed}, {window.name}"
    return overview_png(everything, title, ours, most_others=len(theirs), columns=_COLUMNS)
