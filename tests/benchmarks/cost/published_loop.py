"""The published voting loop beside this project's, in one run on one machine.

`python tests/benchmarks published_loop --page docs/performance.md` builds `published_loop.cpp`
with g++, lets both sides vote with the same events in turn, and writes the table. A ratio of times
means something only where both come from one machine and one moment.
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cost_limits import SENSORS, batches
from cost_stream import DEPTH_RANGE_M, WINDOW_US, MovingEdges
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.dsi.rays import PACKET, Rays, event_rays, grouped_by_rows, voters
from eventsweep.emvs.dsi.voting import Scratch, batch_planes
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.emvs.utils.runtime import use_threads
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from study_cost import machine

SOURCE = Path(__file__).with_suffix(".cpp")
COMPILER, OPTIONS = "g++", ("-O2", "-fopenmp", "-shared", "-fPIC")
EVENTS = {"346x260": 2_000_000, "640x480": 2_000_000, "1280x720": 4_000_000}
PLANES = 100
CAMERAS = 2

Floats = NDArray[np.float32]


class _View(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_float) for name in ("fx", "fy", "cx", "cy")),
        *((name, ctypes.c_int) for name in ("width", "height")),
    )

    @classmethod
    def of(cls, camera: Camera) -> _View:
        return cls(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px,
                   camera.width_px, camera.height_px)  # fmt: skip


def has_compiler() -> bool:
    """Whether the C++ side can be built here."""
    return shutil.which(COMPILER) is not None


@dataclass(frozen=True, eq=False)
class Located:
    """One camera's events where their rays meet the plane z = z0 of the reference view.

    Attributes:
        at_z0: (packets * PACKET, 2) pixels.
        centres: (packets, 3) where the camera was, m.
        z0_m: depth of the plane, m.
    """

    at_z0: Floats
    centres: Floats
    z0_m: float


class PublishedLoop:
    """The compiled program.

    Args:
        folder: where it is built.

    Raises:
        InputError: no compiler, or one that cannot build it.
    """

    def __init__(self, folder: Path) -> None:
        if not has_compiler():
            raise InputError(f"{COMPILER}: not found; install it to build {SOURCE.name}")
        library = folder / f"{SOURCE.stem}.so"
        built = subprocess.run([COMPILER, *OPTIONS, str(SOURCE), "-o", str(library)],
                               capture_output=True, text=True, check=False)  # fmt: skip
        if built.returncode != 0:
            line = (built.stderr.strip() or "no message").splitlines()[0]
            raise InputError(f"{COMPILER} cannot build {SOURCE.name}: {line}")
        self._library = ctypes.CDLL(str(library))
        self._library.cast_votes.restype = ctypes.c_int64
        self._threads = ctypes.CDLL("libgomp.so.1").omp_set_num_threads

    def located(
        self, events: Events, camera: Camera, T_body_cam: NDArray[np.float64],
        trajectory: Trajectory, T_world_rv: NDArray[np.float64], rv_camera: Camera, z0_m: float,
    ) -> Located:  # fmt: skip
        """Carries whole packets of events to the plane z = z0; one pose per packet."""
        kept, pose_us = voters(events, packets=True)
        packets = len(kept) // PACKET
        T_world_body = np.array([trajectory.at(int(t_us)) for t_us in pose_us[::PACKET]])
        T_rv_cam = se3.inverse(T_world_rv) @ T_world_body.reshape(-1, 4, 4) @ T_body_cam
        poses = np.ascontiguousarray(T_rv_cam[:, :3])
        bearings = np.ascontiguousarray(camera.bearing_table(), np.float64)
        located = Located(np.empty((len(kept), 2), np.float32),
                          np.empty((packets, 3), np.float32), z0_m)  # fmt: skip
        self._library.to_plane(
            _pointer(np.ascontiguousarray(kept.x)), _pointer(np.ascontiguousarray(kept.y)),
            ctypes.c_int64(packets), PACKET, _pointer(bearings), camera.width_px, _pointer(poses),
            _View.of(rv_camera), ctypes.c_double(z0_m), _pointer(located.at_z0),
            _pointer(located.centres),
        )  # fmt: skip
        return located

    def cast(self, located: Located, depths_m: Floats, camera: Camera, volume: Floats) -> int:
        """Adds votes to `volume` (N, H, W); returns how many counted."""
        return int(
            self._library.cast_votes(
                _pointer(located.at_z0), _pointer(located.centres),
                ctypes.c_int64(len(located.centres)), PACKET, _pointer(depths_m), len(depths_m),
                _View.of(camera), ctypes.c_float(located.z0_m), _pointer(volume),
            )
        )  # fmt: skip

    def use_threads(self, count: int) -> None:
        """How many threads share the planes."""
        self._threads(count)


def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


@dataclass(frozen=True)
class Contest:
    """Times of both sides on one stream, round by round.

    Attributes:
        sensor: its size in words.
        theirs_ns: of the published loop, ns per event and plane.
        ours_ns: of this project's, likewise.
    """

    sensor: str
    theirs_ns: tuple[float, ...]
    ours_ns: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Best against best."""
        return min(self.theirs_ns) / min(self.ours_ns)

    @property
    def typical_ratio(self) -> float:
        """Median of the ratios of single rounds, whose two halves met the same moment."""
        return median(a / b for a, b in zip(self.theirs_ns, self.ours_ns, strict=True))


def contest(
    loop: PublishedLoop, sensor: str, events: int, *, planes: int = PLANES, rounds: int = 5
) -> Contest:
    """Lets both sides vote in turn, on one thread.

    Args:
        loop: the published side.
        sensor: one of `cost_limits.SENSORS`.
        events: of each of two cameras.
        planes: of the volume.
        rounds: of each side, after one that does not count.
    """
    recording = MovingEdges(SENSORS[sensor], events, cameras=CAMERAS)
    rho = inverse_depth_planes(*DEPTH_RANGE_M, planes)
    runs = _theirs(loop, recording, rho), _ours(recording, rho)
    use_threads(1)
    loop.use_threads(1)
    found = [[run() for run in runs] for _ in range(rounds + 1)][1:]
    theirs_ns, ours_ns = zip(*found, strict=True)
    return Contest(sensor, theirs_ns, ours_ns)


def _ns_per_vote(cast: Callable[[], object], votes: int) -> float:
    """Processor time: on a machine that others use too, the clock would measure them."""
    begin = time.process_time()
    cast()
    return 1e9 * (time.process_time() - begin) / votes


def _theirs(loop: PublishedLoop, recording: MovingEdges, rho: Floats) -> Callable[[], float]:
    """Their volume is emptied outside of the time."""
    rig, motion = recording.rig, recording.trajectory
    view, depths_m = rig.cameras[0], (1 / rho[::-1]).astype(np.float32)
    depths_m = np.ascontiguousarray(depths_m)
    volume = np.empty((len(rho), view.height_px, view.width_px), np.float32)
    located = [
        loop.located(recording.events(k, 0, WINDOW_US), view, rig.T_body_cam[k], motion,
                     motion.at(WINDOW_US // 2), view, float(depths_m[0]))
        for k in range(len(rig))
    ]  # fmt: skip

    def cast_all() -> None:
        for one in located:
            loop.cast(one, depths_m, view, volume)

    def run() -> float:
        volume[:] = 0
        return _ns_per_vote(cast_all, sum(len(one.at_z0) for one in located) * len(rho))

    return run


def _ours(recording: MovingEdges, rho: Floats) -> Callable[[], float]:
    """Emptying the planes is part of the time."""
    rig, motion = recording.rig, recording.trajectory
    view = rig.cameras[0]
    rays = [
        grouped_by_rows(
            event_rays(recording.events(k, 0, WINDOW_US), view, rig.T_body_cam[k], motion,
                       motion.at(WINDOW_US // 2), view),
            float(rho[len(rho) // 2]), view.height_px,
        )
        for k in range(len(rig))
    ]  # fmt: skip
    votes = sum(map(len, rays)) * len(rho)
    return lambda: _ns_per_vote(partial(_sweep, rays, rho, view), votes)


def _sweep(rays: Sequence[Rays], rho: Floats, view: Camera) -> None:
    load = (len(rho), 1, view.width_px * view.height_px, len(rays))
    scratch = Scratch(len(rays), batch_planes(*load), view.width_px, view.height_px)
    for first, last in batches(*load):
        for camera, its_rays in enumerate(rays):
            scratch.cast(camera, its_rays, rho[first:last])


def table(contests: Sequence[Contest], events: int | None = None) -> str:
    """Markdown: ns per event and plane of both sides, best and median, and their ratios."""
    lines = ["| ns per event and plane, best (median) | published loop, C++ | this project "
             "| ratio of the best | median ratio |", "|---|--:|--:|--:|--:|"]  # fmt: skip
    for one in contests:
        count = EVENTS[one.sensor] if events is None else events
        theirs, ours = (f"{min(ns):.2f} ({median(ns):.2f})" for ns in (one.theirs_ns, one.ours_ns))
        lines.append(
            f"| {one.sensor}, {CAMERAS} × {count / 1e6:g} M events | {theirs} | {ours} "
            f"| {one.ratio:.1f} × | {one.typical_ratio:.1f} × |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Measures, prints the table, writes it into a page as asked; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="of each side")
    parser.add_argument("--events", type=int, help="per camera, less for a trial")
    parser.add_argument("--page", type=Path, help="page whose marked part gets the table")
    chosen = parser.parse_args(arguments)
    with exit_code() as code, tempfile.TemporaryDirectory() as folder:
        about = machine()
        loop = PublishedLoop(Path(folder))
        found = [
            contest(loop, sensor, chosen.events or events, rounds=chosen.rounds)
            for sensor, events in EVENTS.items()
        ]
        text = f"{about} {chosen.rounds} rounds.\n\n{table(found, chosen.events)}"
        show(text, chosen.page, "published")
    return code.value


if __name__ == "__main__":
    sys.exit(main())
