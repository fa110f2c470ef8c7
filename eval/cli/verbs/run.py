"""`eventsweep run`: simulate, map, score and report cases."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from eventsweep.eval.cli.app import (
    CONFIGURED,
    MAP,
    SCORE,
    SIM,
    AllowSkipped,
    Configured,
    DeviceName,
    Force,
    MapFlags,
    Methods,
    Poses,
    RigName,
    Scenes,
    ScoreFlags,
    SimFlags,
    app,
    check_skipping,
    with_values,
)
from eventsweep.eval.cli.help import RARE
from eventsweep.eval.cli.job_flags import CACHE_FLAGS, CacheFlags
from eventsweep.eval.cli.view_flags import VIEW_FLAGS, ViewFlags


@app.command
def run(
    case: Scenes,
    /,
    *,
    out: Path,
    rig: RigName = None,
    seconds: float | None = None,
    seed: int = 0,
    poses: Annotated[Poses, RARE] = "true",
    workers: int = 1,
    method: Methods = (),
    device: DeviceName = None,
    allow_skipped: AllowSkipped = False,
    force: Force = False,
    view_flags: ViewFlags = VIEW_FLAGS,
    job_flags: CacheFlags = CACHE_FLAGS,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
    map: MapFlags = MAP,  # noqa: A002 - the name is the flag's prefix
    score: ScoreFlags = SCORE,
) -> int:
    """Simulate, map and score cases, and write one report.

    Args:
        case: Scenes to run; `eventsweep list scenes` names them. Or models of your own, in MJCF
            (.xml) or URDF (.urdf), with --sim.model.
        out: Folder to write: report.html, results.json, results.csv and a folder per case.
        rig: Rig to use instead of each scene's own; `eventsweep list rigs`.
        seconds: Length of each sequence, s; same as --sim.duration-s.
        seed: Seed of head motion and sensor noise.
        poses: With `track`, poses are also found from events; they, and the maps made with them,
            are scored beside those with true poses.
        workers: Processes that render.
        method: Method to map with, repeatable; `eventsweep list methods`.
        device: Where the mapper's sweep runs; same as --map.device.
        allow_skipped: Exit with 0 even if some of the sliding windows could not be mapped.
    """
    from eventsweep.emvs.maps.folder import read_info
    from eventsweep.emvs.utils.outputs import check_output
    from eventsweep.eval.cli.exit_codes import incomplete
    from eventsweep.eval.cli.verbs.report import report_stage
    from eventsweep.eval.cli.verbs.score import show_results
    from eventsweep.eval.pipeline import Watch, run_cases
    from eventsweep.eval.scoring.run_folder import MAP_FOLDER
    from eventsweep.eval.trackers import TRUE
    from eventsweep.scenes import case_name

    wanted = common.settings(
        sim=with_values(sim, duration_s=seconds),
        map=with_values(map, methods=method or None, device=device),
        score=score,
    )
    job_flags.check()
    check_skipping(wanted.map, allowed=allow_skipped)
    console = common.console()
    check_output(out, force=force)
    with view_flags.opened(out.resolve().name, force=force) as view:
        results = run_cases(
            case,
            out,
            wanted,
            rig,
            seed,
            force=force,
            renderers=workers,
            finish=report_stage(console.progress),
            tracker=None if poses == TRUE else poses,
            cache=job_flags.cache_folder(),
            crew=job_flags.cluster if job_flags.scheduler else None,
            progress=console.progress,
            watch=view or Watch(),
        )
    show_results(console, results, wanted.score.ranking_metric)
    console.wrote(out / "report.html")
    maps = [read_info(out / case_name(name) / MAP_FOLDER) for name in case]
    return incomplete(maps, allowed=allow_skipped)
