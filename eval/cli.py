"""The command line: one program, a verb per stage, and `run` for all of them.

Only light modules are imported at the top: help must come at once, and numba, MuJoCo and open3d
take seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Group, Parameter

from emvs.config import MapperConfig
from emvs.errors import InputError
from eval import settings
from eval.config import EvalConfig
from eval.exits import exit_code
from sim.config import SimConfig

_SIM, _MAP, _SCORE = (Group(f"{title} parameters") for title in ("Simulator", "Mapper", "Score"))
SimFlags = Annotated[SimConfig, Parameter(group=_SIM)]
MapFlags = Annotated[MapperConfig, Parameter(group=_MAP)]
ScoreFlags = Annotated[EvalConfig, Parameter(group=_SCORE)]
Methods = Annotated[tuple[str, ...], Parameter(negative=())]

app = App(
    name="eventsweep",
    help="Simulate, map and score event-based multi-view stereo.",
    version=lambda: f"eventsweep {version('eventsweep')}",
    default_parameter=Parameter(negative_iterable=()),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)


@Parameter(name="*")
@dataclass(frozen=True)
class Common:
    """What every command takes."""

    config: Annotated[Path | None, Parameter(group="Common")] = None
    "TOML file with the tables [sim], [map] and [score]; flags go before it."

    force: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Replace an existing output."

    quiet: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Print no progress and no summary."

    json: Annotated[bool, Parameter(group="Common", negative=())] = False
    "Print the summary as JSON."

    def console(self) -> Any:
        """Where progress and summaries go."""
        from eval.console import Console

        return Console(quiet=self.quiet, as_json=self.json)


_COMMON = Common()
_SIM_DEFAULT, _MAP_DEFAULT, _SCORE_DEFAULT = SimConfig(), MapperConfig(), EvalConfig()


@app.command
def run(
    case: Annotated[tuple[str, ...], Parameter(negative=())],
    /,
    *,
    out: Path,
    rig: str | None = None,
    seconds: float | None = None,
    seed: int = 0,
    workers: int = 1,
    method: Methods = (),
    common: Common = _COMMON,
    sim: SimFlags = _SIM_DEFAULT,
    map: MapFlags = _MAP_DEFAULT,  # noqa: A002 - the name is the flag's prefix
    score: ScoreFlags = _SCORE_DEFAULT,
) -> None:
    """Simulate, map and score cases, and write one report.

    Args:
        case: Cases to run; see `eventsweep list`.
        out: Folder to write: results.json, results.csv, report.html, and a folder per case.
        rig: Rig to use instead of each scene's own.
        seconds: Length of the sequence; as --sim.duration-s.
        seed: Seed of the head motion and the sensor's noise.
        workers: Rendering processes.
        method: Method to map with, repeatable; as --map.methods.
    """
    from eval.runner import run_cases

    wanted = settings.load(
        common.config,
        sim=_with(sim, duration_s=seconds),
        map=_with(map, methods=method or None),
        score=score,
    )
    console = common.console()
    results = run_cases(
        case,
        out,
        wanted,
        rig,
        seed,
        force=common.force,
        workers=workers,
        progress=console.progress,
    )
    console.results(results, wanted.score.ranking_metric)
    console.wrote(out / "report.html")


@app.command
def simulate(
    scene: str,
    /,
    *,
    out: Path,
    rig: str | None = None,
    seconds: float | None = None,
    seed: int = 0,
    workers: int = 1,
    fresh: Annotated[bool, Parameter(negative=())] = False,
    common: Common = _COMMON,
    sim: SimFlags = _SIM_DEFAULT,
) -> None:
    """Render a scene and simulate its events, with exact depth and poses.

    Args:
        scene: Scene to simulate; see `eventsweep list`.
        out: Sequence folder to write.
        rig: Rig to use instead of the scene's own.
        seconds: Length of the sequence; as --sim.duration-s.
        seed: Seed of the head motion and the sensor's noise.
        workers: Rendering processes.
        fresh: Discard the unfinished work of an interrupted run instead of taking it up.
    """
    from eval.runner import simulate_scene

    wanted = settings.load(common.config, sim=_with(sim, duration_s=seconds))
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


@app.command
def map(  # noqa: A001 - the verb's name
    recording: Path,
    /,
    *,
    out: Path,
    method: Methods = (),
    common: Common = _COMMON,
    map: MapFlags = _MAP_DEFAULT,  # noqa: A002 - the name is the flag's prefix
) -> None:
    """Map a recording: depth, confidence and point cloud per method.

    Args:
        recording: A sequence of eventsweep, or a recording in its publisher's layout.
        out: Folder to write: map.json, report.html, and a folder per window and method.
        method: Method to map with, repeatable; as --map.methods.
    """
    from eval.runner import map_recording

    wanted = settings.load(common.config, map=_with(map, methods=method or None))
    console = common.console()
    stored = map_recording(
        recording, out, wanted, force=common.force, report=True, progress=console.progress
    )
    console.mapped(stored)
    console.wrote(out / "report.html")


@app.command
def score(
    folder: Path,
    /,
    *,
    common: Common = _COMMON,
    score: ScoreFlags = _SCORE_DEFAULT,
) -> None:
    """Score the maps of a run or of one mapped sequence against ground truth.

    Args:
        folder: What `run` or `map` wrote; results.json and results.csv in it are written anew.
    """
    from eval.runner import score_folder

    wanted = settings.load(common.config, score=score)
    console = common.console()
    results = score_folder(folder, wanted.score)
    console.results(results, wanted.score.ranking_metric)
    console.wrote(folder / "results.json")


@app.command
def report(folder: Path, /, *, common: Common = _COMMON) -> None:
    """Write report.html from the maps and results of a folder.

    Args:
        folder: What `run` or `map` wrote; report.html in it is written anew.
    """
    from eval.report import write_report

    console = common.console()
    console.wrote(write_report(folder))


@app.command(name="list")
def list_everything(*, common: Common = _COMMON) -> None:
    """List cases, rigs, methods and metrics."""
    from eval.inventory import inventory

    common.console().inventory(inventory())


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and ends the process: 0 on success, 2 on bad input, 130 when interrupted."""
    with exit_code() as code:
        try:
            app(arguments, exit_on_error=False, print_error=False)
        except CycloptsError as error:
            raise InputError(_one_line(error)) from error
    if arguments is None:
        sys.exit(code.value)
    return code.value


def _with(group: Any, **values: Any) -> Any:
    """A group with some values set, where they are not None."""
    given = {name: value for name, value in values.items() if value is not None}
    return group.model_copy(update=given)


def _one_line(error: CycloptsError) -> str:
    from pydantic import ValidationError

    cause = error.__cause__
    if isinstance(cause, ValidationError):
        return settings.explain(cause)
    text = " ".join(str(error).split())
    return f"{text} (`eventsweep --help` shows what there is)"


if __name__ == "__main__":
    main()
