"""From events to rays on the GPU: events and poses go up, and nothing comes down but counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.dsi.backprojection import Between
from eventsweep.emvs.dsi.rays import RayCounts, knots, voters
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.preflight import check_window_fits
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.windows import Window
from eventsweep.plugins.cuda import arrays, device, rays_kernels
from eventsweep.plugins.cuda.arrays import DeviceEvents, DeviceRays


class CudaCaster:
    """Casts rays of one camera on the GPU; the twin of `emvs.dsi.backprojection.CpuCaster`."""

    def __init__(
        self, recording: Recording, view: ReferenceView, camera: int, *, packets: bool
    ) -> None:
        self.packets = packets
        self._camera = recording.rig.cameras[camera]
        poses = knots(recording.trajectory, view.T_world_rv)
        T_body_cam = recording.rig.T_body_cam[camera]
        self._poses: tuple[Any, ...] = tuple(map(arrays.up, (*poses, T_body_cam, view.camera.K)))

    def __call__(self, events: Events) -> DeviceRays:
        """Casts every event's ray into the reference view (paper, Alg. 1, line 3).

        Raises:
            InputError: an event outside the sensor, or events not sorted.
        """
        if self.packets:  # with poses of its own, which say nothing of the events' order
            events.checked(self._camera.width_px, self._camera.height_px)
        chosen, pose_us = voters(events, packets=self.packets)
        if not len(chosen):
            return DeviceRays((), RayCounts(len(events), dropped=len(events)))
        x, y, t_us = DeviceEvents.of(chosen).there
        when = arrays.up(pose_us) if self.packets else t_us
        out = arrays.empty((5, len(chosen)), np.float32)
        slots = arrays.fill(arrays.empty((rays_kernels.OUTCOMES, device.SLOTS), np.int64), 0)
        rays_kernels.rays[device.each(len(chosen))](
            x, y, when, _bearings(self._camera), *self._poses, out, slots
        )
        tally = arrays.down(slots).sum(axis=1)
        if tally[rays_kernels.WRONG]:
            events.checked(self._camera.width_px, self._camera.height_px)
        return DeviceRays((out,), RayCounts.tallied(len(events), len(chosen), tally))

    def joined(self, pieces: Sequence[DeviceRays]) -> Between:
        """Rays that this caster cast, to be cut between them; nothing is copied."""
        return lambda first, last: DeviceRays.joined(pieces[first:last])


class CudaProjector:
    """The twin of `emvs.dsi.backprojection.CpuProjector` on a GPU."""

    caster = CudaCaster

    @contextmanager
    def reading(self, recording: Recording, windows: Sequence[Window]) -> Iterator[Recording]:
        """The recording, whose next window is read and uploaded while one is mapped."""
        with ThreadPoolExecutor(1) as thread:
            try:
                yield _ReadAhead(recording, windows, thread)
            finally:
                thread.shutdown(cancel_futures=True)

    def received(self, events: Events) -> Events:
        """The events, on the GPU."""
        return DeviceEvents.of(events)

    def event_image(self, events: Events, width_px: int, height_px: int) -> NDArray[np.uint32]:
        """Events per pixel, (2, H, W): polarity 0, polarity 1."""
        image = arrays.up(np.zeros((2, height_px, width_px), np.int32))
        if len(events):
            x, y, _ = DeviceEvents.of(events).there
            p = arrays.up(events.p)
            rays_kernels.count_events[device.each(len(events))](x, y, p, image)
        return arrays.down(image).astype(np.uint32)


@lru_cache(maxsize=8)
def _bearings(camera: Camera) -> Any:
    """A camera's table of bearings on the GPU, where it stays for the windows that follow."""
    return arrays.up(camera.bearing_table())


class _ReadAhead(DerivedRecording):
    """Reads windows ahead, in a thread of its own, when their events are asked for in turn."""

    def __init__(
        self, recording: Recording, windows: Sequence[Window], thread: ThreadPoolExecutor
    ) -> None:
        super().__init__(recording)
        self._thread = thread
        self._number = {(w.t0_us, w.t1_us): k for k, w in enumerate(windows)}
        self._windows = windows
        self._coming: dict[int, Future[list[DeviceEvents]]] = {}

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`, read ahead where that was started."""
        k = self._number.get((t0_us, t1_us))
        if k is None:
            return self.recording.events(camera, t0_us, t1_us)
        self._coming = {i: self._coming.get(i) or self._start(i) for i in self._near(k)}
        try:
            return self._coming[k].result()[camera]
        except (InputError, MemoryError):
            # Two windows at a time may be too much; its own turn will tell.
            return self.recording.events(camera, t0_us, t1_us)

    def _near(self, k: int) -> range:
        return range(k, min(k + 2, len(self._windows)))

    def _start(self, k: int) -> Future[list[DeviceEvents]]:
        return self._thread.submit(self._read, self._windows[k])

    def _read(self, window: Window) -> list[DeviceEvents]:
        check_window_fits(self.recording, window)
        read = (
            self.recording.events(camera, window.t0_us, window.t1_us)
            for camera in range(len(self.rig))
        )
        return [DeviceEvents.of(events) for events in read]
