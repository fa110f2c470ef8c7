"""Twins of MVSEC's flights, mapped under errors, and extracted and scored in several ways.

A trial's sequences and sweeps are jobs, which the cache keeps. Maps are made without a median, so
that thresholds, medians and filters are applied afterwards and cost no sweep.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import (
    DepthMap,
    confidence_mask,
    masked_median,
    without_border,
)
from eventsweep.emvs.depth.point_cloud import back_project_map
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, key_of
from eventsweep.eval.cli.job_flags import JobFlags
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.jobs.job import SEQUENCE, Failed, Job, entry
from eventsweep.eval.jobs.scheduler import run_jobs
from eventsweep.eval.progress import Display
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.metrics import Pairs
from eventsweep.eval.scoring.pairing import Truth, pair
from eventsweep.eval.scoring.run_folder import mapped_window, truth_of
from eventsweep.eval.stages import map as mapping
from eventsweep.eval.stages import simulate
from published_table import MONO, H

METRICS = ("mean_error", "median_error", "bad_published", "points")
PAIR = (H.ours, MONO.ours)
CAPS = (57.7, 78.0, 78.8)
"""Votes for full confidence that the authors' configurations have, by flight."""
WINDOW_S = 1.0
Numbers = Mapping[str, float]


class Draw(NamedTuple):
    """One window of a flight: the seed of its motion, that of its errors, and its begin, s."""

    flight: int
    errors: int
    start_s: float


@dataclass(frozen=True)
class Extraction:
    """How maps become points, and how those are scored; the defaults are those of the table.

    Attributes:
        cap: votes for full confidence: one for all flights, by flight in turn, or None for the
            mean of the greatest confidences of H.
        mono_c: threshold of the single camera.
        radius_m: points without three neighbours this near are dropped; 0 keeps all.
        most_error_m: larger errors count as this.
    """

    cap: float | tuple[float, ...] | None = 57.7
    threshold_c: float = 14
    mono_c: float = 14
    median_px: int = 9
    border_px: int = 2
    radius_m: float = 0
    most_error_m: float = float("inf")


@dataclass(frozen=True)
class Trial:
    """One twin: what is simulated, and what is wrong with what its mapper is given.

    Attributes:
        sim: fields of `SimConfig`.
        change: see `eval.stages.changes`.
        wrong: fields of `Perturbation`.
        map: fields of `MapperConfig`.
        extraction: of its maps.
        seconds: length of its sequences.
        starts_s: where its windows begin.
    """

    sim: Mapping[str, Any] = field(default_factory=dict)
    change: Mapping[str, float] = field(default_factory=dict)
    wrong: Mapping[str, float] = field(default_factory=dict)
    map: Mapping[str, Any] = field(default_factory=dict)
    extraction: Extraction = Extraction()
    seconds: float = 1.2
    starts_s: tuple[float, ...] = (0.0, 0.2)

    def draws(self, flights: Iterable[int], times: int = 1) -> list[Draw]:
        """Every window of each flight; random errors are drawn first as a suite draws them."""
        numbers = range(times if self.wrong else 1)
        return [
            Draw(flight, flight + 100 * k, start_s)
            for flight, k, start_s in product(flights, numbers, self.starts_s)
        ]

    def job(self, draw: Draw) -> Job:
        """The sweep of one window."""
        times_s = [round(start_s + WINDOW_S / 2, 6) for start_s in self.starts_s]
        sim = {**self.sim, "duration_s": self.seconds, "truth_times_s": times_s}
        facts = simulate.sequence_parameters("mvsec-flying", "mvsec", draw.flight, sim, self.change)
        window = {"start_s": draw.start_s, "duration_s": WINDOW_S, "median_px": 1}
        wanted = {"methods": list(PAIR), **self.map, **window}
        # What nothing is wrong with is the same for every draw of errors.
        wrong = {"perturb": dict(self.wrong), "seed": draw.errors} if self.wrong else {}
        sequence = Job(f"simulate/{key_of(facts)}", simulate.STAGE, facts)
        parameters = {"window": "w", "map": wanted, **wrong}
        name = f"map/{key_of([facts, parameters])}"
        return Job(name, mapping.STAGE, parameters, (sequence,))


class Bench:
    """Does trials' jobs and pools what comes out."""

    def __init__(self, flags: JobFlags, progress: Display) -> None:
        self._flags, self._progress = flags, progress
        self._cache = Cache(flags.cache_folder())

    def prepare(self, trials: Sequence[Trial], flights: Sequence[int], times: int) -> None:
        """Does what the cache does not have.

        Raises:
            InputError: jobs that failed.
        """
        made = [trial.job(draw) for trial in trials for draw in trial.draws(flights, times)]
        jobs = {job.name: job for job in made}
        outcomes = run_jobs(list(jobs.values()), self._flags.open, self._progress).values()
        failed = [one.reason for one in outcomes if isinstance(one, Failed)]
        if failed:
            raise InputError(f"{len(failed)} jobs failed, the first: {failed[0]}")

    def numbers(
        self, trial: Trial, flights: Sequence[int], times: int, methods: Sequence[str] = PAIR
    ) -> dict[str, Numbers]:
        """Of each method over the pixels of all windows together."""
        chosen = trial.draws(flights, times)
        maps = [self._maps(trial, draw, methods) for draw in chosen]
        truths = [self._truth(trial, draw) for draw in chosen]
        top = float(np.mean([one[H.ours].confidence.max() for one in maps]))
        found: dict[str, Numbers] = {}
        for name in methods:
            parts = []
            for draw, one, truth in zip(chosen, maps, truths, strict=True):
                config = config_of(trial.extraction, name, draw.flight, top)
                parts.append(pairs_of(one[name], truth, config, trial.extraction))
            pooled = joined(parts)
            scores = {metric: float(ALL_METRICS[metric](pooled)) for metric in METRICS}
            found[name] = {**scores, "points": pooled.count / len(parts), "top": top}
        return found

    def _maps(self, trial: Trial, draw: Draw, methods: Sequence[str]) -> dict[str, DepthMap]:
        window = mapped_window(entry(trial.job(draw), self._cache).path)
        return {name: window.depth_map(name) for name in {H.ours, *methods}}

    def _truth(self, trial: Trial, draw: Draw) -> Truth:
        place = entry(trial.job(draw).needs[0], self._cache).path / SEQUENCE
        return _truth(place, round(1e6 * (draw.start_s + WINDOW_S / 2)))


@lru_cache(maxsize=64)
def _truth(place: Path, t_us: int) -> Truth:
    return truth_of(EventSequence.open(place), t_us, EvalConfig())


def config_of(how: Extraction, method: str, flight: int, top: float) -> MapperConfig:
    """The mapper's settings for one method on one flight; `top` is H's greatest confidence."""
    cap = how.cap[flight % len(how.cap)] if isinstance(how.cap, tuple) else how.cap
    return MapperConfig(
        threshold_c=how.mono_c if method == MONO.ours else how.threshold_c,
        max_confidence=top if cap is None else cap,
        median_px=how.median_px,
        border_px=how.border_px,
    )


def extracted(raw: DepthMap, config: MapperConfig, radius_m: float = 0) -> DepthMap:
    """A map that was made without a median, thresholded and smoothed as `extract` does it."""
    mask = confidence_mask(raw.confidence, config)
    # The lower median of an even number is that of the lower plane, whichever way planes run.
    order = np.float32(1 if raw.rho[-1] > raw.rho[0] else -1)
    rho = order * masked_median(order / raw.depth_m, mask, config.median_px)
    made = replace(raw, depth_m=np.reciprocal(rho), mask=without_border(mask, config.border_px))
    return without_lone(made, radius_m) if radius_m else made


def without_lone(depth_map: DepthMap, radius_m: float, neighbours: int = 3) -> DepthMap:
    """The map without points that have fewer neighbours within a radius."""
    points = back_project_map(depth_map).points_world
    nearest = [neighbours + 1]  # the nearest is the point itself
    distance_m, _ = cKDTree(points).query(points, nearest, distance_upper_bound=radius_m)
    kept = np.isfinite(distance_m[:, 0])
    mask = np.zeros(depth_map.mask.size, bool)
    mask[np.flatnonzero(depth_map.mask)[kept]] = True
    return replace(depth_map, mask=mask.reshape(depth_map.mask.shape))


def pairs_of(raw: DepthMap, truth: Truth, config: MapperConfig, how: Extraction) -> Pairs:
    """Estimate beside truth, errors cut off at the most that counts."""
    made = extracted(raw, config, how.radius_m)
    found = pair(made.depth_m, made.mask, truth)
    error_m = np.clip(found.estimate_m - found.truth_m, -how.most_error_m, how.most_error_m)
    return replace(found, estimate_m=found.truth_m + error_m)


def joined(parts: Sequence[Pairs]) -> Pairs:
    """The pixels of all windows as one large window's."""

    def column(name: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(one, name) for one in parts])

    count = sum(one.truth_count for one in parts)
    return Pairs(column("estimate_m"), column("truth_m"), count, parts[0].baseline_focal_px_m)
