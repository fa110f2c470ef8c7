"""`eventsweep track`: poses of a recording from its events alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from eventsweep.eval.cli.app import COMMON, Common, Force, command_line
from eventsweep.eval.cli.view_flags import VIEW_FLAGS, ViewFlags
from eventsweep.plugins.track.odometry.config import TrackConfig

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from eventsweep.emvs.depth.depth_map import DepthMap
    from eventsweep.plugins.track.scored import Judged

TrackFlags = Annotated[TrackConfig, Parameter(name="*", group=Group("Tracking parameters"))]
_DEFAULT = TrackConfig()
_MOST_UNCERTAIN = 0.1  # of the poses


def track(
    recording: Path,
    /,
    *,
    out: Path,
    first_map: Path | None = None,
    start: Path | None = None,
    truth: Path | None = None,
    view_flags: ViewFlags = VIEW_FLAGS,
    force: Force = False,
    common: Common = COMMON,
    config: TrackFlags = _DEFAULT,
) -> int:
    """Find the poses of a recording from its events and calibration alone.

    The tracker does not see the recording's own poses; they score the track afterwards. Exit code
    1 means that the track ended lost or uncertain, or that over a tenth of its poses are uncertain.
    After an interrupt or a kill the same command continues.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag or a recording.toml.
        out: Folder to write: trajectory.txt (TUM), covariances.txt, track.json, cloud.ply,
            report.html.
        first_map: Map folder whose first window shows the start of the recording; required with one
            camera.
        start: Poses in TUM format; the track starts at the first of them.
        truth: True poses of the same body to score the track against, a TUM file or a recording's
            folder; by default the recording's own.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.utils.outputs import check_output
    from eventsweep.plugins.track.folder import track_recording
    from eventsweep.plugins.track.odometry.pose import Status
    from eventsweep.plugins.track.page import maps_words
    from eventsweep.plugins.track.scored import true_poses

    check_output(out, force=force)
    console = common.console()
    opened = open_recording(recording)
    true = true_poses(opened, recording, truth)
    axes = "RDF" if start is None else "RIGHT_HAND_Z_UP"
    with view_flags.opened(out.resolve().name, force=force, axes=axes) as view:
        tracked, facts, score = track_recording(
            opened, recording, out, config, console.progress, first_map=_depth_map(first_map),
            T_world_body=_first_pose(start), truth=true, force=force, view=view,
            command=command_line(),
        )  # fmt: skip
    doubts = Status.LOST, Status.UNCERTAIN
    doubted = [change for change in tracked.changes if change.status in doubts]
    lines = [
        f"{facts['poses']:,} poses over a path of {facts['way_m']:.3f} m, "
        f"{100 * tracked.covered:.1f} % of the time covered, {maps_words(tracked)}",
    ]
    if tracked.silent_us:
        lines.append(
            f"no event for {tracked.silent_us / 1e6:,.6g} s of the time, in long silences: the "
            "clock jumps, or these are several takes"
        )
    first_us = tracked.span_us[0]
    lines += [
        f"{each.status.value} at {(each.t_us - first_us) / 1e6:.3f} s: {each.reason}"
        for each in doubted
    ]
    console.result({"track": str(out), **facts}, [*lines, *_scored(score, out)])
    console.wrote(out / "report.html")
    uncertain = facts["poses_by_status"][Status.UNCERTAIN.value]
    return int(tracked.changes[-1].status in doubts or uncertain > _MOST_UNCERTAIN * facts["poses"])


def _scored(score: Judged | None, out: Path) -> list[str]:
    """What a terminal shows of the scores, and how to have others."""
    if score is None:
        return []
    if score.truth is None:
        return [f"{line}; give --truth FILE, or score {out} later" for line in score.lines()]
    again = f"eventsweep score {out} --truth {score.truth.path} --out scored"
    return [*score.lines(), f"other pairs, alignments or offsets: {again} [--associate ...]"]


def _depth_map(folder: Path | None) -> DepthMap | None:
    if folder is None:
        return None
    from eventsweep.emvs.errors import InputError
    from eventsweep.emvs.maps.folder import read_map

    windows = read_map(folder).windows
    if not windows:
        raise InputError(f"{folder}: contains no window: map the first part of the recording")
    return windows[0].depth_map(windows[0].info.methods[0])


def _first_pose(path: Path | None) -> NDArray[np.float64] | None:
    if path is None:
        return None
    from eventsweep.emvs.data.poses import read_poses
    from eventsweep.emvs.datasets.posed import CONVERTED, unit_stated

    with unit_stated(CONVERTED):
        poses = read_poses(path)
    return poses.at(poses.t_us[0])
