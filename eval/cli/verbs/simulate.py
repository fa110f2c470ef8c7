"""`eventsweep simulate`: a scene to a sequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import (
    CONFIGURED,
    NO_NEGATIVE,
    SIM,
    Configured,
    Force,
    RigName,
    Scene,
    SimFlags,
    app,
    with_values,
)
from eventsweep.eval.cli.job_flags import CACHE_FLAGS, JOB_FLAGS, CacheFlags, seed_numbers

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console

_POSES = (".txt", ".tum")


@app.command
def simulate(
    scene: Scene,
    /,
    *,
    out: Path,
    rig: RigName = None,
    seconds: float | None = None,
    trajectory: Path | None = None,
    mount: str | None = None,
    motion: str | None = None,
    seed: int | None = None,
    seeds: str | None = None,
    workers: int = 1,
    fresh: Annotated[bool, NO_NEGATIVE] = False,
    force: Force = False,
    job_flags: CacheFlags = CACHE_FLAGS,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
) -> None:
    """Render a scene and simulate its events, with exact depth and poses.

    Args:
        scene: Scene to simulate; `eventsweep list scenes` names them. Or a model of your own, in
            MJCF (.xml) or URDF (.urdf).
        out: Sequence folder to write; with --seeds a folder with one for each seed.
        rig: Rig to use instead of the scene's own; `eventsweep list rigs`. Or `model:left,right`
            for a model's own cameras.
        seconds: Length of the sequence, s; same as --sim.duration-s.
        trajectory: Poses in TUM format for the head to follow; same as --sim.replay.trajectory.
        mount: Body, site or camera of a model that carries the rig; same as --sim.model.mount.
        motion: What moves in a model: `dynamics`, a table of joints (.csv), a head style such as
            `walk`, or poses in TUM format; same as --sim.model.motion and --trajectory.
        seed: Seed of head motion and sensor noise; by default 0.
        seeds: Seeds to simulate as jobs, such as 0-9 or 0,5; what is done is kept in the cache.
        workers: Processes that render; with --seeds, that simulate a seed each.
        fresh: Discard the work of an interrupted run instead of continuing it.
    """
    from eventsweep.eval.seeds import simulate_seeds
    from eventsweep.eval.stages.simulate import simulate_scene

    if motion and Path(motion).suffix in _POSES:
        trajectory, motion = trajectory or Path(motion), None
    replay = with_values(sim.replay, trajectory=trajectory) if trajectory else None
    given = mount is not None or motion is not None
    model = with_values(sim.model, mount=mount, motion=motion) if given else None
    wanted = common.settings(sim=with_values(sim, duration_s=seconds, replay=replay, model=model))
    console = common.console()
    numbers = _seeds(seeds, seed, job_flags, fresh=fresh)
    if numbers is not None:
        here = None if job_flags.scheduler else workers
        flags = replace(JOB_FLAGS, **vars(job_flags), workers=here)
        made = simulate_seeds(
            scene, out, wanted.sim, rig, numbers, crew=flags.open, cache=flags.cache_folder(),
            force=force, progress=console.progress,
        )  # fmt: skip
        _show_all(console, made)
        return
    simulate_scene(
        scene,
        out,
        wanted.sim,
        rig,
        seed or 0,
        force=force,
        workers=workers,
        fresh=fresh,
        progress=console.progress,
    )
    _show(console, out)


def _seeds(
    seeds: str | None, seed: int | None, job_flags: CacheFlags, *, fresh: bool
) -> tuple[int, ...] | None:
    """The seeds that are jobs; refuses what only goes with them, or without."""
    job_flags.check()
    numbers = seed_numbers(seeds, "--seeds")
    if numbers is None:
        if job_flags.scheduler or job_flags.cache:
            raise InputError(
                "--scheduler and --cache are for jobs: add --seeds, such as --seeds 0-9"
            )
        return None
    if seed is not None or fresh:
        raise InputError(
            f"--seeds with {'--fresh' if fresh else '--seed'}: its seeds are jobs, which the cache "
            "keeps; leave one out"
        )
    return numbers


def _show_all(console: Console, made: Mapping[int, Path]) -> None:
    shown = [_facts(path) for path in made.values()]
    console.result([facts for facts, _, _ in shown], [line for _, line, _ in shown])


def _show(console: Console, path: Path) -> None:
    from eventsweep.eval.cli.console import dim

    facts, line, renderer = _facts(path)
    console.result(facts, [line, dim(f"drawn by {renderer}")])


def _facts(path: Path) -> tuple[dict[str, Any], str, str]:
    """The summary of a sequence, as facts for `--json` and as a line, and its renderer."""
    from eventsweep.emvs.data.sequence import Sequence
    from eventsweep.eval.numbers import thousands

    sequence = Sequence.open(path)
    manifest = sequence.manifest
    duration_s = (manifest.span_us[1] - manifest.span_us[0]) * 1e-6
    facts = {
        "sequence": str(path),
        "events": list(manifest.event_counts),
        "duration_s": duration_s,
        "renderer": manifest.renderer,
        "sha256": manifest.digest(),
    }
    counts = " + ".join(map(thousands, manifest.event_counts))
    line = f"{sequence.name}: {counts} events in {duration_s:g} s, {path}"
    return facts, line, manifest.renderer
