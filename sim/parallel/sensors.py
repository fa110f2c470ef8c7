"""The sensors of a rig, at work while the next pictures are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.sim.compensation.fine_frame import FineFrame
from eventsweep.sim.compensation.interval import Passage, lens_of
from eventsweep.sim.ground_truth import event_depth_m
from eventsweep.sim.parallel.checkpoint import CheckpointWriter, State
from eventsweep.sim.parallel.render_job import RenderedFrame, RenderJob
from eventsweep.sim.rendering.base import Frame
from eventsweep.sim.sensor.sensor import Sensor, part_of


class Packet(NamedTuple):
    """One camera's events between two frames, and optional columns of the event file, (N,) each."""

    events: Events
    extra: dict[str, NDArray[Any]]


def write_events(writer: CheckpointWriter | SequenceWriter, packets: Sequence[Packet]) -> int:
    """Writes what all cameras sent between two frames; how many events."""
    for k, packet in enumerate(packets):
        writer.append_events(k, packet.events, **packet.extra)
    return sum(len(packet.events) for packet in packets)


def write_truth(writer: CheckpointWriter | SequenceWriter, frame: RenderedFrame) -> None:
    """Writes a frame's ground truth where it has some."""
    for k, images in enumerate(frame.truth):
        optional = dict(images)
        depth_m, intensity = optional.pop("depth_m"), optional.pop("intensity")
        writer.append_truth(k, frame.t_us, depth_m, intensity, optional)


class Cameras:
    """One sensor per camera, each in a thread of the pool; a state says where to go on."""

    def __init__(self, job: RenderJob, pool: Executor, state: State | None) -> None:
        self._job, self._pool = job, pool
        self._sensors = [
            Sensor(k, camera.width_px, camera.height_px, job.config, job.seed)
            for k, camera in enumerate(job.rig.cameras)
        ]
        self._pending: list[Future[Packet]] = []
        self._t_us: int | None = None
        self._before: RenderedFrame | None = None
        self._fine: tuple[FineFrame, ...] = ()
        for camera in job.rig.cameras if job.fine else ():
            lens_of(camera)  # one after the other, before there are frames: it takes memory
        if state is not None:
            self._restore(state)

    def take(self, frame: RenderedFrame) -> None:
        """Hands over the next pictures; `collect` what came of the ones before first.

        The first one starts the sensors, or reminds them of the last that they took.
        """
        seen = zip(frame.intensity, frame.depth_m, frame.samples, strict=False)
        grid, reach_px = self._job.supersample, self._job.config.spacing_px
        fine = tuple(FineFrame(Frame(*each), grid, reach_px) for each in seen)
        if self._t_us is None:
            for sensor, intensity in zip(self._sensors, frame.intensity, strict=True):
                sensor.start(intensity, frame.t_us)
        elif self._before is not None:
            parts = self._job.rig.cameras, self._fine, fine, frame.intervals
            self.passages = tuple(Passage(*each) for each in zip(*parts, strict=False))
            self._pending = [
                self._pool.submit(self._step, k, frame, self._before)
                for k in range(len(self._sensors))
            ]
        self._t_us, self._before, self._fine = frame.t_us, frame._replace(truth=()), fine

    passages: tuple[Passage, ...] = ()
    """Per camera, the way to the frame taken last, until `collect`; none of plain frames."""

    def collect(self) -> list[Packet]:
        """One packet per camera, of the pictures handed over last; none if there were none."""
        packets = [step.result() for step in self._pending]
        self._pending, self.passages = [], ()
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
        return state

    def _restore(self, state: State) -> None:
        self._t_us = int(state["t_us"])
        for k, sensor in enumerate(self._sensors):
            sensor.restore(part_of(state, str(k)))

    def _step(self, k: int, frame: RenderedFrame, before: RenderedFrame) -> Packet:
        passage = self.passages[k] if self.passages else None
        sensor = self._sensors[k]
        labelled = (
            sensor.between(passage) if passage else sensor.step(frame.intensity[k], frame.t_us)
        )
        events, extra = labelled.events, dict[str, NDArray[Any]]()
        if self._job.labelled:
            extra["label"] = labelled.label
        if self._job.event_depth:
            span_us, depths_m = (before.t_us, frame.t_us), (before.depth_m[k], frame.depth_m[k])
            places = passage.places(events.x, events.y, events.t_us) if passage else None
            depth_m = event_depth_m(*depths_m, span_us, events, places)
            if passage:
                passage.layered_depths(events.x, events.y, events.t_us, depth_m)
            extra["depth_m"] = depth_m
        return Packet(events, extra)
