"""A stage beside the second one: poses found from a sequence's events, and maps on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import MapInfo, RecordingInfo, read_map
from eventsweep.emvs.maps.sliding import one_window
from eventsweep.emvs.utils.plugins import TRACKERS, files_of, modules_of, points
from eventsweep.emvs.windows import Window
from eventsweep.eval.found_poses import found_poses, write_failure
from eventsweep.eval.jobs.job import SEQUENCE, Runtime
from eventsweep.eval.own_poses import map_on_poses
from eventsweep.eval.scoring.run_folder import MAP_FOLDER, TRACK_FOLDER, TRACKED_MAP_FOLDER
from eventsweep.eval.stages import map as mapping
from eventsweep.eval.trackers import tracker

STAGE = __name__


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The tracker's modules or package, and those of the methods of its maps."""
    offered = [point for point in points(TRACKERS) if point.name == parameters["tracker"]]
    settings = [window for windows in parameters["maps"].values() for window in windows.values()]
    reached = [mapping.code({"map": setting}) for setting in settings]
    modules = [*modules_of(offered), *(name for names, _ in reached for name in names)]
    files = [*files_of(offered), *(file for _, files in reached for file in files)]
    return tuple(dict.fromkeys(modules)), tuple(dict.fromkeys(files))


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, runtime: Runtime) -> None:
    """Tracks what the mapper is given, but for its poses; maps on them as `maps` says.

    A tracker that finds no poses is a result: the maps are empty then. In a run the second input is
    a map folder, whose windows are mapped again.
    """
    recording = mapping.as_perturbed(open_recording(inputs[0] / SEQUENCE), parameters)
    of_run = bool(parameters.get("of_run"))
    try:
        tracker(parameters["tracker"]).track(recording, out / TRACK_FOLDER, runtime, of_run)
    except InputError as error:
        write_failure(out / TRACK_FOLDER, error)
    poses = found_poses(out / TRACK_FOLDER)
    (out / TRACKED_MAP_FOLDER).mkdir()
    with runtime.display.stage(f"map {recording.name} on its own poses", 1) as update:
        for mapper, settings in parameters["maps"].items():
            configs = {
                name: MapperConfig.model_validate({**values, **runtime.threads()})
                for name, values in settings.items()
            }
            about = RecordingInfo(name=recording.name, path=SEQUENCE)
            if of_run:
                info = read_map(inputs[1] / MAP_FOLDER).info
                windows, about, first = windows_of(info), info.recording, info.config
            else:
                windows = {n: one_window(recording, c, out)[0] for n, c in configs.items()}
                first = next(iter(configs.values()))
            place = out / TRACKED_MAP_FOLDER / mapper
            map_on_poses(recording, poses, windows, first, place, about, clouds=of_run)
        update(1, "")


def windows_of(info: MapInfo) -> dict[str, Window]:
    """The windows of a map by name; what was lost before mapping is not said again."""
    lost = (0,) * len(info.windows[0].counts)
    return {w.name: Window(w.t0_us, w.t1_us, w.t_ref_us, lost) for w in info.windows}
