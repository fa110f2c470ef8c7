"""Simulate, map and score event-based multi-view stereo: the names for users of the library.

    import eventsweep as es

    recording = es.open_recording("out/desk/sequence")
    result = es.map_window(recording, es.MapperConfig(methods=("Alg1/H",)))
    print(es.score(result, recording))

Everything is imported when it is first asked for: importing this package costs nothing. Paths may
be strings everywhere, and bad input raises `InputError` with one line.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eventsweep.calibration import calibrate
    from eventsweep.emvs.calibrate.refine import RefineConfig, Refinement
    from eventsweep.emvs.check.findings import Finding
    from eventsweep.emvs.check.findings import Report as CheckReport
    from eventsweep.emvs.config import MapperConfig
    from eventsweep.emvs.data.events import Events
    from eventsweep.emvs.data.recording import Recording
    from eventsweep.emvs.data.sequence import Sequence
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.datasets.training import TrainingWindows
    from eventsweep.emvs.depth.depth_map import DepthMap
    from eventsweep.emvs.errors import InputError
    from eventsweep.emvs.geometry.camera import Camera
    from eventsweep.emvs.geometry.rig import Rig
    from eventsweep.emvs.geometry.trajectory import Trajectory
    from eventsweep.emvs.methods import overview as methods
    from eventsweep.emvs.methods import register as register_method
    from eventsweep.emvs.methods.method import Extraction, Method
    from eventsweep.emvs.window_result import WindowResult
    from eventsweep.eval.config import EvalConfig
    from eventsweep.eval.scoring.method_scores import ALL_METRICS as METRICS
    from eventsweep.eval.scoring.results import Results
    from eventsweep.mapping import check, map_window, map_windows
    from eventsweep.scenes import load as load_scene
    from eventsweep.scenes import names as scene_names
    from eventsweep.scoring import score
    from eventsweep.sim.config import ModelConfig, PixelConfig, SimConfig, VideoConfig
    from eventsweep.sim.event_camera import EventCamera, EventRig
    from eventsweep.sim.sensor.esim import EventSimulator
    from eventsweep.sim.video.record import RecordedVideo
    from eventsweep.simulation import simulate, video_to_events

    __version__: str

__all__ = [
    "METRICS",
    "Camera",
    "CheckReport",
    "DepthMap",
    "EvalConfig",
    "EventCamera",
    "EventRig",
    "EventSimulator",
    "Events",
    "Extraction",
    "Finding",
    "InputError",
    "MapperConfig",
    "Method",
    "ModelConfig",
    "PixelConfig",
    "RecordedVideo",
    "Recording",
    "RefineConfig",
    "Refinement",
    "Results",
    "Rig",
    "Sequence",
    "SimConfig",
    "TrainingWindows",
    "Trajectory",
    "VideoConfig",
    "WindowResult",
    "__version__",
    "calibrate",
    "check",
    "load_scene",
    "map_window",
    "map_windows",
    "methods",
    "open_recording",
    "register_method",
    "scene_names",
    "score",
    "simulate",
    "video_to_events",
]

# The name -> where it is.
_PLACES = {
    "METRICS": "eventsweep.eval.scoring.method_scores:ALL_METRICS",
    "Camera": "eventsweep.emvs.geometry.camera:Camera",
    "CheckReport": "eventsweep.emvs.check.findings:Report",
    "DepthMap": "eventsweep.emvs.depth.depth_map:DepthMap",
    "EvalConfig": "eventsweep.eval.config:EvalConfig",
    "EventCamera": "eventsweep.sim.event_camera:EventCamera",
    "EventRig": "eventsweep.sim.event_camera:EventRig",
    "EventSimulator": "eventsweep.sim.sensor.esim:EventSimulator",
    "Events": "eventsweep.emvs.data.events:Events",
    "Extraction": "eventsweep.emvs.methods.method:Extraction",
    "Finding": "eventsweep.emvs.check.findings:Finding",
    "InputError": "eventsweep.emvs.errors:InputError",
    "MapperConfig": "eventsweep.emvs.config:MapperConfig",
    "ModelConfig": "eventsweep.sim.config:ModelConfig",
    "Method": "eventsweep.emvs.methods.method:Method",
    "PixelConfig": "eventsweep.sim.config:PixelConfig",
    "RecordedVideo": "eventsweep.sim.video.record:RecordedVideo",
    "Recording": "eventsweep.emvs.data.recording:Recording",
    "RefineConfig": "eventsweep.emvs.calibrate.refine:RefineConfig",
    "Refinement": "eventsweep.emvs.calibrate.refine:Refinement",
    "Results": "eventsweep.eval.scoring.results:Results",
    "Rig": "eventsweep.emvs.geometry.rig:Rig",
    "Sequence": "eventsweep.emvs.data.sequence:Sequence",
    "SimConfig": "eventsweep.sim.config:SimConfig",
    "TrainingWindows": "eventsweep.emvs.datasets.training:TrainingWindows",
    "Trajectory": "eventsweep.emvs.geometry.trajectory:Trajectory",
    "VideoConfig": "eventsweep.sim.config:VideoConfig",
    "WindowResult": "eventsweep.emvs.window_result:WindowResult",
    "calibrate": "eventsweep.calibration:calibrate",
    "check": "eventsweep.mapping:check",
    "load_scene": "eventsweep.scenes:load",
    "map_window": "eventsweep.mapping:map_window",
    "map_windows": "eventsweep.mapping:map_windows",
    "methods": "eventsweep.emvs.methods:overview",
    "open_recording": "eventsweep.emvs.datasets:open_recording",
    "register_method": "eventsweep.emvs.methods:register",
    "scene_names": "eventsweep.scenes:names",
    "score": "eventsweep.scoring:score",
    "simulate": "eventsweep.simulation:simulate",
    "video_to_events": "eventsweep.simulation:video_to_events",
}


if not TYPE_CHECKING:  # with it, a type checker would take any name for granted

    def __getattr__(name: str) -> object:
        """Imports what a name stands for.

        Raises:
            AttributeError: there is no such name.
        """
        if name == "__version__":
            from importlib.metadata import version

            return version(__name__)
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        module, attribute = _PLACES[name].split(":")
        value: object = getattr(import_module(module), attribute)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """The public names, whether they were asked for already or not."""
    return list(__all__)
