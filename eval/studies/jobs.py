"""A study as a graph of jobs: one score per case, seed and amount."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from emvs.config import MapperConfig
from emvs.errors import InputError
from eval.config import EvalConfig
from eval.jobs.job import Job
from eval.runner import check_case
from eval.studies.study import MARGIN_S, SECONDS, Change, Study
from eval.suite.stages.simulate import parameters as sequence_parameters
from eval.suite.stages.simulate import scene_digest


def study_jobs(
    study: Study,
    methods: Sequence[str],
    cases: Sequence[str],
    seeds: Sequence[int],
    seconds: float = SECONDS,
) -> dict[tuple[str, int, float], Job]:
    """The scoring job of every case, seed and amount, with all that it needs.

    Args:
        study: what to perturb.
        methods: whose maps are compared.
        cases: scenes.
        seeds: of the head motion, the sensor's noise and the perturbation.
        seconds: length of every sequence, s.

    Raises:
        InputError: an unknown case or method, or sequences too short for a window.
    """
    if not seconds > 3 * MARGIN_S:
        raise InputError(f"sequences of {seconds:g} s: a study needs more than {3 * MARGIN_S:g} s")
    for case in cases:
        check_case(case, None, MapperConfig(methods=tuple(methods)))
    return {
        (case, seed, amount): _score_job(study, methods, case, seed, amount, seconds)
        for case in cases
        for seed in seeds
        for amount in study.amounts
    }


def _score_job(
    study: Study, methods: Sequence[str], case: str, seed: int, amount: float, seconds: float
) -> Job:
    change = study.change(amount)
    length = {"duration_s": seconds, "truth_times_s": [seconds / 2]}
    facts = sequence_parameters(case, None, seed, {**length, **change.sim})
    simulated = f"{case}/seed{seed}"
    place = f"{simulated}/{study.name}={amount:g}"
    sequence = (
        Job(f"simulate/{place}", "eval.studies.stage_simulate", {**facts, "change": change.scene})
        if change.scene or change.sim
        else Job(f"simulate/{simulated}", "eval.suite.stages.simulate", facts)
    )
    mapping = {
        "window": "w000",
        "map": {"methods": list(methods), **window_of(change, seconds)},
        "perturb": change.perturb,
        "seed": seed,
    }
    mapped = Job(f"map/{place}", "eval.studies.stage_map", mapping, (sequence,))
    scoring = {
        "case": case,
        "seed": seed,
        "mappers": ["default"],
        "score": EvalConfig().model_dump(mode="json"),
        "scene_digest": scene_digest(case),
    }
    return Job(f"score/{place}", "eval.suite.stages.score", scoring, (sequence, mapped))


def window_of(change: Change, seconds: float) -> dict[str, Any]:
    """The mapper's settings at an amount: a window about the middle, where the truth is.

    Raises:
        InputError: it is longer than the sequence.
    """
    settings = {"duration_s": seconds - 2 * MARGIN_S, **change.map}
    if settings["duration_s"] > seconds:
        raise InputError(
            f"a window of {settings['duration_s']:g} s in sequences of {seconds:g} s: "
            "make them longer with --seconds"
        )
    start_s = (seconds - settings["duration_s"]) / 2
    return {
        **settings,
        "start_s": round(start_s, 6),
        "duration_s": round(settings["duration_s"], 6),
    }
