"""Poses found from a recording's events: where they lie, and what scores call them."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory

TRACK = "track"
"""Names the poses in rows of scores, and marks the methods of maps on them."""
FOUND_FILE, FAILURE_FILE = "trajectory.txt", "failure.txt"


def method_on_own_poses(method: str) -> str:
    """What scores call a method that was given the poses that were found."""
    return f"{method} {TRACK}"


def is_on_own_poses(method: str) -> bool:
    """Whether rows of this method are about poses that were found, or maps on them."""
    return TRACK in method.split()


def found_poses(folder: Path) -> Trajectory | str:
    """The poses in a tracker's folder, or why it found none."""
    failure = folder / FAILURE_FILE
    if failure.is_file():
        return failure.read_text("utf-8").strip()
    return read_poses(folder / FOUND_FILE)


def write_failure(folder: Path, error: InputError) -> None:
    """Leaves in a tracker's folder why there are no poses: a failure counts, too."""
    folder.mkdir(exist_ok=True)
    (folder / FAILURE_FILE).write_text(f"{error}\n", encoding="utf-8")
