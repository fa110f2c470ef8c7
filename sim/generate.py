"""Scene, rig and configuration in; a sequence on disk out."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from emvs.atomic import refuse_existing
from emvs.data.events import Events
from emvs.data.rig import Rig
from emvs.data.writer import SequenceWriter
from emvs.errors import InputError
from sim.config import SimConfig
from sim.esim import EventSimulator
from sim.motion import sampled
from sim.renderer import StereoRenderer
from sim.sampling import Exposure, exposures, truth_times_us
from sim.scene import Scene

Progress = Callable[[int, int, int], None]
"""Called after every frame with time done, time in total (µs) and events written so far."""


def _silent(_done_us: int, _total_us: int, _events: int) -> None:
    pass


def simulate(
    scene: Scene,
    rig: Rig,
    config: SimConfig,
    seed: int,
    out: Path,
    *,
    force: bool = False,
    progress: Progress = _silent,
) -> Path:
    """Simulates what the rig's event cameras see and writes the sequence to `out`.

    The same arguments give identical bytes on the same machine and graphics library.

    Args:
        scene: geometry, textures and motion.
        rig: pinhole cameras; the scene's motion moves its body.
        config: every parameter.
        seed: non-negative; handed to the scene's motion, which draws its phases from it.
        out: folder to write; appears only when complete.
        force: replace `out` if it exists.
        progress: called after every frame.

    Returns:
        `out`.

    Raises:
        InputError: no graphics library, an existing `out` without `force`, a negative seed, motion
            too fast for the frame interval, or a scene that cannot be built.
    """
    if seed < 0:
        raise InputError(f"seed {seed}: must be 0 or greater")
    refuse_existing(out, force=force)
    duration_us = _duration_us(scene, config)
    motion = scene.motion(duration_us * 1e-6, seed)
    truth_us = truth_times_us(duration_us, round(config.truth_interval_s * 1e6))
    with (
        StereoRenderer(scene.spec(), rig, config.supersample, scene.depth_range_m) as renderer,
        SequenceWriter(
            out,
            name=scene.name,
            rig=rig,
            trajectory=sampled(motion, duration_us * 1e-6, config.pose_rate_hz),
            config=config.model_dump(mode="json"),
            seed=seed,
            renderer=renderer.description,
            depth_range_m=scene.depth_range_m,
            force=force,
        ) as writer,
        ThreadPoolExecutor(len(rig)) as pool,
    ):
        cameras = _Cameras(rig, config, writer, pool)
        for exposure in exposures(renderer, motion, truth_us, config):
            cameras.take(exposure)
            if exposure.t_us in truth_us:
                _write_truth(renderer, writer, exposure)
            if exposure.t_us == duration_us:
                cameras.flush()
            progress(exposure.t_us, duration_us, cameras.total)
    return out


class _Cameras:
    """One event simulator per camera, at work while the next pictures are drawn."""

    def __init__(self, rig: Rig, config: SimConfig, writer: SequenceWriter, pool: Executor) -> None:
        self._simulators = [EventSimulator(c.width_px, c.height_px, config) for c in rig.cameras]
        self._writer, self._pool = writer, pool
        self._pending: list[Future[Events]] | None = None
        self.total = 0

    def take(self, exposure: Exposure) -> None:
        """Hands over the next pictures; the events before them are written first."""
        started = self._pending is not None
        self.flush()
        self._pending = []
        for simulator, frame in zip(self._simulators, exposure.frames, strict=True):
            if started:
                step = self._pool.submit(simulator.step, frame.intensity, exposure.t_us)
                self._pending.append(step)
            else:
                simulator.start(frame.intensity, exposure.t_us)

    def flush(self) -> None:
        """Writes the events of the pictures handed over last."""
        for k, step in enumerate(self._pending or ()):
            events = step.result()
            self._writer.append_events(k, events)
            self.total += len(events)
        self._pending = []


def _write_truth(renderer: StereoRenderer, writer: SequenceWriter, exposure: Exposure) -> None:
    for k, frame in enumerate(exposure.frames):
        intensity = np.rint(255 * np.clip(frame.intensity, 0, 1)).astype(np.uint8)
        depth_m = renderer.depth(k, exposure.T_world_body)
        writer.append_truth(k, exposure.t_us, depth_m, intensity)


def _duration_us(scene: Scene, config: SimConfig) -> int:
    duration_s = scene.duration_s if config.duration_s is None else config.duration_s
    duration_us = round(duration_s * 1e6)
    if duration_us < 2:
        raise InputError(f"duration_s={duration_s}: a sequence lasts at least 2 µs")
    return duration_us
