"""A recording with another calibration, other poses, other clocks, or its cameras swapped."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.occupied import Span, camera_spans
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import PoseSource, Trajectory


class AlteredRecording(DerivedRecording):
    """The same events with another calibration, poses or clocks; None or empty changes nothing.

    Args:
        recording: the one to alter.
        rig: another calibration.
        trajectory: other poses, for example a tracker's.
        clock_us: how much later the events of each camera are stamped, µs.
        streams: which camera's events each camera shows, for example (1, 0).
    """

    def __init__(
        self,
        recording: Recording,
        *,
        rig: Rig | None = None,
        trajectory: PoseSource | None = None,
        clock_us: Sequence[int] = (),
        streams: Sequence[int] = (),
    ) -> None:
        super().__init__(recording)
        self._rig, self._trajectory = rig, trajectory
        self._clock_us, self._streams = tuple(clock_us), tuple(streams)

    @property
    def rig(self) -> Rig:
        """The calibration as altered."""
        return self.recording.rig if self._rig is None else self._rig

    @property
    def trajectory(self) -> Trajectory:
        """The poses as altered, as far as they are known now."""
        return self.recording.trajectory if self._trajectory is None else self._trajectory.known()

    def occupied_us(self, camera: int) -> list[Span]:
        """First and last event of a camera's stretches without a long silence, µs."""
        late_us = self._late_us(camera)
        spans = camera_spans(self.recording, self._stream(camera))
        return [(first_us + late_us, last_us + late_us) for first_us, last_us in spans]

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us` on its altered clock."""
        late_us = self._late_us(camera)
        events = self.recording.events(self._stream(camera), t0_us - late_us, t1_us - late_us)
        return events.shifted(late_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) intensity image of what the camera shows nearest to a time, if any."""
        return self.recording.frame(self._stream(camera), t_us)

    def _late_us(self, camera: int) -> int:
        return self._clock_us[camera] if self._clock_us else 0

    def _stream(self, camera: int) -> int:
        return self._streams[camera] if self._streams else camera
