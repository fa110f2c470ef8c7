"""A study as a graph of jobs: one score per case, seed and amount."""

from __future__ import annotations

from collections.abc import Sequence

import scenes
from emvs import fusion
from eval.config import EvalConfig
from eval.jobs import Job
from eval.stage_simulate import parameters as sequence_parameters
from eval.stage_simulate import scene_digest
from eval.studies.study import DURATION_S, START_S, Study
from sim.rigs import rig as named_rig


def study_jobs(
    study: Study, methods: Sequence[str], cases: Sequence[str], seeds: Sequence[int]
) -> dict[tuple[str, int, float], Job]:
    """The scoring job of every case, seed and amount, with all that it needs.

    Raises:
        InputError: an unknown case or method.
    """
    for case in cases:
        fusion.methods(tuple(methods), len(named_rig(scenes.load(case).rig)))
    return {
        (case, seed, amount): _score_job(study, methods, case, seed, amount)
        for case in cases
        for seed in seeds
        for amount in study.amounts
    }


def _score_job(study: Study, methods: Sequence[str], case: str, seed: int, amount: float) -> Job:
    change = study.change(amount)
    facts = sequence_parameters(case, None, seed, {"duration_s": 0.5, **change.sim})
    simulated = f"{case}/seed{seed}"
    place = f"{simulated}/{study.name}={amount:g}"
    sequence = (
        Job(f"simulate/{place}", "eval.studies.stage_simulate", {**facts, "change": change.scene})
        if change.scene or change.sim
        else Job(f"simulate/{simulated}", "eval.stage_simulate", facts)
    )
    window = {"start_s": START_S, "duration_s": DURATION_S, **change.map}
    asked = {
        "window": "w000",
        "map": {"methods": list(methods), **window},
        "perturb": change.perturb,
        "seed": seed,
    }
    mapped = Job(f"map/{place}", "eval.studies.stage_map", asked, (sequence,))
    wanted = {
        "case": case,
        "seed": seed,
        "mappers": ["default"],
        "score": EvalConfig().model_dump(mode="json"),
        "scene_digest": scene_digest(case),
    }
    return Job(f"score/{place}", "eval.stage_score", wanted, (sequence, mapped))
