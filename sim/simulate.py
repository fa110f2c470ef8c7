"""Scene, rig and configuration in; a sequence on disk out; refused early where it cannot end well.

Frames are rendered chunk by chunk, here or in worker processes; the sensors take them strictly in
order; checkpoints on disk hold what is done, and the sequence is put together from them.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import bytes_text, free_bytes
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.emvs.utils.runtime import available_bytes, versions
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import import_mujoco, note
from eventsweep.sim.ground_truth import geom_table
from eventsweep.sim.motion.curves import sampled
from eventsweep.sim.parallel.checkpoint import CheckpointFolder, CheckpointWriter, Notice, Stopped
from eventsweep.sim.parallel.render_job import (
    RenderedFrame,
    RenderJob,
    chunk_bounds_us,
    longest_chunk_us,
)
from eventsweep.sim.parallel.sensors import Cameras, Packet
from eventsweep.sim.parallel.workers import (
    frames_from_workers,
    frames_in_process,
    slot_bytes,
    slot_count,
)
from eventsweep.sim.rendering.adaptive_sampling import truth_times_us
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.sampling import why_linear, with_sampling
from eventsweep.sim.scene import Scene, replayed
from eventsweep.sim.sensor.frame_camera import DENSE_PX, FrameCamera, exposure_spans_us
from eventsweep.sim.sensor.imu import imu_samples

Progress = Callable[[int, int, int], None]
"""Called after every frame with time done, time in total (µs) and events written so far."""
# What a kill may cost; finishing a checkpoint at 1280x720 takes about 0.2 s.
_COMMIT_S = 10.0
# When animated bodies are looked at to tell one animation from another: evenly, and early.
_ANIMATION_SAMPLES, _ANIMATION_TIMES_S = 32, (0.001, 0.01, 0.1)
# Lossless compression of rendered images gains at least this.
_COMPRESSED = 0.4
_IMAGE_BYTES = {"depth_m": 4, "intensity": 1, "flow": 8, "segmentation": 4, "boundary": 1}
# Memory of a sensor's pixel, of a render sample, and of a process that draws.
_PIXEL_BYTES, _SAMPLE_BYTES, _PROCESS_BYTES = 120, 24, 300e6


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
        force: replace a sequence that is in the place of `out`.
        workers: rendering processes; 1 renders in this one. With more, the scene's functions must
            be importable, and a script that calls this needs the usual `__main__` guard.
        resume: whether unfinished work is taken up; otherwise it is discarded.
        commit_s: least time between two checkpoints, s: what a kill may cost.
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
    check_output(out, force=force, inputs=(config.replay.trajectory, scene.mjcf))
    job = make_job(scene, rig, config, seed)
    check_disk(job, out)
    check_memory(job, workers)
    with ExitStack() as stack, ExitStack() as drawing:
        renderer = drawing.enter_context(job.renderer())
        check_outside(job, renderer.model)
        if note():
            notice(note())
        if config.sampling != job.config.sampling:
            notice(f"plain frames half a pixel apart: {why_linear(scene)}")
        described = describe(job, renderer)
        folder = stack.enter_context(
            CheckpointFolder(out, described.key, rig, resume=resume, notice=notice)
        )
        if folder.next_chunk:
            _tell(job, folder, notice)
        if workers == 1:
            frames = frames_in_process(job, renderer, folder.next_chunk)
        else:
            drawing.close()
            frames = frames_from_workers(job, folder.next_chunk, workers)
        _run(job, frames, folder, commit_s, progress, drawn_elsewhere=workers > 1)
        try:
            _assemble(job, folder, described, out, force=force)
        except InputError as error:
            # Somebody came in between: the work itself is good.
            raise Stopped(f"{error} (the simulation is kept in {folder.path})") from error
    return out


def make_job(scene: Scene, rig: Rig, config: SimConfig, seed: int) -> RenderJob:
    """Decides the times of truth and the chunks.

    Raises:
        InputError: an impossible duration, truth time, exposure or recorded trajectory.
    """
    scene, config = replayed(scene, scene.configured(config))
    config = with_sampling(config, rig, why_linear(scene))
    duration_s = scene.duration_s if config.duration_s is None else config.duration_s
    duration_us = round(duration_s * 1e6)
    if duration_us < 2:
        raise InputError(f"duration_s={duration_s}: a sequence lasts at least 2 µs")
    exposure_spans_us(config.frames, duration_us)
    more_us = [round(t_s * 1e6) for t_s in config.truth_times_s]
    truth_us = truth_times_us(duration_us, round(config.truth_interval_s * 1e6), more_us)
    bounds_us = chunk_bounds_us(truth_us, longest_chunk_us(config, rig), config.frame_period_us)
    return RenderJob(scene, rig, config, seed, tuple(truth_us), tuple(bounds_us))


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
    done = sum(checkpoint.events for checkpoint in folder.finished)
    state = folder.finished[-1].state() if folder.finished else None
    committed_s = time.monotonic()
    with ThreadPoolExecutor(len(job.rig)) as pool:
        cameras = Cameras(job, pool, state)
        frame_camera = FrameCamera(job.config.frames, job.duration_us, state)
        for frame in frames:
            done += _write_events(folder.writer, cameras.collect())
            cameras.take(frame)
            if frame.t_us == job.bounds_us[folder.next_chunk] and state is not None:
                continue
            for t_us, lights in _exposed(frame_camera, cameras, frame):
                _write_photos(folder.writer, frame_camera.take(t_us, lights))
            _write_truth(folder.writer, frame)
            if frame.t_us == job.bounds_us[frame.chunk + 1]:
                done += _write_events(folder.writer, cameras.collect())
                last = frame.chunk + 1 == job.chunks
                if last or time.monotonic() - committed_s >= commit_s:
                    counts = cameras.finish() if last else ()
                    state = cameras.state() | frame_camera.state()
                    folder.commit(state, frame.chunk + 1, counts)
                    committed_s = time.monotonic()
            if drawn_elsewhere:
                done += _write_events(folder.writer, cameras.collect())
            progress(frame.t_us, job.duration_us, done)
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


def _write_events(checkpoint: CheckpointWriter, packets: list[Packet]) -> int:
    for writer, packet in zip(checkpoint.event_writers, packets, strict=False):
        writer.append(packet.events, packet.extra)
    count = sum(len(packet.events) for packet in packets)
    checkpoint.events += count
    return count


def _write_photos(checkpoint: CheckpointWriter, completed: list[tuple[Photo, ...]]) -> None:
    for photos in completed:
        for k, photo in enumerate(photos):
            checkpoint.append_photo(k, photo)


def _write_truth(checkpoint: CheckpointWriter, frame: RenderedFrame) -> None:
    for writer, images in zip(checkpoint.truth_writers, frame.truth, strict=False):
        optional = dict(images)
        depth_m, intensity = optional.pop("depth_m"), optional.pop("intensity")
        writer.append(frame.t_us, depth_m, intensity, optional)


def _assemble(
    job: RenderJob, folder: CheckpointFolder, described: SequenceFacts, out: Path, *, force: bool
) -> None:
    """Streams all checkpoints into the sequence."""
    counts = folder.finished[-1].counts if job.labelled else None
    recorded = job.config.replay.trajectory
    read = [job.scene.mjcf] if recorded is None else [job.scene.mjcf, recorded]
    with SequenceWriter(
        out, **described.arguments, sensor_counts=counts, force=force, inputs=read
    ) as writer:
        for checkpoint in folder.finished:
            for k in range(len(job.rig)):
                events, truth = checkpoint.readers(k, job.rig)
                for block, extra in events.blocks():
                    writer.append_events(k, block, **extra)
                for photo in checkpoint.photos(k):
                    writer.append_photo(k, photo)
                for t_us, images in truth.times():
                    depth_m, intensity = images.pop("depth_m"), images.pop("intensity")
                    writer.append_truth(k, t_us, depth_m, intensity, images)


def _tell(job: RenderJob, folder: CheckpointFolder, notice: Notice) -> None:
    done_s = job.bounds_us[folder.next_chunk] * 1e-6
    notice(
        f"resuming {folder.path}: {done_s:.3f} s of {job.duration_us * 1e-6:.3f} s are done "
        "(resume=False discards them)"
    )


class SequenceFacts(NamedTuple):
    """What is known of a sequence before its first frame.

    Attributes:
        arguments: of `SequenceWriter`: name, rig, trajectory, IMU and what the manifest says.
        key: a hash over all that decides the sequence; checkpoints of another key are refused.
    """

    arguments: dict[str, Any]
    key: str


def describe(job: RenderJob, renderer: StereoRenderer) -> SequenceFacts:
    """Samples what rides on the motion and describes the rest."""
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
        arguments["geoms"] = geom_table(renderer.model)
    if job.config.imu.rate_hz:
        arguments["imu"] = imu_samples(job.motion(), duration_s, job.config.imu, job.seed)
    return SequenceFacts(arguments, _key(job, renderer, trajectory))


def _key(job: RenderJob, renderer: StereoRenderer, trajectory: Trajectory) -> str:
    """A hash over all that decides the sequence: parameters, geometry, textures and all motion."""
    mj = import_mujoco()
    model = np.zeros(mj.mj_sizeModel(renderer.model), np.uint8)
    mj.mj_saveModel(renderer.model, None, model)
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
    for array in (model, *poses, *_animation(job, renderer.model)):
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _animation(job: RenderJob, model: Any) -> list[NDArray[np.float64]]:
    """Where the bodies that move by themselves are at some times, and how often frames are."""
    animate = job.scene.animate
    if animate is None:
        return []
    data, sampled_as = import_mujoco().MjData(model), [np.array([animate.max_interval_us], float)]
    # Early as well: bodies that start at other speeds have not gone far, but may come to rest.
    times_s = (*_ANIMATION_TIMES_S, *np.linspace(0, job.duration_us * 1e-6, _ANIMATION_SAMPLES))
    for t_s in sorted(t for t in times_s if t <= job.duration_us * 1e-6):
        animate(model, data, float(t_s))
        sampled_as += [data.qpos.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()]
    return sampled_as


def check_disk(job: RenderJob, out: Path) -> None:
    """Compares the disk's free space with the size of the ground truth.

    Raises:
        InputError: there is less; says how much is needed.
    """
    per_pixel = sum(
        _IMAGE_BYTES.get(name, 0) for name in ("depth_m", "intensity", *job.config.truth)
    )
    pixels = sum(c.width_px * c.height_px for c in job.rig.cameras)
    photos = len(exposure_spans_us(job.config.frames, job.duration_us))
    # It lies there twice while the sequence is put together from its checkpoints.
    needed = 2 * _COMPRESSED * pixels * (per_pixel * len(job.truth_us) + photos)
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
    # Of fine frames the sensors keep one, work on one and wait for one.
    kept = 3 * slot_bytes(job) if job.fine else 0
    needed = _PIXEL_BYTES * sum(sizes) + kept + workers * (drawing + shared)
    free = available_bytes()
    if needed > free:
        raise InputError(
            f"rig {job.rig.name} at supersample={job.supersample} with {workers} workers "
            f"takes about {bytes_text(needed)} of memory, but {bytes_text(free)} are free: use "
            "fewer workers, a lower supersample or smaller cameras"
        )


def check_outside(job: RenderJob, model: Any) -> None:
    """Makes sure that no camera starts inside an object.

    Raises:
        InputError: one does; names camera and object.
    """
    mj = import_mujoco()
    data = mj.MjData(model)
    if job.scene.animate is not None:
        job.scene.animate(model, data, 0.0)
    mj.mj_forward(model, data)
    T_world_body = job.motion().T_world_body(0.0)
    for name, T_body_cam in zip(job.rig.camera_names, job.rig.T_body_cam, strict=True):
        eye_m = (T_world_body @ T_body_cam)[:3, 3]
        for geom_id in range(model.ngeom):
            if _drawn(model, geom_id) and _inside(mj, model, data, geom_id, eye_m):
                body = model.body(int(model.geom_bodyid[geom_id])).name
                if body and body == job.scene.carrier:
                    continue
                label = model.geom(geom_id).name or body or f"geom{geom_id}"
                raise InputError(
                    f"camera {name} of rig {job.rig.name} starts inside {label!r} of scene "
                    f"{job.scene.name}, at {np.round(eye_m, 3).tolist()} m: move the start of the "
                    "motion, or the object"
                )


def _drawn(model: Any, geom_id: int) -> bool:
    material = int(model.geom_matid[geom_id])
    alpha = model.mat_rgba[material][3] if material >= 0 else model.geom_rgba[geom_id][3]
    return bool(alpha > 0) and int(model.geom_group[geom_id]) < 3


def _inside(mj: Any, model: Any, data: Any, geom_id: int, point_m: NDArray[np.float64]) -> bool:
    """Whether a point lies inside a geom that has an inside: MuJoCo's closed primitives, meshes."""
    turn = data.geom_xmat[geom_id].reshape(3, 3)
    local = (point_m - data.geom_xpos[geom_id]) @ turn
    size, kind = model.geom_size[geom_id], mj.mjtGeom(model.geom_type[geom_id])
    if np.linalg.norm(local) > model.geom_rbound[geom_id] > 0:
        return False
    radius = float(np.hypot(local[0], local[1]))
    if kind == mj.mjtGeom.mjGEOM_SPHERE:
        return bool(np.linalg.norm(local) < size[0])
    if kind == mj.mjtGeom.mjGEOM_BOX:
        return bool((np.abs(local) < size).all())
    if kind == mj.mjtGeom.mjGEOM_ELLIPSOID:
        return bool(np.linalg.norm(local / size) < 1)
    if kind == mj.mjtGeom.mjGEOM_CYLINDER:
        return bool(radius < size[0] and abs(local[2]) < size[1])
    if kind == mj.mjtGeom.mjGEOM_CAPSULE:
        return bool(np.hypot(radius, max(0.0, abs(local[2]) - size[1])) < size[0])
    if kind == mj.mjtGeom.mjGEOM_MESH:
        return _inside_mesh(model, int(model.geom_dataid[geom_id]), local)
    return False


def _inside_mesh(model: Any, mesh_id: int, local: NDArray[np.float64]) -> bool:
    """By the solid angle of its outward faces: a dome whose faces look inwards has no inside."""
    first_vertex, vertices = model.mesh_vertadr[mesh_id], model.mesh_vertnum[mesh_id]
    first_face, faces = model.mesh_faceadr[mesh_id], model.mesh_facenum[mesh_id]
    points = model.mesh_vert[first_vertex : first_vertex + vertices] - local
    a, b, c = points[model.mesh_face[first_face : first_face + faces].T].astype(np.float64)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ni,ni->n", a, b) * lc
        + np.einsum("ni,ni->n", b, c) * la
        + np.einsum("ni,ni->n", c, a) * lb
    )
    # Van Oosterom and Strackee (IEEE Trans. Biomed. Eng. 1983): the whole sphere is 4 pi.
    return bool(2 * np.arctan2(volume, below).sum() > 2 * np.pi)
