"""Scene, rig and configuration in; a sequence on disk out; refused early where it cannot end well.

Frames are rendered chunk by chunk, here or in worker processes; the sensors take them strictly in
order; checkpoints on disk hold what is done, and the sequence is put together from them.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import bytes_text, free_bytes
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.emvs.utils.runtime import Progress, available_bytes, silent, versions
from eventsweep.sim.config import SimConfig
from eventsweep.sim.frame_rig import pictures_beside, silent_beside
from eventsweep.sim.graphics import note
from eventsweep.sim.mjcf import files_of
from eventsweep.sim.model.survey import FEW, glanced_beyond_8_bits, needs_floats
from eventsweep.sim.motion.curves import sampled
from eventsweep.sim.parallel.checkpoint import CheckpointFolder, Notice, Stopped, begun_with
from eventsweep.sim.parallel.render_job import (
    RenderedFrame,
    RenderJob,
    chunk_bounds_us,
    longest_chunk_us,
)
from eventsweep.sim.parallel.sensors import Cameras, write_events, write_truth
from eventsweep.sim.parallel.workers import (
    frames_from_workers,
    frames_in_process,
    slot_bytes,
    slot_count,
)
from eventsweep.sim.rendering.adaptive_sampling import truth_times_us
from eventsweep.sim.rendering.base import Drawing, Renderer, finer
from eventsweep.sim.rendering.drawing import MUJOCO, decided, drawing_of
from eventsweep.sim.sampling import with_sampling
from eventsweep.sim.scene import Scene, replayed
from eventsweep.sim.sensor.frame_camera import DENSE_PX, FrameCamera, exposure_spans_us
from eventsweep.sim.sensor.imu import imu_samples

"""Called after every frame with time done, time in total (µs) and events written so far."""
# How often a scene's light is looked at before it is drawn.
_LOOKS = 3
# What a kill may cost; finishing a checkpoint at 1280x720 takes about 0.2 s.
_COMMIT_S = 10.0
# Events per pixel: a tenth of those of a picture that moves by one edge.
_FEW_EVENTS = 0.002
_FEW_SEEN = 0.05
# Lossless compression of rendered images gains at least this.
_COMPRESSED = 0.4
_IMAGE_BYTES = {"depth_m": 4, "intensity": 1, "flow": 8, "segmentation": 4, "boundary": 1}
# Memory of a sensor's pixel, of a render sample, and of a process that draws.
_PIXEL_BYTES, _SAMPLE_BYTES, _PROCESS_BYTES = 120, 24, 300e6


def _nothing(_line: str) -> None:
    """Gives no notice."""


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
    progress: Progress = silent,
    notice: Notice = _nothing,
    drawing: Drawing | None = None,
) -> Path:
    """Simulates what the rig's event cameras see and writes the sequence to `out`.

    The same arguments give identical bytes on the same machine and graphics library, however many
    workers there are and however often the run was stopped and resumed. Unfinished work is kept
    beside `out`, in `.NAME.work`, and taken up by the next run with the same arguments, unless
    `resume` is off: then it is discarded. With several workers, the scene's functions must be
    importable, `drawing`, which opens the renderer instead of the one that the parameters name, is
    sent to other processes, and a script that calls this needs the usual `__main__` guard.

    A kill costs `commit_s` at the most, the least time between two checkpoints. `notice` is called
    with one line when unfinished work is taken up or found damaged, when there is a GPU that does
    not draw, and where there are next to no events.

    Raises:
        InputError: no graphics library, an existing `out` without `force`, a negative seed, motion
            too fast for the frame interval, a scene that cannot be built or starts with a camera
            inside an object, too little disk or memory, or unfinished work of other arguments.
    """
    if seed < 0:
        raise InputError(f"seed {seed}: must be 0 or greater")
    if workers < 1:
        raise InputError(f"{workers} workers: must be 1 or greater")
    check_output(out, force=force)
    config, drawing = _with_renderer(config, drawing, out, resume=resume)
    asked = rig, config, seed, drawing
    job = make_job(scene, *asked)
    check_disk(job, out)
    check_memory(job, workers)
    with ExitStack() as stack, ExitStack() as graphics:
        renderer = graphics.enter_context(job.renderer())
        # A scene that says so itself, and a model, which was surveyed, are not looked at again.
        unknown = not (job.scene.hdr or job.scene.clip_m is not None)
        unknown &= not job.config.light.chosen
        if unknown and _beyond_8_bits(job, renderer, cut=True) > FEW:
            graphics.close()
            job, renderer = _lit(job, make_job(replace(scene, hdr=True), *asked), graphics, notice)
        check_outside(job, renderer)
        plain = "" if config.sampling == job.config.sampling else drawing.why_plain(scene)
        _tell_how(job, renderer, plain, notice)
        arguments, key = describe(job, renderer)
        folder = stack.enter_context(
            CheckpointFolder(
                out, key, rig, renderer=config.light.renderer, resume=resume, notice=notice
            )
        )
        if folder.next_chunk:
            _tell(job, folder, notice)
        if workers == 1:
            frames = frames_in_process(job, renderer, folder.next_chunk)
        else:
            graphics.close()
            frames = frames_from_workers(job, folder.next_chunk, workers)
        _run(job, frames, folder, commit_s, progress, drawn_elsewhere=workers > 1)
        try:
            seen = _assemble(job, folder, arguments, out, progress, force=force)
        except InputError as error:
            # Somebody came in between: the work itself is good.
            raise Stopped(f"{error} (the simulation is kept in {folder.path})") from error
        _say_if_empty(job, sum(checkpoint.events for checkpoint in folder.finished), notice)
        if seen < _FEW_SEEN:
            notice(
                f"{job.scene.name}: surfaces fill {100 * seen:.2g} % of the view: check where the "
                "cameras look, or of a recorded trajectory its unit and replay.place"
            )
    return out


def _tell_how(job: RenderJob, renderer: Renderer, plain: str, notice: Notice) -> None:
    if note():
        notice(f"{note()}: drawn by {renderer.description}")
    if silent := silent_beside(job):
        notice(silent)
    if plain:
        notice(f"rendering plain frames half a pixel apart: {plain}")


def _with_renderer(
    config: SimConfig, drawing: Drawing | None, out: Path, *, resume: bool
) -> tuple[SimConfig, Drawing]:
    """What draws, and its name among the parameters: that of unfinished work where there is."""
    if drawing is not None:
        return config, drawing
    config = decided(config, begun_with(out) if resume else None)
    return config, drawing_of(config)


def _lit(
    job: RenderJob, floating: RenderJob, graphics: ExitStack, notice: Notice
) -> tuple[RenderJob, Renderer]:
    """The job whose light the scene needs, and its renderer: in floats unless 8 bits hold it."""
    renderer = graphics.enter_context(floating.renderer())
    beyond = _beyond_8_bits(floating, renderer, cut=False)
    if needs_floats(job.scene.name, beyond, notice):
        return floating, renderer
    graphics.close()
    return job, graphics.enter_context(job.renderer())


def _beyond_8_bits(job: RenderJob, renderer: Renderer, *, cut: bool) -> float:
    times_s = np.linspace(0.0, 1e-6 * job.duration_us, _LOOKS).tolist()
    return glanced_beyond_8_bits(renderer, job.motion(), times_s, job.config, cut=cut)


def _say_if_empty(job: RenderJob, events: int, notice: Notice) -> None:
    pixels = sum(camera.width_px * camera.height_px for camera in job.rig.cameras)
    if events < _FEW_EVENTS * pixels:
        notice(
            f"{job.scene.name}: {events} events of {pixels} pixels in {job.duration_us * 1e-6:g} "
            "s are very few: make it longer, move faster, or add texture to surfaces"
        )


def make_job(
    scene: Scene, rig: Rig, config: SimConfig, seed: int, drawing: Drawing | None = None
) -> RenderJob:
    """Decides the times of truth and the chunks; `drawing` is MuJoCo's without one.

    Raises:
        InputError: an impossible duration, truth time, exposure or recorded trajectory.
    """
    drawing = drawing or MUJOCO
    scene, config = replayed(scene, scene.configured(config))
    floats = config.light.floats(scene.hdr)
    config = with_sampling(
        config, rig, drawing.why_plain(scene), floats=floats, finer=finer(drawing)
    )
    duration_s = scene.duration_s if config.duration_s is None else config.duration_s
    duration_us = round(duration_s * 1e6)
    if duration_us < 2:
        raise InputError(f"duration_s={duration_s}: a sequence lasts at least 2 µs")
    exposure_spans_us(config.frames, duration_us)
    more_us = [round(t_s * 1e6) for t_s in config.truth_times_s]
    truth_us = truth_times_us(duration_us, round(config.truth_interval_s * 1e6), more_us)
    bounds_us = chunk_bounds_us(truth_us, longest_chunk_us(config, rig), config.frame_period_us)
    return RenderJob(scene, rig, config, seed, tuple(truth_us), tuple(bounds_us), drawing)


def _run(
    job: RenderJob,
    frames: Iterator[RenderedFrame],
    folder: CheckpointFolder,
    commit_s: float,
    progress: Progress,
    *,
    drawn_elsewhere: bool,
) -> None:
    """Turns all remaining frames into checkpoints.

    Where this process draws them, sensors work while it does; else it asks for the next one only
    when they are done, and so holds one frame less.
    """
    state = folder.finished[-1].state() if folder.finished else None
    committed_s = time.monotonic()
    with ThreadPoolExecutor(len(job.rig)) as pool:
        cameras = Cameras(job, pool, state)
        blur_px = job.config.sensor.resolved().lens_blur_px
        frame_camera = FrameCamera(job.config.frames, job.duration_us, state, blur_px)
        for frame in frames:
            write_events(folder.writer, cameras.collect())
            cameras.take(frame)
            if frame.t_us == job.bounds_us[folder.next_chunk] and state is not None:
                continue
            for t_us, lights in _exposed(frame_camera, cameras, frame):
                for photos in frame_camera.take(t_us, lights):
                    for k, photo in enumerate(photos):
                        folder.writer.append_photo(k, photo)
            write_truth(folder.writer, frame)
            if frame.t_us == job.bounds_us[frame.chunk + 1]:
                write_events(folder.writer, cameras.collect())
                last = frame.chunk + 1 == job.chunks
                if last or time.monotonic() - committed_s >= commit_s:
                    counts = cameras.finish() if last else ()
                    state = cameras.state() | frame_camera.state()
                    folder.commit(state, frame.chunk + 1, counts)
                    committed_s = time.monotonic()
            if drawn_elsewhere:
                write_events(folder.writer, cameras.collect())
            progress("simulate", frame.t_us, job.duration_us)
            del frame  # or its truth would stay while the next comes


def _exposed(
    frame_camera: FrameCamera, cameras: Cameras, frame: RenderedFrame
) -> Iterator[tuple[int, tuple[NDArray[np.float32], ...]]]:
    """What a frame camera must see up to this frame: all that moves while its shutter is open."""
    if not cameras.passages or not frame_camera.exposes(frame.t_us):
        yield frame.t_us, frame.intensity
        return
    # The camera whose view changes most decides for all.
    times_us = max((passage.times_us(DENSE_PX) for passage in cameras.passages), key=len)
    pictures = zip(*(passage.pictures(times_us) for passage in cameras.passages), strict=True)
    yield from zip(times_us, pictures, strict=True)


def _assemble(
    job: RenderJob, folder: CheckpointFolder, arguments: dict[str, Any], out: Path,
    progress: Progress, *, force: bool,
) -> float:  # fmt: skip
    """Streams all checkpoints into the sequence; returns the share of the view with a surface."""
    shares = []
    counts = folder.finished[-1].counts if job.labelled else None
    read = (job.config, files_of(job.scene.mjcf))
    with SequenceWriter(out, **arguments, sensor_counts=counts, force=force, inputs=read) as writer:
        for checkpoint in folder.finished:
            for k in range(len(job.rig)):
                events, truth = checkpoint.readers(k, job.rig)
                for block, extra in events.blocks():
                    writer.append_events(k, block, **extra)
                for photo in checkpoint.photos(k):
                    writer.append_photo(k, photo)
                for t_us, images in truth.times():
                    depth_m, intensity = images.pop("depth_m"), images.pop("intensity")
                    shares.append(float(np.mean(np.isfinite(depth_m))))
                    writer.append_truth(k, t_us, depth_m, intensity, images)
        for k, photo in pictures_beside(job):
            writer.append_beside(k, photo)
            progress("frames", photo.end_us, job.duration_us)
    return float(np.mean(shares)) if shares else 1.0


def _tell(job: RenderJob, folder: CheckpointFolder, notice: Notice) -> None:
    done_s = job.bounds_us[folder.next_chunk] * 1e-6
    notice(
        f"resuming {folder.path}: {done_s:.3f} s of {job.duration_us * 1e-6:.3f} s are done "
        "(resume=False discards them)"
    )


def describe(job: RenderJob, renderer: Renderer) -> tuple[dict[str, Any], str]:
    """What is known of a sequence before its first frame.

    Returns:
        Arguments of `SequenceWriter`, and a hash over all that decides the sequence; checkpoints
        of another hash are refused.
    """
    duration_s = job.duration_us * 1e-6
    trajectory = sampled(job.motion(), duration_s, job.config.pose_rate_hz)
    arguments = {
        "name": job.scene.name,
        "rig": job.rig,
        "trajectory": trajectory,
        "config": job.config.model_dump(mode="json"),
        "seed": job.seed,
        "renderer": renderer.description,
        "depth_range_m": job.scene.depth_range_m,
    }
    if "segmentation" in job.config.truth:
        arguments["geoms"] = dict(renderer.geoms)
    if job.config.imu.rate_hz:
        arguments["imu"] = imu_samples(job.motion(), duration_s, job.config.imu, job.seed)
    return arguments, _key(job, renderer, trajectory)


def _key(job: RenderJob, renderer: Renderer, trajectory: Trajectory) -> str:
    """A hash over all that decides the sequence: parameters, geometry, textures and all motion."""
    plain = {
        "scene": [job.scene.name, job.scene.depth_range_m],
        "rig": job.rig.to_json(),
        "config": job.config.model_dump(mode="json"),
        "seed": job.seed,
        "bounds_us": job.bounds_us,
        "renderer": renderer.description,
        "versions": versions(),
    }
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
    poses = trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw
    for array in (*renderer.identity(job.duration_us * 1e-6), *poses):
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def check_disk(job: RenderJob, out: Path) -> None:
    """Compares the disk's free space with the size of the ground truth.

    Raises:
        InputError: there is less; says how much is needed.
    """
    per_pixel = sum(
        _IMAGE_BYTES.get(name, 0) for name in ("depth_m", "intensity", *job.config.truth)
    )
    pixels = sum(c.width_px * c.height_px for c in job.rig.cameras)
    beside = job.rig.frame_cameras.cameras if job.rig.frame_cameras else ()
    photos = len(exposure_spans_us(job.config.frames, job.duration_us))
    # It lies there twice while the sequence is put together from its checkpoints.
    needed = 2 * _COMPRESSED * pixels * (per_pixel * len(job.truth_us) + photos)
    needed += _COMPRESSED * photos * sum(c.width_px * c.height_px for c in beside)
    free = free_bytes(out)
    if needed > free:
        raise InputError(
            f"{out}: ground truth at {len(job.truth_us)} times takes about {bytes_text(needed)}, "
            f"but {bytes_text(free)} are free: raise truth_interval_s, or choose another disk"
        )


def check_memory(job: RenderJob, workers: int) -> None:
    """Compares the machine's free memory with what the rig's pictures take.

    Raises:
        InputError: there is less; says how much is needed.
    """
    sizes = [camera.width_px * camera.height_px for camera in job.rig.cameras]
    drawing = _PROCESS_BYTES + _SAMPLE_BYTES * max(sizes) * job.supersample**2
    shared = slot_bytes(job) * slot_count(job) if workers > 1 else 0
    # Of fine frames the sensors keep one, work on one and wait for one; two have boxes as well.
    kept = 4 * slot_bytes(job) if job.fine else 0
    needed = _PIXEL_BYTES * sum(sizes) + kept + workers * (drawing + shared)
    free = available_bytes()
    if needed > free:
        raise InputError(
            f"rig {job.rig.name} at supersample={job.supersample} with {workers} workers "
            f"takes about {bytes_text(needed)} of memory, but {bytes_text(free)} are free: use "
            "fewer workers, a lower supersample or smaller cameras"
        )


def check_outside(job: RenderJob, renderer: Renderer) -> None:
    """Makes sure that no camera starts inside an object.

    Raises:
        InputError: one does; names camera and object.
    """
    T_world_body = job.motion().T_world_body(0.0)
    rigs = [rig for rig in (job.rig, job.rig.frame_cameras) if rig is not None]
    for name, T_body_cam in (
        pair for rig in rigs for pair in zip(rig.camera_names, rig.T_body_cam, strict=True)
    ):
        eye_m = (T_world_body @ T_body_cam)[:3, 3]
        around = renderer.enclosing(eye_m)
        if around is not None:
            raise InputError(
                f"camera {name} of rig {job.rig.name} starts inside {around!r} of scene "
                f"{job.scene.name}, at {np.round(eye_m, 3).tolist()} m: move the start of the "
                "motion, or the object"
            )
