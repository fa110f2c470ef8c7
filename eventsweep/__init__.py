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
    from emvs.calibrate.refine import RefineConfig, Refinement
    from emvs.check.findings import Finding
    from emvs.check.findings import Report as CheckReport
    from emvs.config import MapperConfig
    from emvs.data.events import Events
    from emvs.data.recording import Recording
    from emvs.data.sequence import Sequence
    from emvs.datasets import open_recording
    from emvs.datasets.training import TrainingWindows
    from emvs.depth.depth_map import DepthMap
    from emvs.dsi.method import Method
    from emvs.errors import InputError
    from emvs.geometry.camera import Camera
    from emvs.geometry.rig import Rig
    from emvs.geometry.trajectory import Trajectory
    from emvs.methods import overview as methods
    from emvs.methods import register as register_method
    from emvs.window_result import WindowResult
    from eval.config import EvalConfig
    from eval.scoring.method_scores import ALL_METRICS as METRICS
    from eval.scoring.results import Results
    from eventsweep.calibration import calibrate
    from eventsweep.mapping import check, map_window, map_windows
    from eventsweep.scoring import score
    from eventsweep.simulation import simulate, video_to_events
    from scenes import load as load_scene
    from scenes import names as scenes
    from sim.config import ModelConfig, PixelConfig, SimConfig, VideoConfig
    from sim.event_camera import EventCamera, EventRig
    from sim.sensor.esim import EventSimulator
    from sim.video.record import RecordedVideo

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
    "scenes",
    "score",
    "simulate",
    "video_to_events",
]

# The name -> where it is.
_PLACES = {
    "METRICS": "eval.scoring.method_scores:ALL_METRICS",
    "Camera": "emvs.geometry.camera:Camera",
    "CheckReport": "emvs.check.findings:Report",
    "DepthMap": "emvs.depth.depth_map:DepthMap",
    "EvalConfig": "eval.config:EvalConfig",
    "EventCamera": "sim.event_camera:EventCamera",
    "EventRig": "sim.event_camera:EventRig",
    "EventSimulator": "sim.sensor.esim:EventSimulator",
    "Events": "emvs.data.events:Events",
    "Finding": "emvs.check.findings:Finding",
    "InputError": "emvs.errors:InputError",
    "MapperConfig": "emvs.config:MapperConfig",
    "ModelConfig": "sim.config:ModelConfig",
    "Method": "emvs.dsi.method:Method",
    "PixelConfig": "sim.config:PixelConfig",
    "RecordedVideo": "sim.video.record:RecordedVideo",
    "Recording": "emvs.data.recording:Recording",
    "RefineConfig": "emvs.calibrate.refine:RefineConfig",
    "Refinement": "emvs.calibrate.refine:Refinement",
    "Results": "eval.scoring.results:Results",
    "Rig": "emvs.geometry.rig:Rig",
    "Sequence": "emvs.data.sequence:Sequence",
    "SimConfig": "sim.config:SimConfig",
    "TrainingWindows": "emvs.datasets.training:TrainingWindows",
    "Trajectory": "emvs.geometry.trajectory:Trajectory",
    "VideoConfig": "sim.config:VideoConfig",
    "WindowResult": "emvs.window_result:WindowResult",
    "calibrate": "eventsweep.calibration:calibrate",
    "check": "eventsweep.mapping:check",
    "load_scene": "scenes:load",
    "map_window": "eventsweep.mapping:map_window",
    "map_windows": "eventsweep.mapping:map_windows",
    "methods": "emvs.methods:overview",
    "open_recording": "emvs.datasets:open_recording",
    "register_method": "emvs.methods:register",
    "scenes": "scenes:names",
    "score": "eventsweep.scoring:score",
    "simulate": "eventsweep.simulation:simulate",
    "video_to_events": "eventsweep.simulation:video_to_events",
}


if not TYPE_CHECKING:  # with it, a type checker would take any name for granted

    def __getattr__(name: str) -> object:
        """Imports what a name stands for.

        Raises:
            AttributeError: there is no such name.
            ImportError: a folder of the user's hides a package of ours.
        """
        if name == "__version__":
            from importlib.metadata import version

            return version(__name__)
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        from eventsweep.installation import refuse_hidden

        module, attribute = _PLACES[name].split(":")
        refuse_hidden(module)
        value: object = getattr(import_module(module), attribute)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """The public names, whether they were asked for already or not."""
    return list(__all__)
