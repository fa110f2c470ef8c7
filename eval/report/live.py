"""Work in progress in the Rerun viewer: frames, events, DSI slices, depth and the trajectory.

Needs the package `rerun-sdk`, the extra `rerun`. Times are the recording's.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError, one_line
from eventsweep.emvs.maps.folder import read_map
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.window_result import WindowResult
from eventsweep.eval.figures.colormaps import events_scale
from eventsweep.eval.figures.images import events_image
from eventsweep.eval.pipeline import Watch
from eventsweep.eval.report.rerun import Log, library, log_window

_STEP_US, _MOST_STEPS = 33_333, 200
_MOST_PLACES = 2000  # of a path that is drawn


class View(Watch):
    """A viewer that is fed while work goes on.

    Entities are those of `write_rerun`, and `CASE/sensor`: camera 0 with its `frame` and `events`,
    and `CASE/path`, the way of the body so far.
    """

    def __init__(self, viewer: Any, stream: Any) -> None:
        self._viewer, self._stream = viewer, stream
        self._recordings: dict[str, Recording] = {}
        self._paths: dict[str, list[NDArray[np.float64]]] = {}
        self._frame = np.empty((0, 0), np.uint8)

    def sequence(self, case: str, folder: Path) -> None:
        """Shows what camera 0 saw, where it was, in at most 200 steps."""
        recording = self._recordings[case] = open_recording(folder)
        first_us, last_us = recording.event_span_us(0)
        step_us = max(_STEP_US, -(-(last_us + 1 - first_us) // _MOST_STEPS))
        trajectory = recording.trajectory
        for t_us in range(first_us, last_us + 1, step_us):
            end_us = min(t_us + step_us, last_us + 1)
            inside_us = int(np.clip(end_us - 1, *trajectory.span_us))
            self.body(case, recording, end_us, trajectory.at([inside_us])[0])
            self.events(case, recording, t_us, end_us)
        self._stream.flush()

    def maps(self, case: str, folder: Path) -> None:
        """Shows every window of a map folder."""
        stored, log = read_map(folder), self._log(case)
        for window in stored.windows:
            log_window(log, stored, window, self._recordings.get(case))
        self._stream.flush()

    def body(
        self, case: str, recording: Recording, t_us: int, T_world_body: NDArray[np.float64]
    ) -> None:
        """Shows where the body is at a time, and its path up to there."""
        log, path = self._log(case), self._paths.setdefault(case, [])
        log.at(t_us)
        log.camera("sensor", recording.rig.cameras[0], T_world_body @ recording.rig.T_body_cam[0])
        path.append(T_world_body[:3, 3])
        places = np.stack(path[:: -(-len(path) // _MOST_PLACES)])
        log("path", self._viewer.LineStrips3D([places]))

    def events(self, case: str, recording: Recording, t0_us: int, t1_us: int) -> None:
        """Shows the events of camera 0 with `t0_us <= t < t1_us`, and the frame there, if any."""
        log, camera = self._log(case), recording.rig.cameras[0]
        log.at(t1_us)
        events = recording.events(0, t0_us, t1_us)
        counts = np.zeros((2, camera.height_px, camera.width_px), np.uint32)
        np.add.at(counts, (events.p, events.y, events.x), 1)
        drawn = events_image(counts[1], counts[0], events_scale(2)).rgba()
        log("sensor/events", self._viewer.Image(drawn))
        frame = recording.frame(0, t1_us)
        if frame is not None and not (
            self._frame is not None and np.array_equal(frame, self._frame)
        ):
            log("sensor/frame", self._viewer.Image(frame, color_model="L"))
            self._frame = frame

    def window(self, case: str, result: WindowResult) -> None:
        """Shows a window as it was mapped."""
        log = self._log(case)
        log.at(result.window.t_ref_us)
        for depth_map in result.depth_maps.values():
            log.camera("camera", depth_map.camera, depth_map.T_world_rv)
            log.depth_map(depth_map, result.config)
        log.slices(result.slices)

    def _log(self, case: str) -> Log:
        return Log(self._viewer, self._stream, case)


@contextmanager
def live_view(name: str, file: Path | None = None, axes: str = "RIGHT_HAND_Z_UP") -> Iterator[View]:
    """Opens the Rerun viewer, or writes what it would show into a file, whole or not at all.

    Args:
        name: of the recording in the viewer.
        file: such as `live.rrd`; by default a window opens.
        axes: of the world, one of `rerun.ViewCoordinates`.

    Raises:
        InputError: no `rerun-sdk`, no display for a window, or a viewer that does not start.
    """
    viewer = library()
    if file is None:
        check_display(os.environ)
    with ExitStack() as stack:
        stream = viewer.RecordingStream("eventsweep", recording_id=name)
        if file is None:
            _spawn(stream)
        else:
            stream.save(stack.enter_context(atomic_path(file)))
        stream.log("/", getattr(viewer.ViewCoordinates, axes), static=True)
        try:
            yield View(viewer, stream)
        finally:
            stream.flush()
            stream.disconnect()


def check_display(environment: Mapping[str, str]) -> None:
    """Refuses to open a window where there is no display."""
    has_display = any(environment.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not has_display:
        raise InputError(
            "no display to open the Rerun viewer on (DISPLAY and WAYLAND_DISPLAY are not set): "
            "set view_file to 'live.rrd' instead, and open that file elsewhere with rerun"
        )


def _spawn(stream: Any) -> None:
    try:
        stream.spawn(hide_welcome_screen=True)
    except (RuntimeError, OSError) as error:
        raise InputError(f"the Rerun viewer did not start: {one_line(str(error))}") from error
