"""Sequences of one scene with many seeds, each a job: cached, resumed, also on a cluster."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from uuid import uuid4

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import stated
from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.files import link_tree
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.eval.jobs.job import SEQUENCE, Failed, Job, entry
from eventsweep.eval.jobs.scheduler import Open, run_jobs
from eventsweep.eval.progress import SILENT, Display
from eventsweep.eval.stages import simulate
from eventsweep.scenes import case_name
from eventsweep.sim.config import SimConfig


def simulate_seeds(
    scene: str, out: Path, config: SimConfig, rig: str | None, seeds: Iterable[int], *,
    crew: Open, cache: Path, force: bool = False, progress: Display = SILENT,
) -> dict[int, Path]:  # fmt: skip
    """Simulates a scene once for each seed, into `out/seedN`; `out` appears when all is done.

    The bytes are those of `simulate_scene`. What is finished stays in the cache, so the same call
    goes on after an interruption, and one with more seeds simulates those alone.

    Args:
        scene: its name, or a model's file.
        out: folder to write.
        config: settings of the simulator.
        rig: the cameras instead of the scene's own.
        seeds: of motion and noise.
        crew: opens the workers.
        cache: where jobs' results are kept.
        force: whether an output in the place of `out` is replaced.
        progress: shows how many are done.

    Returns:
        The folder of each seed's sequence.

    Raises:
        InputError: an existing `out` without `force`, or the reason of the first seed that failed.
    """
    check_output(out, force=force)
    jobs = planned(scene, config, rig, seeds)
    outcomes = run_jobs(jobs.values(), crew, progress)
    failed = [one for one in outcomes.values() if isinstance(one, Failed)]
    if failed:
        raise InputError(
            f"{failed[0].name}: {failed[0].reason} ({len(failed)} of {len(jobs)} seeds failed, the "
            "others are kept in the cache)"
        )
    with atomic_dir(out, force=force, inputs=(scene, config, rig)) as folder:
        for seed, job in jobs.items():
            made = entry(job, Cache(cache)).path / SEQUENCE
            link_tree(made, folder / f"seed{seed}")
    return {seed: out / f"seed{seed}" for seed in jobs}


def planned(
    scene: str, config: SimConfig, rig: str | None, seeds: Iterable[int]
) -> Mapping[int, Job]:
    """The job of each seed."""
    # What a controller, the user's code, imports is not known: it is never found again.
    once = {"once": uuid4().hex} if config.model.controller else {}
    return {
        seed: Job(
            f"simulate/{case_name(scene)}/seed{seed}",
            simulate.STAGE,
            simulate.sequence_parameters(scene, rig, seed, stated(config)) | once,
        )
        for seed in seeds
    }
