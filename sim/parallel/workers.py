"""Chunks rendered in processes of their own, delivered in order.

Worker w of n renders chunks w, w + n, w + 2n, ... in a graphics context of its own. Pictures travel
through memory that both processes map: a fixed number of slots per worker, so that a worker that is
ahead waits, and memory stays bounded. Everything else travels through a pipe; when one end dies,
the other learns of it there, so that no process is left behind.
"""

from __future__ import annotations

import mmap
import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from itertools import chain
from multiprocessing import reduction
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.processes import check_guard, end_with_parent
from eventsweep.sim.graphics import worker_devices
from eventsweep.sim.graphics.choice import DEVICE
from eventsweep.sim.parallel.checkpoint import Stopped
from eventsweep.sim.parallel.render_job import ChunkRenderer, RenderedFrame, RenderJob
from eventsweep.sim.rendering import lens
from eventsweep.sim.rendering.base import Renderer, Samples
from eventsweep.sim.rendering.drawing import MujocoDrawing
from eventsweep.sim.sampling import border_px

_BYTES_PER_WORKER = 192 << 20
_MIN_SLOTS, _MAX_SLOTS = 3, 512
Images = tuple[NDArray[np.float32], ...]


# A frame on its way: its pictures lie in a slot.
_Sent = tuple[int, RenderedFrame]


class _Slots:
    """Shared memory as slots, each with room for the pictures of one frame."""

    def __init__(self, job: RenderJob, descriptor: int, count: int) -> None:
        self._memory = mmap.mmap(descriptor, count * slot_bytes(job))
        self._job, self._count = job, count

    def images(self, slot: int) -> Images:
        """Views of a slot, as `_shapes` has them."""
        offset, views = slot * slot_bytes(self._job), []
        for shape in _shapes(self._job):
            views.append(np.ndarray(shape, np.float32, self._memory, offset))
            offset += 4 * shape[0] * shape[1]
        return tuple(views)


class _Descriptor:
    """An open file that reaches a new process under whatever number it has there."""

    def __init__(self, number: int) -> None:
        self._number = number

    def __reduce__(self) -> tuple[Callable[[Any], int], tuple[Any]]:
        return _attach, (reduction.DupFd(self._number),)


def _attach(duplicate: Any) -> int:
    number: int = duplicate.detach()
    return number


def _shapes(job: RenderJob) -> list[tuple[int, int]]:
    """Of a frame's images: all cameras' intensity, depth where needed, then both of samples."""
    shapes = [(camera.height_px, camera.width_px) for camera in job.rig.cameras]
    if job.fine:
        wide, n = lens.widened(job.rig, border_px(job.config) or 0), job.supersample
        samples = [(n * camera.height_px, n * camera.width_px) for camera in wide.cameras]
        return 2 * shapes + 2 * samples
    return 2 * shapes if job.event_depth else shapes


def slot_bytes(job: RenderJob) -> int:
    """Memory that the pictures of one frame take."""
    return 4 * sum(rows * columns for rows, columns in _shapes(job))


def slot_count(job: RenderJob) -> int:
    """Slots of each worker."""
    return int(np.clip(_BYTES_PER_WORKER // slot_bytes(job), _MIN_SLOTS, _MAX_SLOTS))


def frames_in_process(
    job: RenderJob, renderer: Renderer, first_chunk: int
) -> Iterator[RenderedFrame]:
    """Renders the chunks from `first_chunk` on, one after the other, in this process."""
    chunks = ChunkRenderer(job, renderer)
    for chunk in range(first_chunk, job.chunks):
        yield from chunks.frames(chunk, begins=chunk == first_chunk)


def frames_from_workers(job: RenderJob, first_chunk: int, workers: int) -> Iterator[RenderedFrame]:
    """Renders the chunks from `first_chunk` on in `workers` processes; the same frames.

    Raises:
        InputError: what a worker refuses, or a scene that cannot be sent to another process.
        Stopped: a worker died.
    """
    check_guard(", or use one worker")
    _check_sendable(job)
    # After a fork, threads and graphics of this process would be dead in the child: spawn.
    context = multiprocessing.get_context("spawn")
    gpus = worker_devices() if isinstance(job.drawing, MujocoDrawing) else ()
    with ExitStack() as stack:
        team = []
        for k in range(workers):
            gpu = gpus[k % len(gpus)] if gpus else None
            worker = _RenderWorker(context, job, first_chunk, k, workers, gpu)
            team.append(stack.enter_context(worker))
        for chunk in range(first_chunk, job.chunks):
            yield from team[(chunk - first_chunk) % workers].frames(chunk)


class _RenderWorker:
    """The parent's side of one worker process."""

    def __init__(
        self, context: Any, job: RenderJob, first_chunk: int, index: int, workers: int,
        gpu: int | None,
    ) -> None:  # fmt: skip
        self._job, self._end_us = job, job.bounds_us
        count = slot_count(job)
        descriptor = os.memfd_create("eventsweep")
        try:
            os.ftruncate(descriptor, count * slot_bytes(job))
            self._slots = _Slots(job, descriptor, count)
            self._pipe, theirs = context.Pipe()
            chunks = range(first_chunk + index, job.chunks, workers)
            slots = _Descriptor(descriptor)
            arguments = (job, chunks, first_chunk, theirs, slots, count, workers, gpu)
            self._process = context.Process(target=_work, args=arguments, daemon=True)
            self._process.start()
            theirs.close()
        finally:
            os.close(descriptor)

    def __enter__(self) -> _RenderWorker:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._process.terminate()
        self._process.join()

    def frames(self, chunk: int) -> Iterator[RenderedFrame]:
        """The frames of the worker's next chunk."""
        while True:
            slot, sent = self._receive()
            images = tuple(view.copy() for view in self._slots.images(slot))
            with suppress(BrokenPipeError):
                self._pipe.send(slot)
            yield self._frame(sent, images)
            if sent.t_us == self._end_us[chunk + 1]:
                return
            del sent, images  # or they would stay while the next ones come

    def _frame(self, sent: RenderedFrame, images: Images) -> RenderedFrame:
        cameras = len(self._job.rig)
        parts = [images[k : k + cameras] for k in range(0, len(images), cameras)]
        samples = tuple(Samples(*pair) for pair in zip(*parts[2:], strict=True))
        depth_m = parts[1] if len(parts) > 1 else ()
        return sent._replace(intensity=parts[0], depth_m=depth_m, samples=samples)

    def _receive(self) -> _Sent:
        try:
            message = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            raise Stopped(
                f"a rendering process ended with exit code {self._process.exitcode}: if memory ran "
                "out, use fewer workers; run again to continue"
            ) from None
        if isinstance(message, BaseException):
            raise message
        sent: _Sent = message
        return sent


def _work(
    job: RenderJob, chunks: range, first_chunk: int, pipe: Connection, descriptor: int, count: int,
    workers: int, gpu: int | None,
) -> None:  # fmt: skip
    """A worker's whole life."""
    end_with_parent()
    # Ctrl-C reaches every process of the terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Software rendering takes all cores by itself; several processes share them.
    os.environ.setdefault("LP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))
    if gpu is not None:
        os.environ[DEVICE] = str(gpu)
    slots = _Slots(job, descriptor, count)
    free = list(range(count))
    # The other end gone means that the parent is: end as well.
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            with job.renderer() as renderer:
                rendered = ChunkRenderer(job, renderer)
                for chunk in chunks:
                    for frame in rendered.frames(chunk, begins=chunk == first_chunk):
                        _send(frame, pipe, slots, free)
                        del frame  # or its light would stay while the next is drawn
        except (InputError, MemoryError) as error:
            pipe.send(error)


def _send(frame: RenderedFrame, pipe: Connection, slots: _Slots, free: list[int]) -> None:
    while not free or pipe.poll():
        free.append(pipe.recv())
    slot = free.pop()
    images = (*frame.intensity, *frame.depth_m, *chain(*zip(*frame.samples, strict=True)))
    for view, image in zip(slots.images(slot), images, strict=True):
        view[:] = image
    pipe.send((slot, frame._replace(intensity=(), depth_m=(), samples=())))


def _check_sendable(job: RenderJob) -> None:
    try:
        pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"scene {job.scene.name} cannot be sent to other processes ({error}): define its "
            "functions at the top of a module, or use one worker"
        ) from error
