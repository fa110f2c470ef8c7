"""Pictures of a suite's cases: what the camera saw, our best method's depth, that of others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from emvs.config import MapperConfig
from emvs.data.sequence import Sequence as EventSequence
from emvs.utils.cache import Cache
from emvs.utils.outputs import atomic_dir, check_files
from emvs.utils.ownership import mark, remove_ours
from eval.config import EvalConfig
from eval.jobs.job import SEQUENCE, Job, stored
from eval.report.overview import overview_png
from eval.report.ranking import ranked_methods
from eval.report.run_data import CaseData, MethodData, window_data
from eval.scoring.predictions import FAMILY, NamedFolder, Prediction, TargetView
from eval.scoring.results import POOLED
from eval.suite.archive import SequenceArchive
from eval.suite.definition import Suite
from eval.suite.output import PICTURES_FOLDER
from eval.suite.predictions import assignment, open_predictions
from eval.suite.results import Sample, SuiteResult
from eval.suite.run import suite_jobs
from eval.suite.stages.predict import opened
from eval.suite.stages.score import mapped_window

_COLUMNS = 4


def write_pictures(
    folder: Path,
    suite: Suite,
    result: SuiteResult,
    predictions: Sequence[NamedFolder],
    cache: Path,
    archive: SequenceArchive | None = None,
) -> None:
    """Writes `pictures/CASE.png`: the first window of each case's first seed.

    Cases that failed, and those that the cache here does not hold, have none.

    Args:
        folder: that holds the result.
        suite: the definition.
        result: what was scored.
        predictions: the folders that were scored beside the suite's methods.
        cache: folder of the jobs' cache.
        archive: where the sequences were.

    Raises:
        InputError: a prediction that was changed since, or no room on the disk.
    """
    place = folder / PICTURES_FOLDER
    check_files(folder, (PICTURES_FOLDER,), force=True)
    pictures = dict(_pictures(suite, result, predictions, Cache(cache), archive))
    if not pictures:
        if place.is_dir():
            remove_ours(place)
        return
    with atomic_dir(place, force=True, inputs=[one.path for one in predictions]) as made:
        for case, picture in pictures.items():
            (made / f"{case}.png").write_bytes(picture)
        mark(made)


def _pictures(
    suite: Suite,
    result: SuiteResult,
    predictions: Sequence[NamedFolder],
    cache: Cache,
    archive: SequenceArchive | None,
) -> Iterator[tuple[str, bytes]]:
    first: dict[str, Sample] = {}
    for sample in result.samples:
        first.setdefault(sample.case, sample)
    for case, sample in first.items():
        (score,) = suite_jobs(suite, [case], [sample.seed], archive)
        found = _case(suite, score, sample, cache)
        if found is not None:
            theirs = _others(suite, score, predictions)
            scored = {row.method for row in sample.rows}
            yield case, _drawn(suite, found, [one for one in theirs if one.name in scored], sample)


def _case(suite: Suite, score: Job, sample: Sample, cache: Cache) -> CaseData | None:
    sequence, mapped = stored(score.needs[0], cache), stored(score.needs[1], cache)
    if sequence is None or mapped is None:
        return None
    window = mapped_window(mapped.path)
    data = window_data(
        window,
        [window.depth_map(method) for method in window.info.methods],
        EventSequence.open(sequence.path / SEQUENCE),
        EvalConfig.model_validate(suite.score),
        scorable=MapperConfig.model_validate(score.needs[1].parameters["map"]).is_camera_0_view,
    )
    return CaseData(sample.case, "", (data,), len(suite.cases[sample.case].windows))


def _others(suite: Suite, score: Job, predictions: Sequence[NamedFolder]) -> list[MethodData]:
    """The depth maps of others for the first window."""
    asked = assignment(suite, score.parameters["case"], score.parameters["seed"])
    found = open_predictions(predictions, suite, [asked])
    return [_method(opened(one.job(score).parameters, one.folder), asked.views[0]) for one in found]


def _method(prediction: Prediction, view: TargetView) -> MethodData:
    depth_m, mask = prediction.depth_m(view)
    return MethodData(prediction.name, depth_m, mask, np.full(mask.shape, np.nan))


def _drawn(suite: Suite, case: CaseData, theirs: Sequence[MethodData], sample: Sample) -> bytes:
    (window,) = case.windows
    everything = replace(case, windows=(replace(window, methods=(*window.methods, *theirs)),))
    metric = EvalConfig.model_validate(suite.score).ranking_metric
    rows = [row for row in sample.rows if row.window == POOLED]
    ours = [name for name in ranked_methods(rows, metric) if not name.startswith(FAMILY)]
    title = f"{case.name}, seed {sample.seed}, {window.name}"
    return overview_png(everything, title, ours, most_others=len(theirs), columns=_COLUMNS)
