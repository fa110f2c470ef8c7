"""A stage beside the second one: poses found from a sequence's events, and maps on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import RecordingInfo
from eventsweep.emvs.maps.sliding import one_window
from eventsweep.eval.found_poses import FOUND_FILE, found_poses, write_failure
from eventsweep.eval.jobs.job import SEQUENCE
from eventsweep.eval.own_poses import map_on_poses
from eventsweep.eval.suite.stages import map as mapping
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.recorded import track


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The packages of others that its methods come from, and the weights and tables it reads."""
    settings = [values for windows in parameters["maps"].values() for values in windows.values()]
    files = [file for values in settings for file in mapping.code({"map": values})[1]]
    return (), tuple(dict.fromkeys(files))


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Tracks what the mapper is given, but for its poses; `maps` are settings by mapper and window.

    A tracker that finds no poses is a result: the maps are empty then.
    """
    recording = mapping.as_perturbed(open_recording(inputs[0] / SEQUENCE), parameters)
    try:
        tracked = track(recording, TrackConfig(**parameters["track"], threads=1))
        write_tum(out / FOUND_FILE, tracked.trajectory)
    except InputError as error:
        write_failure(out, error)
    for mapper, windows in parameters["maps"].items():
        _map(recording, windows, out, mapper)


def _map(recording: Recording, windows: Mapping[str, Any], out: Path, mapper: str) -> None:
    configs = {
        name: MapperConfig.model_validate({**settings, "threads": 1})
        for name, settings in windows.items()
    }
    planned = {name: one_window(recording, config, out)[0] for name, config in configs.items()}
    about = RecordingInfo(name=recording.name, path=SEQUENCE)
    first = next(iter(configs.values()))
    map_on_poses(recording, found_poses(out), planned, first, out / mapper, about, clouds=False)
