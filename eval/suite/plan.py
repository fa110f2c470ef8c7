"""From what is asked to jobs: of every case and seed a sequence, its maps, and their scores.

A suite, a study and a run are planned here; they differ in where their settings come from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any
from uuid import uuid4

from eventsweep import scenes
from eventsweep.emvs import methods
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.device import check_device
from eventsweep.emvs.errors import InputError, offer
from eventsweep.emvs.parameters import stated
from eventsweep.emvs.utils.runtime import check_openmp
from eventsweep.eval.config import Settings
from eventsweep.eval.found_poses import TRACK
from eventsweep.eval.jobs.job import Job
from eventsweep.eval.results.results import DEFAULT_MAPPER
from eventsweep.eval.stages import map as mapping
from eventsweep.eval.stages import score, simulate, track
from eventsweep.eval.suite.definition import FROZEN, CaseSpec, Suite
from eventsweep.eval.suite.given import given, given_job, is_given
from eventsweep.eval.suite.source import SequenceSource
from eventsweep.sim.config import SimConfig
from eventsweep.sim.mjcf import is_model_file

digest_of_scene = cache(simulate.scene_digest)


def suite_jobs(
    suite: Suite, cases: Sequence[str], seeds: Sequence[int], archive: SequenceSource | None = None
) -> list[Job]:
    """One scoring job per case and seed, with all that it needs."""
    for case in cases:
        spec = suite.cases[case]
        sim = SimConfig.model_validate(suite.sim_of(spec))
        for mapper in spec.mappers:
            config = MapperConfig.model_validate(suite.mappers[mapper])
            if is_given(spec.scene):
                _check_given(case, spec, config)
                continue
            check_case(spec.scene, spec.rig, config, sim, track=bool(spec.track))
    source = archive.sequence if archive else simulated
    return [
        _suite_job(suite, case, seed, *_sequence(suite, case, seed, source))
        for seed in seeds
        for case in cases
        if not suite.leaves_out(case, seed)
    ]


def _sequence(
    suite: Suite, case: str, seed: int, source: Callable[[Suite, str, int], tuple[Job, str]]
) -> tuple[Job, str]:
    scene = suite.cases[case].scene
    return given_job(case, scene) if is_given(scene) else source(suite, case, seed)


def simulated(suite: Suite, case: str, seed: int) -> tuple[Job, str]:
    """The job that simulates the sequence of a case, and the hash of its scene.

    Cases of the same sequence share the job, which is named after the first of them.
    """
    wanted = _sequence_of(suite, case)
    first = next(name for name in suite.cases if _sequence_of(suite, name) == wanted)
    spec = suite.cases[case]
    facts = simulate.sequence_parameters(
        spec.scene, spec.rig, seed, suite.sim_of(spec), spec.change
    )
    return Job(f"simulate/{first}/seed{seed}", simulate.STAGE, facts), digest_of_scene(spec.scene)


def _sequence_of(suite: Suite, case: str) -> list[Any]:
    spec = suite.cases[case]
    return [spec.scene, spec.rig, suite.sim_of(spec), spec.change]


def _suite_job(suite: Suite, case: str, seed: int, sequence: Job, digest: str) -> Job:
    spec, place = suite.cases[case], f"{case}/seed{seed}"
    # Only where there is any: the keys of other jobs stay what they were.
    wrong = {"perturb": spec.imperfection, "seed": seed} if spec.imperfection else {}
    windows = [(f"w{number:03d}", window) for number, window in enumerate(spec.windows)]
    maps = [
        Job(
            f"map/{place}/{mapper}/{name}",
            mapping.STAGE,
            {
                "window": name,
                "map": {
                    **FROZEN,
                    **suite.mappers[mapper],
                    "start_s": window.start_s,
                    "duration_s": window.duration_s,
                },
                **wrong,
            },
            (sequence,),
        )
        for mapper in spec.mappers
        for name, window in windows
    ]
    mappers = [mapper for mapper in spec.mappers for _ in windows]
    tracked: tuple[Job, ...] = ()
    if spec.track:
        settings: dict[str, dict[str, Any]] = {}
        for job, mapper in zip(maps, mappers, strict=True):
            settings.setdefault(mapper, {})[job.parameters["window"]] = job.parameters["map"]
        tracker = TRACK if spec.track is True else spec.track
        wanted = {"tracker": tracker, "maps": settings, **wrong}
        tracked = (Job(f"track/{place}", track.STAGE, wanted, (sequence,)),)
    about = {
        "case": case,
        "seed": seed,
        "mappers": mappers,
        "score": suite.score,
        "scene_digest": digest,
        **({"track": True} if tracked else {}),
    }
    return Job(f"score/{place}", score.STAGE, about, (sequence, *maps, *tracked))


def run_job(scene: str, settings: Settings, rig: str | None, seed: int, tracker: str | None) -> Job:
    """The scoring job of a run's case: one sequence, one map folder, found poses if asked for."""
    case = scenes.case_name(scene)
    facts = simulate.sequence_parameters(scene, rig, seed, stated(settings.sim))
    if settings.sim.model.controller:
        facts["once"] = uuid4().hex  # what the user's code imports is not known: never found again
    sequence = Job(f"simulate/{case}", simulate.STAGE, facts)
    wanted = stated(settings.map)
    mapped = Job(f"map/{case}", mapping.STAGE, {"map": wanted}, (sequence,))
    tracked: tuple[Job, ...] = ()
    if tracker is not None:
        asked = {"tracker": tracker, "maps": {DEFAULT_MAPPER: {"": wanted}}, "of_run": True}
        tracked = (Job(f"track/{case}", track.STAGE, asked, (sequence, mapped)),)
    about = {
        "case": case,
        "seed": seed,
        "mappers": [DEFAULT_MAPPER],
        "score": stated(settings.score),
        "scene_digest": "",  # no baseline of runs needs it, and it takes half a second
        "of_run": True,
        **({"track": True} if tracked else {}),
    }
    return Job(f"score/{case}", score.STAGE, about, (sequence, mapped, *tracked))


def check_case(
    scene: str, rig: str | None, config: MapperConfig, sim: SimConfig | None = None, *,
    track: bool = False,
) -> None:  # fmt: skip
    """Refuses, before a scene is simulated, what could not be simulated, mapped or tracked."""
    check_openmp()
    configured = sim or SimConfig()
    if not is_model_file(scene):
        scenes.load(scene).configured(configured)
    _check_mapped(scene, len(scenes.rig_for(scene, rig, configured)), config, track=track)


def _check_given(case: str, spec: CaseSpec, config: MapperConfig) -> None:
    """Refuses settings of the simulator, and what cannot be mapped or tracked."""
    check_openmp()
    simulators = {"rig": spec.rig, "sim": spec.sim, "change": spec.change}
    for name, value in simulators.items():
        if value:
            raise InputError(f"case {case}: {name} is for scenes, its sequence is given: remove it")
    _check_mapped(spec.scene, len(given(spec.scene).rig), config, track=bool(spec.track))


def _check_mapped(scene: str, cameras: int, config: MapperConfig, *, track: bool) -> None:
    methods.methods_by_name(config.methods, cameras, mcemvs=config.is_mcemvs)
    if track and cameras < 2:
        raise InputError(
            f"{scene}: one camera cannot determine the scale of its poses: choose a stereo rig"
        )
    check_device(config.device)


def extent(
    suite: Suite, subset: str, seeds: Sequence[int] | None, cases: Sequence[str] | None,
    archive: SequenceSource | None = None,
) -> tuple[tuple[str, ...], tuple[int, ...]]:  # fmt: skip
    """The cases and seeds of a run: some of a subset's cases, its seeds or others.

    Of an archive by default those of its seeds that the subset has, of a hidden one all.
    """
    chosen = suite.subset(subset)
    its_cases = _chosen(chosen.cases, cases)
    if seeds is None:
        seeds = archive.seeds(its_cases, chosen.seeds) if archive else chosen.seeds
    return its_cases, tuple(seeds)


def _chosen(known: Sequence[str], wanted: Sequence[str] | None) -> tuple[str, ...]:
    for case in wanted or ():
        if case not in known:
            raise InputError(f"no case {case!r} here: {offer(known, 'the suite has none')}")
    return tuple(case for case in known if not wanted or case in wanted)
