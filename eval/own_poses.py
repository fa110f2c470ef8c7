"""Maps on poses found from a recording's events, beside those on its own poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import RecordingInfo, SkippedWindow, write_index
from eventsweep.emvs.maps.sliding import find_hot, map_into, without
from eventsweep.emvs.windows import Window, check_poses


def map_on_poses(
    recording: Recording, poses: Trajectory | str, windows: Mapping[str, Window],
    config: MapperConfig, out: Path, about: RecordingInfo, *, clouds: bool = True,
) -> None:  # fmt: skip
    """Maps windows on other poses, as far as these cover them, and writes the map folder `out`.

    Reference views keep their times. A window without a pose at that time is skipped.

    Args:
        recording: events and calibration.
        poses: `T_world_body`, or why there are none.
        windows: those that the recording's own poses are mapped in, by name.
        config: methods, planes, thresholds.
        out: a new folder, in one that the caller writes atomically.
        about: what `map.json` says of the recording.
        clouds: whether to write point clouds.
    """
    first_us = min(window.t0_us for window in windows.values())
    last_us = max(window.t1_us for window in windows.values())
    hot = find_hot(recording, config, first_us, last_us)
    mapped, skipped = [], []
    out.mkdir()
    for name, window in windows.items():
        try:
            posed, covered = _posed(without(recording, hot), poses, window, config)
        except InputError as error:
            skipped.append(
                SkippedWindow(name=name, t0_us=window.t0_us, t1_us=window.t1_us, reason=str(error))
            )
            continue
        mapped.append(map_into(out / name, posed, config, covered, clouds=clouds))
    write_index(out, about, config, mapped, skipped=skipped)


def _posed(
    recording: Recording, poses: Trajectory | str, window: Window, config: MapperConfig
) -> tuple[Recording, Window]:
    """The recording with the poses, and what these cover of a window."""
    if isinstance(poses, str):
        raise InputError(poses)
    first_us, last_us = poses.span_us
    if not first_us <= window.t_ref_us <= last_us:
        raise InputError(
            f"no pose at the reference time, {window.t_ref_us} µs: poses reach from {first_us} to "
            f"{last_us} µs"
        )
    covered = replace(
        window, t0_us=max(window.t0_us, first_us), t1_us=min(window.t1_us, last_us + 1)
    )
    check_poses(poses, covered.t0_us, covered.t1_us, config)
    return AlteredRecording(recording, trajectory=poses), covered
