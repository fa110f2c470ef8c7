"""A recording whose next window is read, and brought to a GPU, while the present one is mapped."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.data.rig import Rig
from emvs.data.trajectory import Trajectory
from emvs.errors import InputError
from emvs.memory import check_window_fits
from emvs.window import Window

_Stretch = tuple[int, int]


class ReadAhead:
    """Reads windows ahead, in a thread of its own; to be used as a context.

    Attributes:
        recording: the one that is read.
    """

    def __init__(
        self, recording: Recording, received: Callable[[Events], Events], *, ahead: bool
    ) -> None:
        """Starts nothing yet.

        Args:
            recording: what to read.
            received: what is done with events as they are read, such as an upload.
            ahead: whether to read ahead at all; else everything is read when it is asked for.
        """
        self.recording, self._received, self._ahead = recording, received, ahead
        self._thread = ThreadPoolExecutor(1)
        self._coming: dict[_Stretch, Future[list[Events]]] = {}

    def __enter__(self) -> ReadAhead:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._thread.shutdown(cancel_futures=True)

    def start(self, window: Window) -> None:
        """Starts to read a window, once."""
        stretch = window.t0_us, window.t1_us
        if self._ahead and stretch not in self._coming:
            self._coming[stretch] = self._thread.submit(self._read, window)

    def drop(self, window: Window) -> None:
        """Lets go of a window."""
        self._coming.pop((window.t0_us, window.t1_us), None)

    def _read(self, window: Window) -> list[Events]:
        check_window_fits(self.recording, window)
        cameras = range(len(self.rig))
        return [
            self._received(self.recording.events(camera, window.t0_us, window.t1_us))
            for camera in cameras
        ]

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`, read ahead where that was started."""
        coming = self._coming.get((t0_us, t1_us))
        if coming is not None:
            try:
                return coming.result()[camera]
            except (InputError, MemoryError):
                # Two windows at a time may be too much; its own turn will tell.
                self._coming.pop((t0_us, t1_us), None)
        return self.recording.events(camera, t0_us, t1_us)

    @property
    def name(self) -> str:
        """What the recording is called."""
        return self.recording.name

    @property
    def rig(self) -> Rig:
        """Its cameras."""
        return self.recording.rig

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body` over time."""
        return self.recording.trajectory

    @property
    def depth_range_m(self) -> tuple[float, float] | None:
        """Nearest and farthest depth, where the recording knows it."""
        return self.recording.depth_range_m

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant of the recording."""
        return self.recording.event_span_us(camera)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """The image nearest to a time, if any."""
        return self.recording.frame(camera, t_us)
