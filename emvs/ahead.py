"""A recording whose next window is read, and brought to a GPU, while the present one is mapped."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType

from emvs.data.events import Events
from emvs.data.recording import DerivedRecording, Recording
from emvs.errors import InputError
from emvs.memory import check_window_fits
from emvs.window import Window

_Stretch = tuple[int, int]


class ReadAhead(DerivedRecording):
    """Reads windows ahead, in a thread of its own; to be used as a context."""

    def __init__(
        self, recording: Recording, received: Callable[[Events], Events], *, ahead: bool
    ) -> None:
        """Starts nothing yet.

        Args:
            recording: what to read.
            received: what is done with events as they are read, such as an upload.
            ahead: whether to read ahead at all; else everything is read when it is asked for.
        """
        super().__init__(recording)
        self._received, self._ahead = received, ahead
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
