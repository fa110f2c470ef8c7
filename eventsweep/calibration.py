"""Calibration for users of the library: all that `eventsweep calibrate` does, but for the page."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.calibrate.refine import RefineConfig, Refinement, refine
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import opened
from eventsweep.emvs.errors import check_path
from eventsweep.emvs.utils.runtime import Progress, silent


def calibrate(
    recording: Recording | str | Path,
    config: RefineConfig | None = None,
    *,
    out: str | Path | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Refinement:
    """Refines a recording's calibration from its events and poses.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one.
        config: what to refine, and from how many windows; by default stereo rotation and clock.
        out: a folder for the calibration and a `recording.toml` that uses it; by default none.
        force: whether to replace what an earlier call wrote there.
        progress: called with the name of the stage, how much is done and how much there is.

    Returns:
        Corrections with their uncertainties; `applied(recording)` is the refined recording.

    Raises:
        InputError: no poses, nothing to refine, a rig of one camera where two are needed, too short
            a recording, or an output that exists.
    """
    from eventsweep.emvs.calibrate.folder import write_refined
    from eventsweep.emvs.utils.outputs import atomic_dir, check_output

    given = opened(recording)
    inputs = (recording,) if isinstance(recording, str | Path) else ()
    if out is not None:
        check_path("out", out)
        check_output(Path(out), force=force, inputs=inputs)
    refinement = refine(given, config, progress)
    if out is not None:
        with atomic_dir(Path(out), force=force, inputs=inputs) as folder:
            write_refined(folder, Path(out), given, refinement)
    return refinement
