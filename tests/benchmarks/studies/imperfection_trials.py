"""Maps the twin of MVSEC's flights under errors of calibration, poses, clocks and truth.

Numbers are kept in a file under all that decides them, so that a search that was stopped goes on
and a table can be written again; delete the file after a change of the code.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.warp import move_depth
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.window_result import WindowResult
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.perturbations import Perturbation, perturbed
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.pairing import Truth, pair
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.eval.suite.definition import load
from study_cache import load_sequence
from study_extraction import Numbers
from study_learned import BASE, JUDGED, most_reliable

METRICS = ("points", "mean_error", "median_error", "bad_published")
EQUAL = " at equal points"
"""Of a network or of Focus: as many of its pixels, the most reliable, as Alg1/H reports."""
_SECONDS = 1.2


class Draw(NamedTuple):
    """One window of 1 s, and which random errors it gets.

    Attributes:
        flight: seed of the twin's motion.
        errors: seed of the errors.
        start_s: begin of the window, s.
    """

    flight: int
    errors: int
    start_s: float = 0.1


class TruthError(NamedTuple):
    """How far the truth is off: the view that it is seen from, in a random direction.

    Truth from a lidar is: its own poses, and its place beside the camera, have errors, too.
    """

    truth_mm: float = 0.0
    truth_deg: float = 0.0


EXACT = TruthError()


def misplaced(
    depth_m: NDArray[np.float32], view: Camera, error: TruthError, seed: int
) -> NDArray[np.float32]:
    """(H, W) true depth in a pinhole view, m, from a map that is off; NaN where none lands."""
    if error == EXACT:
        return depth_m
    way, axis = np.random.default_rng([seed, 0x7247]).normal(size=(2, 3))
    turn = Rotation.from_rotvec(error.truth_deg * axis / np.linalg.norm(axis), degrees=True)
    offset_m = error.truth_mm / 1e3 * way / np.linalg.norm(way)
    return move_depth(depth_m, view, view, se3.from_rotation(turn, offset_m))


class Trials:
    """What was measured, in one folder: sequences, and a file of numbers."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._file = folder, folder / "trials.json"
        text = self._file.read_text("utf-8") if self._file.is_file() else "{}"
        self._known: dict[str, dict[str, Numbers]] = json.loads(text)

    def numbers(
        self, amount: Perturbation, truths: Sequence[TruthError], draw: Draw,
        methods: tuple[str, ...],
    ) -> list[dict[str, Numbers]]:  # fmt: skip
        """Numbers of each method, against truth with each of some errors."""
        keys = [f"{_facts(amount, truth)} {draw} {methods}" for truth in truths]
        if not all(key in self._known for key in keys):
            measured = self._measured(amount, truths, draw, methods)
            self._known.update(zip(keys, measured, strict=True))
            with atomic_path(self._file) as partial:
                partial.write_text(json.dumps(self._known), encoding="utf-8")
        return [self._known[key] for key in keys]

    def _measured(
        self, amount: Perturbation, truths: Sequence[TruthError], draw: Draw,
        methods: tuple[str, ...],
    ) -> list[dict[str, Numbers]]:  # fmt: skip
        sequence = self._sequence(draw.flight)
        result = map_window(perturbed(sequence, amount, draw.errors), _config(draw, methods))
        moved = [self._truth(sequence, result.view.t_us, draw.errors, one) for one in truths]
        return [scores(result, truth) for truth in moved]

    @lru_cache(maxsize=256)  # noqa: B019  (one object in a program)
    def _truth(self, sequence: EventSequence, t_us: int, seed: int, error: TruthError) -> Truth:
        exact = truth_of(sequence, t_us, EvalConfig())
        view = sequence.rig.cameras[0].undistorted()
        depth_m = misplaced(exact.depth_m.astype(np.float32), view, error, seed)
        return replace(exact, depth_m=depth_m, valid=np.isfinite(depth_m))

    @lru_cache(maxsize=8)  # noqa: B019
    def _sequence(self, flight: int) -> EventSequence:
        return load_sequence(
            "mvsec-flying", flight, self.folder, rig="mvsec", seconds=_SECONDS, sensor="davis346"
        )


def _facts(amount: Perturbation, truth: TruthError) -> str:
    sizes = {name: size for name, size in truth._asdict().items() if size}
    facts = {**amount.model_dump(exclude_defaults=True), **sizes}
    return json.dumps(facts, separators=(",", ":"))


def _config(draw: Draw, methods: tuple[str, ...]) -> MapperConfig:
    """The settings of the published table."""
    settings = load("mvsec-table-v2")[0].mappers["pair"]
    window = {"start_s": draw.start_s, "duration_s": 1.0, "threads": 1}
    return MapperConfig.model_validate({**settings, **window, "methods": methods})


def scores(result: WindowResult, truth: Truth) -> dict[str, Numbers]:
    """Each method's numbers at its own pixels, and at as many as Alg1/H has where it ranks them."""
    found = {}
    for name, one in result.depth_maps.items():
        masks = {name: one.mask}
        if MethodName.of(name).family in JUDGED:
            points = result.depth_maps[BASE].points
            masks[name + EQUAL] = most_reliable(one, truth.baseline_focal_px_m, points)
        for label, mask in masks.items():
            pairs = pair(one.depth_m, mask, truth)
            found[label] = {metric: float(ALL_METRICS[metric](pairs)) for metric in METRICS}
    return found
