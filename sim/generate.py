"""Scene, rig and configuration in; a sequence on disk out.

Pictures are rendered chunk by chunk, here or in worker processes; the event simulators take them
strictly in order; what is done lies in parts on disk, from which the sequence is put together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

from emvs.data.writer import SequenceWriter
from emvs.errors import InputError
from emvs.geometry.rig import Rig
from emvs.utils.files import refuse_existing
from sim import preflight
from sim.config import SimConfig
from sim.facts import Facts, facts_of
from sim.graphics import note
from sim.parallel.checkpoint import Notice, PartWriter, WorkFolder
from sim.parallel.render_job import RenderedFrame, RenderJob, chunk_bounds_us
from sim.parallel.sensors import Cameras, Packet
from sim.parallel.workers import shots_from_workers, shots_in_process
from sim.rendering.adaptive_sampling import truth_times_us
from sim.replay_scene import replayed
from sim.scene import Scene
from sim.sensor.frame_camera import FrameCamera, spans_us

Progress = Callable[[int, int, int], None]
"""Called after every frame with time done, time in total (µs) and events written so far."""

# What a kill may cost; finishing a part at 1280x720 takes about 0.2 s.
_COMMIT_S = 10.0


def _silent(_done_us: int, _total_us: int, _events: int) -> None:
    pass


def _unheard(_line: str) -> None:
    pass


def simulate(
    scene: Scene,
    rig: Rig,
    config: SimConfig,
    seed: int,
    out: Path,
    *,
    force: bool = False,
    workers: int = 1,
    resume: bool = True,
    commit_s: float = _COMMIT_S,
    progress: Progress = _silent,
    notice: Notice = _unheard,
) -> Path:
    """Simulates what the rig's event cameras see and writes the sequence to `out`.

    The same arguments give identical bytes on the same machine and graphics library, however many
    workers there are and however often the run was stopped and resumed.

    Args:
        scene: geometry, textures and motion.
        rig: the cameras; the scene's motion moves its body.
        config: every parameter.
        seed: non-negative; the scene's motion draws its phases from it.
        out: folder to write; appears only when complete. Unfinished work is kept beside it, in
            `.NAME.work`, and taken up by the next run with the same arguments.
        force: replace `out` if it exists.
        workers: rendering processes; 1 renders in this one. With more, the scene's functions must
            be importable, and a script that calls this needs the usual `__main__` guard.
        resume: whether unfinished work is taken up; otherwise it is discarded.
        commit_s: least time between two parts, s: what a kill may cost.
        progress: called after every frame.
        notice: told in one line when unfinished work is taken up or found damaged, and when
            there is a GPU that does not draw.

    Returns:
        `out`.

    Raises:
        InputError: no graphics library, an existing `out` without `force`, a negative seed, motion
            too fast for the frame interval, a scene that cannot be built or starts with a camera
            inside an object, too little disk or memory, or unfinished work of other arguments.
    """
    if seed < 0:
        raise InputError(f"seed {seed}: must be 0 or greater")
    if workers < 1:
        raise InputError(f"{workers} workers: must be 1 or greater")
    refuse_existing(out, force=force)
    job = make_job(scene, rig, config, seed)
    preflight.check_disk(job, out)
    preflight.check_memory(job, workers)
    with ExitStack() as stack, ExitStack() as drawing:
        renderer = drawing.enter_context(job.renderer())
        preflight.check_outside(job, renderer.model)
        if note():
            notice(note())
        facts = facts_of(job, renderer)
        work = stack.enter_context(WorkFolder(out, facts.key, rig, resume=resume, notice=notice))
        if work.next_chunk:
            _tell(job, work, notice)
        if workers == 1:
            shots = shots_in_process(job, renderer, work.next_chunk)
        else:
            drawing.close()
            shots = shots_from_workers(job, work.next_chunk, workers)
        _run(job, shots, work, commit_s, progress)
        _assemble(job, work, facts, out, force=force)
    return out


def make_job(scene: Scene, rig: Rig, config: SimConfig, seed: int) -> RenderJob:
    """Decides the times of truth and the chunks.

    Raises:
        InputError: an impossible duration, truth time, exposure or recorded trajectory.
    """
    scene, config = replayed(scene, scene.configured(config))
    duration_s = scene.duration_s if config.duration_s is None else config.duration_s
    duration_us = round(duration_s * 1e6)
    if duration_us < 2:
        raise InputError(f"duration_s={duration_s}: a sequence lasts at least 2 µs")
    spans_us(config.frames, duration_us)
    more_us = [round(t_s * 1e6) for t_s in config.truth_times_s]
    truth_us = truth_times_us(duration_us, round(config.truth_interval_s * 1e6), more_us)
    return RenderJob(scene, rig, config, seed, tuple(truth_us), tuple(chunk_bounds_us(truth_us)))


def _run(
    job: RenderJob,
    shots: Iterator[RenderedFrame],
    work: WorkFolder,
    commit_s: float,
    progress: Progress,
) -> None:
    """Turns all remaining shots into parts."""
    done = sum(part.events for part in work.parts)
    state = work.parts[-1].state() if work.parts else None
    committed_s = time.monotonic()
    with ThreadPoolExecutor(len(job.rig)) as pool:
        cameras = Cameras(job, pool, state)
        frame_camera = FrameCamera(job.config.frames, job.duration_us, state)
        for shot in shots:
            done += _write_events(work.writer, cameras.collect())
            cameras.take(shot)
            for photos in frame_camera.take(shot.t_us, shot.intensity):
                for k, photo in enumerate(photos):
                    work.writer.append_photo(k, photo)
            _write_truth(work.writer, shot)
            if shot.t_us == job.bounds_us[shot.chunk + 1]:
                done += _write_events(work.writer, cameras.collect())
                last = shot.chunk + 1 == job.chunks
                if last or time.monotonic() - committed_s >= commit_s:
                    counts = cameras.finish() if last else ()
                    state = cameras.state() | frame_camera.state()
                    work.commit(state, shot.chunk + 1, counts)
                    committed_s = time.monotonic()
            progress(shot.t_us, job.duration_us, done)


def _write_events(part: PartWriter, packets: list[Packet]) -> int:
    for writer, packet in zip(part.event_writers, packets, strict=False):
        writer.append(packet.events, packet.extra)
    count = sum(len(packet.events) for packet in packets)
    part.events += count
    return count


def _write_truth(part: PartWriter, shot: RenderedFrame) -> None:
    for writer, images in zip(part.truth_writers, shot.truth, strict=False):
        optional = dict(images)
        depth_m, intensity = optional.pop("depth_m"), optional.pop("intensity")
        writer.append(shot.t_us, depth_m, intensity, optional)


def _assemble(job: RenderJob, work: WorkFolder, facts: Facts, out: Path, *, force: bool) -> None:
    """Streams all parts into the sequence."""
    counts = work.parts[-1].counts if job.labelled else None
    with SequenceWriter(out, **facts.arguments, sensor_counts=counts, force=force) as writer:
        for part in work.parts:
            for k in range(len(job.rig)):
                events, truth = part.readers(k, job.rig)
                for block, extra in events.blocks():
                    writer.append_events(k, block, **extra)
                for photo in part.photos(k):
                    writer.append_photo(k, photo)
                for t_us, images in truth.times():
                    depth_m, intensity = images.pop("depth_m"), images.pop("intensity")
                    writer.append_truth(k, t_us, depth_m, intensity, images)


def _tell(job: RenderJob, work: WorkFolder, notice: Notice) -> None:
    done_s = job.bounds_us[work.next_chunk] * 1e-6
    notice(
        f"resuming {work.path}: {done_s:.3f} s of {job.duration_us * 1e-6:.3f} s are done "
        "(resume=False discards them)"
    )
