"""Depth maps of others in a suite: what must be predicted, and whether a folder holds all of it.

Neither needs ground truth, nor a sequence: a suite's definition says both.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.eval.jobs.job import Job
from eventsweep.eval.results.results import DEFAULT_MAPPER
from eventsweep.eval.results.table import POOLED, each
from eventsweep.eval.scoring.predictions import (
    NamedFolder,
    Prediction,
    PredictionFacts,
    TargetView,
    check_names,
    described,
    method_name,
    timed_files,
)
from eventsweep.eval.stages import beside, predict
from eventsweep.eval.suite.definition import CaseSpec, Suite
from eventsweep.eval.suite.given import given, is_given
from eventsweep.sim.config import SimConfig
from eventsweep.sim.mjcf import is_model_file
from eventsweep.sim.rigs import rig as named_rig

if TYPE_CHECKING:
    import pandas as pd

PERFECT_PERCENT = 0.05
"""A mean relative error below this is not an estimate's."""
BESIDE = "beside"
"""What the jobs that compare all methods of a sequence are called."""
LISTING = "eventsweep suite SUITE --list-cases"
ViewId = tuple[str, int, int]
_SEED = re.compile(r"seed(\d+)")


@dataclass(frozen=True)
class Assignment:
    """What is to be predicted for one case and seed: a depth map for each window.

    Attributes:
        windows: their names, and times of begin (included), end (excluded) and reference view, µs.
        camera: the reference view: camera 0 without lens distortion, at the reference time.
        baseline_m: distance of the rig's first two cameras; None for a rig of one.
        depth_range_m: nearest and farthest z-depth that the cameras see.
        imperfection: errors in what a method is given, as amounts; None where all is exact.
    """

    case: str
    seed: int
    windows: Mapping[str, tuple[int, int, int]]
    camera: Camera
    baseline_m: float | None
    depth_range_m: tuple[float, float]
    imperfection: Mapping[str, float] | None = None

    @property
    def place(self) -> str:
        """Where a prediction has its files for it."""
        return f"{self.case}/seed{self.seed}"

    @property
    def views(self) -> list[TargetView]:
        """Reference views, in the order of the windows."""
        return [
            TargetView(
                t_ref_us, self.camera.width_px, self.camera.height_px, self.camera.fx_px,
                self.baseline_m, self.depth_range_m,
            )
            for _, _, t_ref_us in self.windows.values()
        ]  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Plain values: where each file belongs, and what it is of."""
        return {
            "case": self.case,
            "seed": self.seed,
            "camera": self.camera.to_json(),
            "baseline_m": self.baseline_m,
            "depth_range_m": list(self.depth_range_m),
            "imperfection": self.imperfection,
            "windows": [
                {
                    "window": name,
                    "t0_us": t0_us,
                    "t1_us": t1_us,
                    "t_ref_us": t_ref_us,
                    "file": f"{self.place}/{t_ref_us}.npz",
                }
                for name, (t0_us, t1_us, t_ref_us) in self.windows.items()
            ],
        }


def assignment(suite: Suite, case: str, seed: int) -> Assignment:
    """What a sequence is to be predicted for: the windows of the case's first mapper."""
    spec = suite.cases[case]
    mapper, rig, depth_range_m = suite.mappers[spec.mappers[0]], *_seen(suite, spec, seed)
    first_us = given(spec.scene).event_span_us(0)[0] if is_given(spec.scene) else 0
    times = [_later(window.times_us(mapper), first_us) for window in spec.windows]
    return Assignment(
        case=case,
        seed=seed,
        windows={f"w{number:03d}": time for number, time in enumerate(times)},
        camera=rig.cameras[0].undistorted(),
        baseline_m=rig.baseline_m() if len(rig) > 1 else None,
        depth_range_m=depth_range_m,
        imperfection=spec.imperfection,
    )


def _later(times_us: tuple[int, int, int], first_us: int) -> tuple[int, int, int]:
    """Times that count from the first event on the sequence's own clock."""
    t0_us, t1_us, t_ref_us = times_us
    return t0_us + first_us, t1_us + first_us, t_ref_us + first_us


def _seen(suite: Suite, spec: CaseSpec, seed: int) -> tuple[Rig, tuple[float, float]]:
    """The cameras of a case, and how near and far what they see is, m."""
    if is_given(spec.scene):
        sequence = given(spec.scene)
        assert sequence.manifest.depth_range_m is not None  # it is refused without
        return sequence.rig, sequence.manifest.depth_range_m
    if not is_model_file(spec.scene):
        scene = scenes.load(spec.scene)
        return named_rig(spec.rig or scene.rig), scene.depth_range_m
    config = SimConfig.model_validate(suite.sim_of(spec))
    made = scenes.prepared(spec.scene, spec.rig, config, seed)
    return made.rig, made.scene.depth_range_m


@dataclass(frozen=True)
class SuitePrediction:
    """A method's depth maps for all that is asked for, checked as far as no truth is needed.

    Attributes:
        folder: where its files lie, absolute.
        files: per place of an assignment, by time in µs: name below `folder`, and sha256.
    """

    name: str
    folder: Path
    description: PredictionFacts
    files: Mapping[str, Mapping[int, tuple[str, str]]]

    @property
    def digest(self) -> str:
        """A hash over all files that are scored, and what their numbers mean."""
        facts = [self.description.model_dump(mode="json"), dict(self.files)]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

    def job(self, score: Job) -> Job:
        """Scores this method on the sequence of another scoring job, beside its first mapper."""
        place, shared, needs = _first_mapper(score)
        return Job(
            f"predict/{place}/{self.name}",
            predict.STAGE,
            {**shared, **self.facts(place)},
            needs,
            (str(self.folder),),
        )

    def facts(self, place: str) -> dict[str, Any]:
        """What `eval.stages.predict.opened` opens the depth maps of a place by."""
        return {
            "name": self.name,
            "description": self.description.model_dump(mode="json"),
            "files": {str(t_us): list(one) for t_us, one in self.files[place].items()},
        }


def beside_job(predictions: Sequence[SuitePrediction], score: Job) -> Job:
    """Compares all predictions and the methods of a scoring job's first mapper."""
    place, shared, needs = _first_mapper(score)
    return Job(
        f"{BESIDE}/{place}",
        beside.STAGE,
        {
            **shared,
            "mapper": score.parameters["mappers"][0],
            "predictions": [one.facts(place) for one in predictions],
        },
        needs,
        tuple(str(one.folder) for one in predictions),
    )


def _first_mapper(score: Job) -> tuple[str, dict[str, Any], tuple[Job, ...]]:
    """Of a scoring job its place, and parameters and needs of one beside its first mapper."""
    mappers = score.parameters["mappers"]
    mapped = score.needs[1 : 1 + len(mappers)]  # behind them: the poses that were found
    maps = [one for one, name in zip(mapped, mappers, strict=True) if name == mappers[0]]
    names = ("case", "seed", "score", "scene_digest")
    shared = {name: score.parameters[name] for name in names}
    shared["mappers"] = [DEFAULT_MAPPER] * len(maps)
    return score.name.removeprefix("score/"), shared, (score.needs[0], *maps)


def open_predictions(
    folders: Iterable[NamedFolder], suite: Suite, assignments: Sequence[Assignment]
) -> list[SuitePrediction]:
    """Opens depth maps of others and reads all of them, as a submission checker does.

    Folders are `DIR/CASE/seedN/TIME.npz`, as `Assignment.to_json` lists them.

    Raises:
        InputError: in one line: no folder, a case that the suite does not have, one that is
            missing, a view without a file, a file that is damaged, of another size or unit, without
            any depth, or with negative ones, one map for two views, or inverse depth.
    """
    predictions = [_opened(folder, suite, assignments) for folder in folders]
    check_names([prediction.name for prediction in predictions])
    return predictions


def _opened(given: NamedFolder, suite: Suite, assignments: Sequence[Assignment]) -> SuitePrediction:
    description = described(given.path)
    _check_cases(given.path, suite)
    _check_complete(given.path, assignments)
    name, folder = method_name(given, description), given.path.resolve()
    files, medians = {}, _Medians()
    for asked in assignments:
        found = Prediction(name, timed_files(given.path, description, asked.place), description)
        files[asked.place] = {
            view.t_us: (path.relative_to(given.path).as_posix(), hashed(path).sha256)
            for view, path in _read(found, asked, medians, suite.cases[asked.case].scene)
        }
    medians.check(given.path)
    return SuitePrediction(name, folder, description, files)


def _read(
    found: Prediction, asked: Assignment, medians: _Medians, scene: str
) -> Iterable[tuple[TargetView, Path]]:
    found.check(asked.views)
    for view in asked.views:
        path = found.path_of(view)
        found.check_signs(view)
        # Cases may show the same of a scene: with other settings of mapper or sensor.
        medians.add(path, *found.depth_m(view), view, (scene, asked.seed, view.t_us))
        found.confidence(view)
        yield view, path


@dataclass
class _Medians:
    """What depth maps of different views say together that none says alone.

    Attributes:
        files: by the hash of a map's depth, the file that held it first, and what that shows.
        upright: maps whose median depth the scene can have.
        inverted: maps of whose median it can have the inverse.
        total: maps that hold any depth.
    """

    files: dict[bytes, tuple[Path, ViewId]] = field(default_factory=dict)
    upright: int = 0
    inverted: int = 0
    total: int = 0

    def add(
        self, path: Path, depth_m: NDArray[np.float32], mask: NDArray[np.bool_], view: TargetView,
        shown: ViewId,
    ) -> None:  # fmt: skip
        if not mask.any():
            return
        digest = hashlib.sha256(depth_m.tobytes()).digest()
        first, also = self.files.setdefault(digest, (path, shown))
        if also != shown:
            raise InputError(
                f"{path}: is identical to the depth map of {'/'.join(first.parts[-3:])}: give "
                "each view its own"
            )
        assert view.true_depth_m is not None  # an assignment knows its scene
        near_m, far_m = view.true_depth_m
        median_m = float(np.median(depth_m[mask]))
        self.total += 1
        self.upright += near_m <= median_m <= far_m
        self.inverted += near_m <= 1 / median_m <= far_m

    def check(self, folder: Path) -> None:
        if self.inverted > self.upright:
            raise InputError(
                f"{folder}: {self.upright} of {self.total} depth maps have a median that the "
                f"scene can have, but {self.inverted} of their inverses: write z-depth in metres "
                "instead of inverse depth"
            )


def _check_cases(folder: Path, suite: Suite) -> None:
    for case in _folders(folder):
        if case.name not in suite.cases:
            raise InputError(
                f"{case}: {suite.name} has no case {case.name!r}: rename or remove it; there are "
                f"{', '.join(suite.cases)}"
            )
        for seed in _folders(case):
            if not _SEED.fullmatch(seed.name):
                raise InputError(f"{seed}: needs a name such as seed0")


def _folders(folder: Path) -> list[Path]:
    return sorted(
        path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")
    )


def _check_complete(folder: Path, assignments: Sequence[Assignment]) -> None:
    missing = [asked for asked in assignments if not (folder / asked.place).is_dir()]
    if missing:
        first = missing[0]
        raise InputError(
            f"{folder}: no depth maps for {len(missing)} of {len(assignments)} sequences, the "
            f"first is {first.case} with seed {first.seed}: needs {folder / first.place}/"
            f"{first.views[0].t_us}.npz; `{LISTING}` lists all"
        )


def perfect_scores(rows: pd.DataFrame) -> dict[str, list[str]]:
    """Methods with an error that no estimate has, and the cases and seeds where: copies of truth.

    Sensors see light in steps of a fifth, so a mean error of less than a two-thousandth of depth
    cannot come from events; truth that was rounded to millimetres or 16 bits lies below that.
    """
    is_error = (rows["window"] == POOLED) & (rows["metric"] == "abs_rel")
    found: dict[str, list[str]] = {}
    for row in each(rows[is_error & (rows["value"] < PERFECT_PERCENT)]):
        found.setdefault(row.method, []).append(f"{row.case} seed {row.seed}")
    return found
