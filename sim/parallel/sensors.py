"""The sensors of a rig, at work while the next pictures are drawn."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from sim.ground_truth import event_depth_m
from sim.parallel.checkpoint import State
from sim.parallel.render_job import RenderedFrame, RenderJob
from sim.sensor.sensor import Sensor, part_of


class Packet(NamedTuple):
    """One camera's events between two frames.

    Attributes:
        events: the events.
        extra: optional columns of the event file, (N,) each.
    """

    events: Events
    extra: dict[str, NDArray[np.generic]]


class Cameras:
    """One sensor per camera, each in a thread of the pool.

    Args:
        job: rig and parameters.
        pool: threads.
        state: where to go on; None starts with the first frame.
    """

    def __init__(self, job: RenderJob, pool: Executor, state: State | None) -> None:
        self._job, self._pool = job, pool
        self._sensors = [
            Sensor(k, camera.width_px, camera.height_px, job.config, job.seed)
            for k, camera in enumerate(job.rig.cameras)
        ]
        self._pending: list[Future[Packet]] = []
        self._t_us: int | None = None
        self._depth_m: tuple[NDArray[np.float32], ...] = ()
        if state is not None:
            self._restore(state)

    def take(self, frame: RenderedFrame) -> None:
        """Hands over the next pictures; `collect` what came of the ones before first."""
        if self._t_us is None:
            for sensor, intensity in zip(self._sensors, frame.intensity, strict=True):
                sensor.start(intensity, frame.t_us)
        else:
            before = self._t_us, self._depth_m
            self._pending = [
                self._pool.submit(self._step, k, frame, *before) for k in range(len(self._sensors))
            ]
        self._t_us, self._depth_m = frame.t_us, frame.depth_m

    def collect(self) -> list[Packet]:
        """One packet per camera, of the pictures handed over last; none if there were none."""
        packets = [step.result() for step in self._pending]
        self._pending = []
        return packets

    def finish(self) -> list[dict[str, int]]:
        """Ends the recording; per camera, how many events were sent by cause, and dropped."""
        for sensor in self._sensors:
            sensor.finish()
        return [sensor.counts for sensor in self._sensors]

    def state(self) -> State:
        """Everything that later events depend on; `collect` first."""
        state = {"t_us": np.array(self._t_us)}
        for k, sensor in enumerate(self._sensors):
            state |= {f"{k}/{name}": value for name, value in sensor.state().items()}
        return state | {f"depth_m/{k}": depth_m for k, depth_m in enumerate(self._depth_m)}

    def _restore(self, state: State) -> None:
        self._t_us = int(state["t_us"])
        for k, sensor in enumerate(self._sensors):
            sensor.restore(part_of(state, str(k)))
        if self._job.event_depth:
            self._depth_m = tuple(part_of(state, "depth_m").values())

    def _step(
        self,
        k: int,
        frame: RenderedFrame,
        before_us: int,
        before_m: tuple[NDArray[np.float32], ...],
    ) -> Packet:
        labelled = self._sensors[k].step(frame.intensity[k], frame.t_us)
        events, extra = labelled.events, dict[str, NDArray[np.generic]]()
        if self._job.labelled:
            extra["label"] = labelled.label
        if self._job.event_depth:
            span_us = before_us, frame.t_us
            extra["depth_m"] = event_depth_m(before_m[k], frame.depth_m[k], span_us, events)
        return Packet(events, extra)
