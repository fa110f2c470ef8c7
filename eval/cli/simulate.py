"""`eventsweep simulate`: a scene to a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eval.cli.app import CONFIGURED, NO_NEGATIVE, SIM, Configured, SimFlags, app, with_values


@app.command
def simulate(
    scene: str,
    /,
    *,
    out: Path,
    rig: str | None = None,
    seconds: float | None = None,
    trajectory: Path | None = None,
    seed: int = 0,
    workers: int = 1,
    fresh: Annotated[bool, NO_NEGATIVE] = False,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
) -> None:
    """Render a scene and simulate its events, with exact depth and poses.

    Args:
        scene: Scene to simulate; see `eventsweep list`.
        out: Sequence folder to write.
        rig: Rig to use instead of the scene's own.
        seconds: Length of the sequence; as --sim.duration-s.
        trajectory: Poses in TUM format to move the head by; as --sim.replay.trajectory.
        seed: Seed of the head motion and the sensor's noise.
        workers: Rendering processes.
        fresh: Discard the unfinished work of an interrupted run instead of taking it up.
    """
    from eval.pipeline import simulate_scene

    replay = with_values(sim.replay, trajectory=trajectory) if trajectory else None
    wanted = common.settings(sim=with_values(sim, duration_s=seconds, replay=replay))
    common.check(out, trajectory)
    console = common.console()
    simulate_scene(
        scene,
        out,
        wanted,
        rig,
        seed,
        force=common.force,
        workers=workers,
        fresh=fresh,
        progress=console.progress,
    )
    console.sequence(out)
