"""A first run compiles the mapper's kernels in another process, beside work that does not map.

That process maps a few made-up events by the run's own configuration: what a run calls is compiled,
and nothing else. The kernels come back through their cache (`emvs.utils.kernel_cache`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.kernel_cache import has_kernel
from eventsweep.emvs.utils.processes import end_with_parent

_FIRST = "voting_kernels.vote"  # every map needs it
_SPAN_US, _SPEED_M_S, _BASELINE_M, _POINTS = 100_000, 1.0, 0.1, 400
# What picks events of a recording, and what a made-up one does not have.
_OF_RECORDINGS = {
    "start_s", "duration_s", "window_s", "stride_s", "window_events", "stride_events", "min_events",
    "max_pose_gap_s", "hot_pixels", "reference_s", "min_depth_m", "max_depth_m", "save_dsi",
}  # fmt: skip


@contextmanager
def compiled_beside(config: MapperConfig, rig: Rig, say: Callable[[str], None]) -> Iterator[None]:
    """Compiles a mapper's kernels in another process if this is a first run; else does nothing.

    A second process pays off only where there is a second processor. It is waited for at the end;
    where it failed, a line says so, and what is missing is compiled when it is called.

    Args:
        config: what will be mapped with.
        rig: the cameras; their number and size count.
        say: takes a line for the user.
    """
    alone = len(os.sched_getaffinity(0)) < 2
    if alone or config.device != "cpu" or has_kernel(_FIRST):
        yield
        return
    say("first run: compiling the mapper in the background, about half a minute")
    size = rig.cameras[0].width_px, rig.cameras[0].height_px
    words = [*map(str, (len(rig), *size)), config.model_dump_json()]
    process = subprocess.Popen(
        [sys.executable, "-m", "eventsweep.emvs.rehearsal", *words],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield
        if process.wait():
            say(f"the process that compiles the mapper ended with {process.returncode}: slower run")
    finally:
        process.kill()
        process.wait()


@dataclass(frozen=True)
class Rehearsal:
    """A recording in memory: a rig slides sideways before points at 1 m."""

    cameras: int
    size_px: tuple[int, int]
    name = "rehearsal"
    depth_range_m = (0.5, 4.0)

    @property
    def rig(self) -> Rig:
        """Equal cameras, side by side."""
        width, height = self.size_px
        camera = Camera(width, height, width, width, (width - 1) / 2, (height - 1) / 2)
        places = [np.eye(4) for _ in range(self.cameras)]
        for k, T_body_cam in enumerate(places):
            T_body_cam[0, 3] = k * _BASELINE_M
        return Rig(self.name, (camera,) * self.cameras, tuple(places))

    @property
    def trajectory(self) -> Trajectory:
        """Constant speed along x."""
        t_us = np.linspace(0, _SPAN_US, 11).astype(np.int64)
        position_m = np.outer(1e-6 * t_us * _SPEED_M_S, [1.0, 0.0, 0.0])
        return Trajectory(t_us, position_m, np.tile([0.0, 0.0, 0.0, 1.0], (len(t_us), 1)))

    def event_span_us(self, camera: int) -> tuple[int, int]:  # noqa: ARG002
        """The whole of it, for every camera."""
        return 0, _SPAN_US - 1

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Each point, seen at random times."""
        rng, (width, height) = np.random.default_rng(0), np.array(self.size_px)
        u_px, y = rng.uniform(0, width, _POINTS), rng.integers(0, height, _POINTS)
        t_us = np.sort(rng.integers(0, _SPAN_US, 20 * _POINTS))
        t_us[[0, -1]] = 0, _SPAN_US - 1
        point = rng.integers(0, _POINTS, len(t_us))
        moved_m = 1e-6 * _SPEED_M_S * t_us + camera * _BASELINE_M
        x = np.mod(np.rint(u_px[point] - width * moved_m), width)
        p = point % 2
        events = Events(x.astype(np.uint16), y[point].astype(np.uint16), t_us, p.astype(np.uint8))
        return events.between(t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:  # noqa: ARG002
        """There are no frames."""
        return None


if __name__ == "__main__":
    end_with_parent()
    _cameras, _width, _height = map(int, sys.argv[1:4])
    _config = MapperConfig.model_validate_json(sys.argv[4]).model_dump(exclude=_OF_RECORDINGS)
    map_window(Rehearsal(_cameras, (_width, _height)), MapperConfig(**_config))
