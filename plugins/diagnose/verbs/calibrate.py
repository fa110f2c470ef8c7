"""`eventsweep calibrate`: a recording's calibration, refined from its events and poses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.eval.cli.app import COMMON, Common, Force, command_line
from eventsweep.eval.cli.help import RARE

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.diagnose.calibrate.refine import Refinement


def calibrate(
    recording: Path,
    /,
    *,
    refine: str,
    out: Path,
    windows: Annotated[int, RARE] = 10,
    window_s: Annotated[float, RARE] = 0.2,
    events: Annotated[int, Parameter(name="--events"), RARE] = 30_000,
    min_depth_m: float | None = None,
    max_depth_m: float | None = None,
    threads: Annotated[int, RARE] = 0,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Refine a calibration from events and poses, without a calibration board.

    What the recording does not determine is refused, with the reason. The recording is not changed.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag or a recording.toml.
        refine: What to refine, joined by commas: stereo, delay, direction, baseline, focal,
            pose-delay, hand-eye, lever. With one camera, delay is the clock of the poses.
        out: Folder to write: the calibration, a recording.toml that uses it, report.html.
        windows: Most windows of the recording to use; more where they must be shorter.
        window_s: Length of each, s; shorter where the camera turns fast.
        events: Most events per camera and window.
        min_depth_m: Nearest depth, m; by default the recording's, else seen.
        max_depth_m: Farthest depth, m; by default the recording's, else seen.
        threads: CPU threads; 0 for all. They do not change the result.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.utils.outputs import check_output
    from eventsweep.plugins.diagnose.calibrate.refine import RefineConfig
    from eventsweep.plugins.diagnose.calibration import calibrate_recording, facts_of

    check_output(out, force=force)
    names = tuple(name.strip() for name in refine.split(",") if name.strip())
    config = RefineConfig(names, windows, window_s, events, min_depth_m, max_depth_m, threads)
    console = common.console()
    refinement, notes = calibrate_recording(
        open_recording(recording), recording, out, config, console.progress, force=force,
        command=command_line(),
    )  # fmt: skip
    console.result(facts_of(refinement, notes), _estimates(refinement))
    for note in notes:
        console.warn(note)
    console.wrote(out / "report.html")


def _estimates(refinement: Refinement) -> Iterator[Part]:
    from eventsweep.eval.cli.console import dim, table

    rows = (
        (
            estimate.parameter.name,
            "refused" if estimate.refused else f"{estimate.value:+.3f}",
            f"{estimate.uncertainty:.3f}",
            estimate.parameter.unit,
        )
        for estimate in refinement.estimates
    )
    yield table("calibration", ("parameter", ">correction", ">95 % ±", ">unit"), rows)
    for estimate in refinement.estimates:
        if estimate.refused:
            yield dim(f"{estimate.parameter.name} stays as given: {estimate.refused}")
