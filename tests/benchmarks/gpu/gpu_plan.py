"""How much `tests/benchmarks/gpu/bench_gpu.py` measures."""

from __future__ import annotations

from dataclasses import dataclass

from cost_stream import WINDOW_US
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.fusion import MEANS

PAPER = (*(f"Alg1/{name}" for name in MEANS), "EMVS/cam0", "EMVS/cam1")
PRECISIONS = ("fixed", "float")
LIMIT_MS = 100.0
"""What one whole call may take on an H200, from events in memory to depth maps."""


@dataclass(frozen=True)
class BenchmarkPlan:
    """Sizes and rounds; the defaults are those of the published table.

    Attributes:
        size_px: columns and rows of both cameras.
        events: events per camera.
        planes: depth planes.
        rounds: timed calls on the GPU, after one that compiles; the median counts.
        cpu_rounds: the same on the CPU.
        blocks: blocks of the kernel that measures atomic additions.
        threads: threads of a block.
        repeats: additions per thread.
        far_bytes: size of the grid that no cache holds.
        windows: half-second windows of the sliding-window sequence.
        cpu_windows: how many of them the CPU maps.
        window_events: events per camera and window.
        grow_events: events per camera as they grow.
        grow_planes: planes as they grow.
        grow_sizes: sensors as they grow.
        grow_rounds: timed calls of each of these loads.
        frame_rigs: rigs whose cameras are drawn.
        fine_rigs: rigs of whose cameras fine frames are made.
        frame_s: for how long pictures are drawn and counted, s.
    """

    size_px: tuple[int, int] = (1280, 720)
    events: int = 10_000_000
    planes: int = 100
    rounds: int = 7
    cpu_rounds: int = 2
    blocks: int = 2048
    threads: int = 256
    repeats: int = 2048
    far_bytes: int = 1 << 30
    windows: int = 12
    cpu_windows: int = 3
    window_events: int = 2_000_000
    grow_events: tuple[int, ...] = (1_250_000, 2_500_000, 5_000_000, 10_000_000, 20_000_000)
    grow_planes: tuple[int, ...] = (25, 50, 100, 200, 400)
    grow_sizes: tuple[tuple[int, int], ...] = ((346, 260), (640, 480), (1280, 720), (1920, 1080))
    grow_rounds: int = 3
    frame_rigs: tuple[str, ...] = ("davis346", "tumvie")
    fine_rigs: tuple[str, ...] = ("davis346", "tumvie", "tumvie-kb4")
    frame_s: float = 2.0

    def config(self, device: str, precision: str = "fixed", **more: object) -> MapperConfig:
        """The mapper's settings: every function of Algorithm 1 and both cameras alone."""
        fields: dict[str, object] = {
            "device": device, "voting_precision": precision, "methods": PAPER,
            "planes": self.planes, "duration_s": 1e-6 * WINDOW_US,
        }  # fmt: skip
        return MapperConfig.model_validate(fields | more)


QUICK = BenchmarkPlan(
    size_px=(16, 12), events=60, planes=2, rounds=1, cpu_rounds=1, blocks=2, threads=8, repeats=4,
    far_bytes=4096, windows=2, cpu_windows=1, window_events=60, grow_events=(30, 60),
    grow_planes=(2, 3), grow_sizes=((16, 12), (24, 18)), grow_rounds=1, frame_rigs=("davis346",),
    fine_rigs=("oblique",), frame_s=0.05,
)  # fmt: skip
"""Tiny: it shows that the script runs; its figures mean nothing."""
