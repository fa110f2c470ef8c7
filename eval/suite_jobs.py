"""A suite as a graph of jobs: simulate, map, score."""

from __future__ import annotations

from collections.abc import Sequence

from emvs.config import MapperConfig
from eval.jobs.job import Job
from eval.runner import check_case
from eval.stage_simulate import parameters as sequence_parameters
from eval.stage_simulate import scene_digest
from eval.suite import Suite


def suite_jobs(suite: Suite, cases: Sequence[str], seeds: Sequence[int]) -> list[Job]:
    """One scoring job per case and seed, with all that it needs.

    Raises:
        InputError: an unknown scene, rig or method, a GPU that is not there.
    """
    for case in cases:
        _check(suite, case)
    digests = {case: scene_digest(suite.cases[case].scene) for case in cases}
    return [_score_job(suite, case, seed, digests[case]) for seed in seeds for case in cases]


def _check(suite: Suite, case: str) -> None:
    """Refuses before the first job what would fail in the last."""
    spec = suite.cases[case]
    for mapper in spec.mappers:
        check_case(spec.scene, spec.rig, MapperConfig.model_validate(suite.mappers[mapper]))


def _score_job(suite: Suite, case: str, seed: int, digest: str) -> Job:
    spec, place = suite.cases[case], f"{case}/seed{seed}"
    sim = suite.sim_of(spec)
    facts = sequence_parameters(spec.scene, spec.rig, seed, sim)
    sequence = Job(f"simulate/{place}", "eval.stage_simulate", facts)
    maps, mappers = [], []
    for mapper in spec.mappers:
        for number, window in enumerate(spec.windows):
            times = {"start_s": window.start_s, "duration_s": window.duration_s}
            name = f"w{number:03d}"
            asked = {"window": name, "map": {**suite.mappers[mapper], **times}}
            maps.append(Job(f"map/{place}/{mapper}/{name}", "eval.stage_map", asked, (sequence,)))
            mappers.append(mapper)
    wanted = {
        "case": case,
        "seed": seed,
        "mappers": mappers,
        "score": suite.score,
        "scene_digest": digest,
    }
    return Job(f"score/{place}", "eval.stage_score", wanted, (sequence, *maps))
