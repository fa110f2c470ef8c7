"""`eventsweep simulate`: a scene to a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eval.cli.app import (
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


@app.command
def simulate(
    scene: Scene,
    /,
    *,
    out: Path,
    rig: RigName = None,
    seconds: float | None = None,
    trajectory: Path | None = None,
    seed: int = 0,
    workers: int = 1,
    fresh: Annotated[bool, NO_NEGATIVE] = False,
    force: Force = False,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
) -> None:
    """Render a scene and simulate its events, with exact depth and poses.

    Args:
        scene: Scene to simulate; `eventsweep list scenes` names them.
        out: Sequence folder to write.
        rig: Rig to use instead of the scene's own; `eventsweep list rigs`.
        seconds: Length of the sequence, s; same as --sim.duration-s.
        trajectory: Poses in TUM format for the head to follow; same as --sim.replay.trajectory.
        seed: Seed of head motion and sensor noise.
        workers: Processes that render.
        fresh: Discard the work of an interrupted run instead of continuing it.
    """
    from eval.pipeline import simulate_scene

    replay = with_values(sim.replay, trajectory=trajectory) if trajectory else None
    wanted = common.settings(sim=with_values(sim, duration_s=seconds, replay=replay))
    common.check(out, trajectory, force=force)
    console = common.console()
    simulate_scene(
        scene,
        out,
        wanted,
        rig,
        seed,
        force=force,
        workers=workers,
        fresh=fresh,
        progress=console.progress,
    )
    console.sequence(out)
