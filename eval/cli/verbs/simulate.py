"""`eventsweep simulate`: a scene to a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    seed: int = 0,
    workers: int = 1,
    fresh: Annotated[bool, NO_NEGATIVE] = False,
    force: Force = False,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
) -> None:
    """Render a scene and simulate its events, with exact depth and poses.

    Args:
        scene: Scene to simulate; `eventsweep list scenes` names them. Or a model of your own, in
            MJCF (.xml) or URDF (.urdf).
        out: Sequence folder to write.
        rig: Rig to use instead of the scene's own; `eventsweep list rigs`. Or `model:left,right`
            for a model's own cameras.
        seconds: Length of the sequence, s; same as --sim.duration-s.
        trajectory: Poses in TUM format for the head to follow; same as --sim.replay.trajectory.
        mount: Body, site or camera of a model that carries the rig; same as --sim.model.mount.
        motion: What moves in a model: `dynamics`, a table of joints (.csv), a head style such as
            `walk`, or poses in TUM format; same as --sim.model.motion and --trajectory.
        seed: Seed of head motion and sensor noise.
        workers: Processes that render.
        fresh: Discard the work of an interrupted run instead of continuing it.
    """
    from eventsweep.eval.stages.simulate import simulate_scene

    if motion and Path(motion).suffix in _POSES:
        trajectory, motion = trajectory or Path(motion), None
    replay = with_values(sim.replay, trajectory=trajectory) if trajectory else None
    given = mount is not None or motion is not None
    model = with_values(sim.model, mount=mount, motion=motion) if given else None
    wanted = common.settings(sim=with_values(sim, duration_s=seconds, replay=replay, model=model))
    console = common.console()
    simulate_scene(
        scene,
        out,
        wanted.sim,
        rig,
        seed,
        force=force,
        workers=workers,
        fresh=fresh,
        progress=console.progress,
    )
    _show(console, out)


def _show(console: Console, path: Path) -> None:
    from eventsweep.emvs.data.sequence import Sequence
    from eventsweep.eval.cli.console import dim
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
    console.result(facts, [line, dim(f"drawn by {manifest.renderer}")])
