"""`eventsweep run`: simulate, map, score and report cases."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from emvs.config import DeviceName
from eval.cli.app import (
    CONFIGURED,
    MAP,
    NO_NEGATIVE,
    SCORE,
    SIM,
    Configured,
    MapFlags,
    Methods,
    ScoreFlags,
    SimFlags,
    app,
    with_values,
)


@app.command
def run(
    case: Annotated[tuple[str, ...], NO_NEGATIVE],
    /,
    *,
    out: Path,
    rig: str | None = None,
    seconds: float | None = None,
    seed: int = 0,
    workers: int = 1,
    method: Methods = (),
    device: DeviceName | None = None,
    allow_skipped: Annotated[bool, NO_NEGATIVE] = False,
    common: Configured = CONFIGURED,
    sim: SimFlags = SIM,
    map: MapFlags = MAP,  # noqa: A002 - the name is the flag's prefix
    score: ScoreFlags = SCORE,
) -> int:
    """Simulate, map and score cases, and write one report.

    Args:
        case: Cases to run; see `eventsweep list`.
        out: Folder to write: results.json, results.csv, report.html, and a folder per case.
        rig: Rig to use instead of each scene's own.
        seconds: Length of the sequence; as --sim.duration-s.
        seed: Seed of the head motion and the sensor's noise.
        workers: Rendering processes.
        method: Method to map with, repeatable; as --map.methods.
        device: Where the mapper's sweep runs; as --map.device.
        allow_skipped: End with 0 although some of the sliding windows could not be mapped.
    """
    from emvs.maps.folder import read_info
    from eval.cli.exit_codes import incomplete
    from eval.cli.report import report_stage
    from eval.pipeline import run_cases
    from eval.scoring.run_folder import MAP_FOLDER

    wanted = common.settings(
        sim=with_values(sim, duration_s=seconds),
        map=with_values(map, methods=method or None, device=device),
        score=score,
    )
    common.check(out)
    console = common.console()
    results = run_cases(
        case,
        out,
        wanted,
        rig,
        seed,
        force=common.force,
        workers=workers,
        finish=report_stage(console.progress),
        progress=console.progress,
    )
    console.results(results, wanted.score.ranking_metric)
    console.wrote(out / "report.html")
    maps = [read_info(out / one / MAP_FOLDER) for one in case]
    return incomplete(maps, allowed=allow_skipped)
