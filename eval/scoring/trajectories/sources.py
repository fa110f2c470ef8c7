"""Where trajectories to score come from: TUM files, folders of a tracker, poses of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError, located, repeated
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.inputs import inside
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.scoring.predictions import plain
from eventsweep.eval.scoring.trajectories.score import TrajectoryScore, score_poses

TRAJECTORY_FILE = "trajectory.txt"
"""Of a tracker's folder."""


class Source(NamedTuple):
    """A trajectory: what scores call it, the file or folder, and its poses."""

    name: str
    path: Path
    trajectory: Trajectory


def read_estimate(asked: str | Path, config: TrajectoryConfig) -> Source:
    """Reads `FILE`, `FOLDER` or `NAME=FILE`; a folder holds `trajectory.txt`.

    Raises:
        InputError: no such file, a folder without one, or poses that cannot be used.
    """
    name, equals, place = str(asked).partition("=")
    if isinstance(asked, Path) or not equals or "/" in name or Path(asked).exists():
        name, place = "", str(asked)
    elif not name.strip() or not place:
        raise InputError(f"estimate {asked!r}: needs NAME=FILE or FILE")
    path = Path(place)
    file = path
    if path.is_dir():
        file = inside(path, TRAJECTORY_FILE)
        if not file.is_file():
            raise InputError(
                f"{path}: a folder without {TRAJECTORY_FILE}; needs a file of poses, or what a "
                "tracker wrote"
            )
    found = path.resolve()
    default = found.name if path.is_dir() else found.stem
    return Source(plain(name.strip() or default), path, read_poses(file, _stated(config, "unit")))


def read_truth(path: str | Path, config: TrajectoryConfig) -> Source:
    """Reads true poses: a file of them, or those of a recording's folder.

    Raises:
        InputError: no such file or recording, or poses that cannot be used.
    """
    path = Path(path)
    if path.is_dir() or path.suffix in (".toml", ".bag", ".mcap", ".db3"):
        recording = open_recording(path)
        try:
            return Source(recording.name, path, recording.trajectory)
        except InputError as error:  # its cure, poses that were found, are no true ones
            raise InputError(
                f"{path}: has no true poses: name a file of them, or a recording that has some"
            ) from error
    try:
        poses = read_poses(path, _stated(config, "truth_unit"))
        return Source(plain(path.resolve().stem), path, poses)
    except InputError as error:
        raise InputError(str(error).replace("set unit to", "set truth_unit to")) from error


def _stated(config: TrajectoryConfig, name: str) -> str:
    """A unit that somebody set; empty where a header may say another than the default."""
    return str(getattr(config, name)) if name in config.model_fields_set else ""


def score_sources(
    estimates: Sequence[Source], truth: Source, config: TrajectoryConfig
) -> dict[str, TrajectoryScore]:
    """Scores estimates by name.

    Raises:
        InputError: two of one name, or what `score_poses` refuses; says of which file.
    """
    twice = repeated([estimate.name for estimate in estimates])
    if twice is not None:
        raise InputError(f"two estimates are called {twice}: give them names as in NAME=FILE")
    scored = {}
    for estimate in estimates:
        with located(estimate.path):
            scored[estimate.name] = score_poses(truth.trajectory, estimate.trajectory, config)
    return scored
