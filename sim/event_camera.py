"""Event cameras in a simulation that somebody else runs: one call next to each `mj_step`.

Between two calls joints move at constant velocity, see `sim.model.tracks`; frames are as many as
the image motion asks for, and one at every call. Events are those of `simulate` for the same states
and times (`SimConfig.frame_period_us`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.errors import InputError, check_type
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.sim.config import SimConfig
from eventsweep.sim.geoms import moving_geoms
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.model.mounts import find_mount, rig_of_cameras
from eventsweep.sim.model.scenes import FixedMotion, clip_of
from eventsweep.sim.model.survey import (
    ends_m,
    glanced_beyond_8_bits,
    needs_floats,
    range_of,
)
from eventsweep.sim.model.tracks import LiveMotion, LiveTrack
from eventsweep.sim.parallel.render_job import (
    ChunkRenderer,
    RenderedFrame,
    RenderJob,
    chunk_bounds_us,
    longest_chunk_us,
)
from eventsweep.sim.parallel.sensors import Cameras, Packet, write_events, write_truth
from eventsweep.sim.rendering.base import Renderer, finer, moving_ids
from eventsweep.sim.rendering.drawing import decided, drawing_of
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.sampling import with_sampling
from eventsweep.sim.scene import Scene

Pose = NDArray[np.float64]
_FOR_EVER_US = 1 << 62
# Ground truth that looks ahead.
_AHEAD = {"flow", "twist"}


class EventRig:
    """Event cameras on a body, site or camera of a model that your own loop steps.

        rig = EventRig(model, "head", rig="davis346")
        while data.time < 1:
            mujoco.mj_step(model, data)
            left, right = rig.step(data)

    A rig belongs to the thread that made it, holds a graphics context, and is closed by `close` or
    as a context.

    Args:
        model: a compiled `mujoco.MjModel`; a copy of its looks is taken, so that later changes of
            colours, sizes or textures are not seen.
        mount: what carries the rig: a name, or `body:NAME`, `site:NAME`, `camera:NAME`. Bodies and
            sites look along x, z up.
        rig: the cameras, by name or by the path of a calibration; or names of the model's own
            cameras, all on one body.
        config: every parameter; by default the benchmark's.
        seed: of the sensor's noise.
        T_mount_body: (4, 4) where the rig's body sits on the mount, axes right, down, forward.
        record: folder of a sequence to write while it runs.
        force: whether `record` replaces a sequence.
        notice: called with one line where light is drawn in floats, because at the first call much
            of the view is too dark or too bright for 8 bits.

    Raises:
        InputError: an unknown mount, rig or camera, an impossible value, no graphics library, or a
            folder that may not be replaced.
    """

    def __init__(
        self,
        model: Any,
        mount: str,
        rig: Rig | str | tuple[str, ...] = "davis346",
        *,
        config: SimConfig | None = None,
        seed: int = 0,
        T_mount_body: Pose | None = None,
        record: str | Path | None = None,
        force: bool = False,
        notice: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self._mj: Any = import_mujoco()
        check_type("model", model, self._mj.MjModel, "a compiled mujoco.MjModel")
        if not isinstance(rig, Rig):
            rig = named_rig(rig) if isinstance(rig, str) else rig_of_cameras(model, tuple(rig))
        self.rig = rig
        self._mount = find_mount(model, mount)
        self._track, self._model = LiveTrack(), model
        self._motion = LiveMotion(model, self._track, self._mount, _pose(T_mount_body))
        self._config, self._seed = decided(SimConfig.or_default(config)), seed
        if record is not None and _AHEAD & set(self._config.truth):
            raise InputError(
                "truth flow and twist look ahead, which a running robot cannot: leave them out"
            )
        if record is not None:
            check_output(Path(record), force=force)
        self._chunk, self._record, self._force = -1, record, force
        self._notice = notice
        self._open_parts = ExitStack()
        self._truth_us = round(self._config.truth_interval_s * 1e6)
        self._recorder: _Recorder | None = None
        self._chunks: ChunkRenderer | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: Any) -> None:
        self._open_parts.__exit__(*raised)

    def close(self) -> None:
        """Frees the graphics context; a sequence that is being recorded is completed."""
        self._open_parts.close()

    def step(self, data: Any) -> tuple[Events, ...]:
        """What the cameras send between the last call and this one.

        Args:
            data: the model's state, at a later time than in the last call.

        Returns:
            Per camera, the events, with times in µs from the first call's; none of the first call.

        Raises:
            InputError: time did not go on by 1 µs, or motion too fast.
        """
        if self._chunks is None:
            self._begin(data)
            return tuple(Events.empty() for _ in self.rig.cameras)
        t_us = self._time_us(data)
        sent: list[list[Events]] = [[] for _ in self.rig.cameras]
        for frame in self._frames(self._track.push(t_us, data), t_us):
            self._cameras.take(frame)
            packets = self._cameras.collect()
            for camera, packet in zip(sent, packets, strict=False):
                camera.append(packet.events)
            if self._recorder is not None:
                self._recorder.add(packets, frame, self._motion.T_world_body(1e-6 * frame.t_us))
        if self._recorder is not None:
            self._recorder.moved(t_us, self.T_world_body)
        return tuple(Events.concat(parts) for parts in sent)

    @property
    def t_us(self) -> int:
        """Time of the last call, µs from the first."""
        return self._track.now_us

    @property
    def T_world_body(self) -> Pose:
        """Pose (4, 4) of the rig's body at the last call."""
        self._check_begun()
        return self._motion.T_world_body(1e-6 * self.t_us)

    def depth_m(self, camera: int = 0) -> NDArray[np.float32]:
        """Exact z-depth (H, W) of a camera's pixels at the last call, m; inf without a surface."""
        self._check_begun()
        self._renderer.at(1e-6 * self.t_us)
        return self._renderer.depth(camera, self.T_world_body)

    def intensity(self, camera: int = 0) -> NDArray[np.float32]:
        """(H, W) linear light of a camera's pixels at the last call."""
        self._check_begun()
        self._renderer.at(1e-6 * self.t_us)
        return self._renderer.frame(camera, self.T_world_body).intensity

    def _frames(self, before_us: int, t_us: int) -> Iterator[RenderedFrame]:
        """All pictures between two calls, in chunks as `simulate` has them."""
        assert self._chunks is not None
        job = self._chunks.job
        first, every_us = before_us // self._truth_us + 1, self._truth_us
        truth_us = range(first * every_us, t_us, every_us) if self._recorder is not None else ()
        longest_us = longest_chunk_us(job.config, self.rig)
        bounds_us = chunk_bounds_us([before_us, *truth_us, t_us], longest_us)
        for stops_us in pairwise(bounds_us):
            self._chunk += 1
            self._chunks.order(self._chunk, stops_us[0])
            yield from self._chunks.between(list(stops_us), self._chunk, begins=self._chunk == 0)

    def _begin(self, data: Any) -> None:
        self._start_s = float(data.time)
        self._track.begin(data)
        job = self._lit(self._job())
        self._renderer: Renderer = self._open_parts.enter_context(job.renderer())
        pool = self._open_parts.enter_context(ThreadPoolExecutor(len(self.rig)))
        self._cameras = Cameras(job, pool, None)
        if self._record is not None:
            self._recorder = self._open_parts.enter_context(
                _Recorder(Path(self._record), job, self._renderer, self._cameras, force=self._force)
            )
            self._recorder.moved(0, self._motion.T_world_body(0.0))
        self._chunks = ChunkRenderer(job, self._renderer)

    def _job(self, *, hdr: bool = False) -> RenderJob:
        """What `simulate` would render, but for its times."""
        clip_m, config = clip_of(self._model), self._config
        T_start = self._motion.T_world_body(0.0)
        fixed = config.model.headlight == "fixed"
        moves = moving_geoms(self._model).any()
        scene = Scene(
            "robot", "a model that somebody else steps", Path(), dict, FixedMotion(self._motion),
            clip_m, animate=self._track if moves else None, clip_m=clip_m, hdr=hdr,
            lamp_at=T_start if fixed else None,
        )  # fmt: skip
        drawing = drawing_of(config, self._model)
        floats = config.light.floats(scene.hdr)
        config = with_sampling(
            config, self.rig, drawing.why_plain(scene), floats=floats, finer=finer(drawing)
        )
        truth_us = range(0, _FOR_EVER_US, self._truth_us) if self._record is not None else ()
        return RenderJob(scene, self.rig, config, self._seed, truth_us, (0, 1), drawing)

    def _lit(self, job: RenderJob) -> RenderJob:
        """The job whose light what is seen now needs, as `sim.model.survey` decides it."""
        if job.config.light.chosen:
            return job
        with job.drawing.open(job.scene, job.rig, 1, floats=True, border_px=None) as seen:
            beyond = glanced_beyond_8_bits(seen, self._motion, [0.0], job.config, cut=False)
        floats = needs_floats(job.scene.name, beyond, self._notice)
        return self._job(hdr=True) if floats else job

    def _check_begun(self) -> None:
        if self._chunks is None:
            raise InputError("no events yet: call step with the model's data first")

    def _time_us(self, data: Any) -> int:
        t_us = round((float(data.time) - self._start_s) * 1e6)
        if t_us <= self._track.now_us:
            raise InputError(
                f"step at {data.time:g} s, not later than the last one: call it after mj_step, and "
                "make a new camera after a reset"
            )
        return t_us


class EventCamera(EventRig):
    """One event camera on a model that your own loop steps; see `EventRig`.

        camera = EventCamera(model, "head_left", Camera(346, 260, 226, 226, 172.5, 129.5))
        while data.time < 1:
            mujoco.mj_step(model, data)
            events = camera.step(data)

    Args:
        model: a compiled `mujoco.MjModel`.
        mount: what carries it: a camera, site or body of the model.
        camera: its lens and size; by default those of the model's camera that it is mounted on.
        options: of `EventRig`: `config`, `seed`, `T_mount_body`, `record`, `force`, `notice`.

    Raises:
        InputError: what `EventRig` refuses, or no camera and no resolution on the mount.
    """

    def __init__(
        self, model: Any, mount: str, camera: Camera | None = None, **options: Any
    ) -> None:
        rig: Rig | tuple[str, ...]
        if camera is None:
            check_type("model", model, import_mujoco().MjModel, "a compiled mujoco.MjModel")
            rig = (_camera_name(model, mount),)
        else:
            check_type("camera", camera, Camera)
            rig = Rig("camera", (camera,), (np.eye(4),))
        super().__init__(model, mount, rig, **options)

    def step(self, data: Any) -> Events:  # type: ignore[override]  # one camera, no tuple
        """What the camera sends between the last call and this one; see `EventRig.step`."""
        return super().step(data)[0]

    @property
    def camera(self) -> Camera:
        """Its lens and size."""
        return self.rig.cameras[0]

    @property
    def T_world_cam(self) -> Pose:
        """Pose (4, 4) at the last call, axes right, down, forward."""
        return self.T_world_body


def _camera_name(model: Any, mount: str) -> str:
    place = find_mount(model, mount)
    if place.kind != "camera":
        raise InputError(
            f"{place.kind} {place.name!r} has no lens model: give a Camera, or mount on a "
            "camera of the model"
        )
    return place.name


def _pose(T: Pose | None) -> Pose:
    if T is not None and (fault := se3.fault(np.asarray(T))):
        raise InputError(
            f"T_mount_body is not a rigid (4, 4) transform ({fault}): give a rotation and a "
            "translation"
        )
    return np.eye(4) if T is None else np.asarray(T, np.float64)


class _Recorder:
    """Writes what the cameras send, with poses of every call and truth as often as asked."""

    def __init__(
        self, out: Path, job: RenderJob, renderer: Renderer, cameras: Cameras, *, force: bool
    ) -> None:
        segments = "segmentation" in job.config.truth
        self._writer = SequenceWriter(
            out, name=out.name, rig=job.rig, trajectory=None, seed=job.seed,
            config=job.config.model_dump(mode="json"), renderer=renderer.description,
            geoms=renderer.geoms if segments else None, force=force,
        )  # fmt: skip
        self._labelled, self._cameras, self._renderer = job.labelled, cameras, renderer
        self._moves = moving_ids(renderer)
        self._ends_m: list[float] = []
        self._t_us: list[int] = []
        self._T_world_body: list[Pose] = []

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        if kind is None and len(self._t_us) < 2:
            kind, error = InputError, InputError("nothing was recorded: call step at least twice")
        elif kind is None:
            poses = Trajectory.from_matrices(np.array(self._t_us), np.array(self._T_world_body))
            counts = self._cameras.finish()
            self._writer.trajectory = poses
            self._writer.depth_range_m = range_of(self._ends_m)
            self._writer.sensor_counts = counts if self._labelled else None
        self._writer.__exit__(kind, error, trace)
        if trace is None and error is not None:
            raise error

    def add(self, packets: list[Packet], frame: RenderedFrame, T_world_body: Pose) -> None:
        """Adds events, and a frame's ground truth where it has some."""
        write_events(self._writer, packets)
        write_truth(self._writer, frame)
        for k, images in enumerate(frame.truth):
            still = ~self._moves[self._renderer.segmentation(k, T_world_body)]
            self._ends_m += ends_m(images["depth_m"][still])

    def moved(self, t_us: int, T_world_body: Pose) -> None:
        """Notes where the rig is."""
        self._t_us.append(t_us)
        self._T_world_body.append(T_world_body)
