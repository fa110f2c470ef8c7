"""Where a simulation's time goes: `python tests/benchmarks simulate_stages`.

    python tests/benchmarks simulate_stages --page docs/simulator.md

Runs one stage at a time, where a simulation has several at work, so that the time of all processors
belongs to one of them, the graphics library's threads included.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.raster.picture import Painter
from eventsweep.sim import simulate
from eventsweep.sim.compensation import fine_frame, interval
from eventsweep.sim.config import SimConfig
from eventsweep.sim.parallel import checkpoint, render_job, sensors
from eventsweep.sim.rendering import (
    adaptive_sampling,
    box_kernels,
    draw_target,
    light_shader,
    pixel_kernels,
    renderer,
)
from eventsweep.sim.rigs import rig
from eventsweep.sim.scene import Scene
from eventsweep.sim.sensor import compensated_kernels
from markdown_blocks import show
from table_code import Code, of_scenes

REST = "everything else"
# Owner, function, stage; the time of a stage inside another counts for the inner one.
STAGES: tuple[tuple[Any, str, str], ...] = (
    (renderer.StereoRenderer, "_render", "draw, read back"),
    (draw_target.DrawTarget, "read", "draw, read back"),
    (draw_target.DrawTarget, "read_depth", "draw, read back"),
    (Painter, "draw", "draw, read back"),
    (Painter, "paint", "draw, read back"),
    (Painter, "through_lens", "draw, read back"),
    (light_shader.ShaderLight, "take", "light of samples and pixels"),
    (pixel_kernels, "luma", "light of samples and pixels"),
    (pixel_kernels, "resampled", "light of samples and pixels"),
    (fine_frame, "box_mean", "light of samples and pixels"),
    (fine_frame, "cell_depths", "reach of light"),
    (interval, "find_layers", "find layers"),
    (box_kernels, "inverse_depth", "light of samples and pixels"),
    (box_kernels, "nearest_of_pixels", "light of samples and pixels"),
    (box_kernels, "pixel_means", "light of samples and pixels"),
    (render_job.ChunkRenderer, "_truth", "truth"),
    (adaptive_sampling._View, "moved_px", "choose times"),
    (fine_frame, "cell_range", "reach of light"),
    (fine_frame, "spread_most", "reach of light"),
    (compensated_kernels, "events_between", "follow pixels"),
    (sensors.Cameras, "_step", "sensor, order of events"),
    (simulate, "write_events", "write"),
    (simulate, "write_truth", "write"),
    (checkpoint.CheckpointFolder, "commit", "write"),
    (simulate, "_assemble", "write"),
)
ORDER = (*dict.fromkeys(stage for *_, stage in STAGES), REST)


class Case(NamedTuple):
    """What is simulated."""

    name: str
    scene: Scene
    rig: Rig
    config: SimConfig


@dataclass
class Stopwatch:
    """Time of all processors by stage, s."""

    def __post_init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)
        self._stage, self._since_s = REST, time.process_time()

    @contextmanager
    def of(self, stage: str) -> Iterator[None]:
        """Books the time within on a stage."""
        before = self._turn(stage)
        try:
            yield
        finally:
            self._turn(before)

    def _turn(self, stage: str) -> str:
        now_s, before = time.process_time(), self._stage
        self.spent_s[before] += now_s - self._since_s
        self._stage, self._since_s = stage, now_s
        return before

    def watched(self, owner: Any, name: str, stage: str) -> Any:
        """A patch that books every call of a function."""
        inner = getattr(owner, name)

        def timed(*args: Any, **options: Any) -> Any:
            with self.of(stage):
                return inner(*args, **options)

        return mock.patch.object(owner, name, timed)


class AtOnce(Executor):
    """Stands in for threads: what is submitted is done before `submit` returns."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def submit(self, work: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        """Calls `work`."""
        future: Future[Any] = Future()
        future.set_result(work(*args, **options))
        return future


@dataclass(frozen=True)
class Measured:
    """What one simulation took.

    Attributes:
        stages_s: processor time by stage, s.
        frames: how many were drawn, of each camera.
        events: how many came out, of all cameras.
        seconds: that were simulated.
    """

    stages_s: dict[str, float]
    frames: int
    events: int
    seconds: float

    @property
    def total_s(self) -> float:
        """Processor time, s."""
        return sum(self.stages_s.values())


def measured(case: Case) -> Measured:
    """Simulates once, from the first frame on; what comes before is not counted."""
    calls: list[tuple[str, int, int]] = []
    clock = Stopwatch()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        stack.enter_context(mock.patch.object(simulate, "ThreadPoolExecutor", AtOnce))
        for stage in STAGES:
            stack.enter_context(clock.watched(*stage))
        stack.enter_context(mock.patch.object(simulate, "_run", _begun(clock)))
        out = simulate.simulate(
            case.scene, case.rig, case.config, 0, Path(folder) / "s",
            progress=lambda *call: calls.append(call),
        )  # fmt: skip
        clock._turn(REST)
        events = sum(Sequence.open(out).manifest.event_counts)
    return Measured(dict(clock.spent_s), len(calls), events, 1e-6 * calls[-1][2])


def _begun(clock: Stopwatch) -> Callable[..., Any]:
    """`simulate._run`, which forgets what was measured before."""
    inner = simulate._run

    def run(*args: Any, **named: Any) -> None:
        clock._turn(REST)
        clock.spent_s.clear()
        inner(*args, **named)

    return run


def case(scene: str, rig_name: str, seconds: float, **settings: Any) -> Case:
    """A scene on a rig."""
    config = SimConfig(duration_s=seconds, **settings)
    return Case(f"{scene}, {rig_name}", scenes.load(scene), rig(rig_name), config)


def stage_cases() -> list[Case]:
    """Small and large sensors, little and much motion, a lens that distorts."""
    return [
        case("boxes", "davis346", 0.5),
        case("desk", "davis346", 0.5),
        case("mvsec-flying", "mvsec", 0.5),
        case("dsec-street", "dsec", 0.1),
        case("tumvie-6dof", "tumvie", 0.1),
        case("desk", "tumvie", 0.1),
    ]


def stage_table(cases: list[Case]) -> str:
    """Processor time per simulated second, by stage."""
    measurements = [measured(one) for one in cases]
    lines = [
        "Processor seconds per simulated second; without imports and the scene's making, see "
        "[first runs](gate.md#gate-your-mapper-in-ci).",
        "",
        f"| | {' | '.join(one.name for one in cases)} |",
        f"|---|{'--:|' * len(cases)}",
    ]
    for stage in ORDER:
        cells = [f"{one.stages_s.get(stage, 0) / one.seconds:.1f}" for one in measurements]
        lines.append(f"| {stage} | {' | '.join(cells)} |")
    totals = [f"**{one.total_s / one.seconds:.1f}**" for one in measurements]
    rates = [f"{one.frames / one.seconds:.0f}" for one in measurements]
    events = [f"{one.events / one.seconds / 1e6:.1f}" for one in measurements]
    lines += [
        f"| **together** | {' | '.join(totals)} |",
        f"| frames per camera and second | {' | '.join(rates)} |",
        f"| million events per second | {' | '.join(events)} |",
    ]
    return "\n".join(lines) + "\n"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "docs/simulator.md#simulate-stages": Code(("simulate_stages:stage_table",))
        + of_scenes(one.name.partition(",")[0] for one in stage_cases())
    }


def main() -> None:
    """Measures, and writes the tables into a page where there is one."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    about = machine()
    measured(case("desk", "davis346", 0.05))  # compiles the kernels
    show(f"{about}\n\n{stage_table(stage_cases())}", asked.page, "simulate-stages", code)


def machine() -> str:
    """The processors as Linux tells them, and how busy they are with other work."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    load = os.getloadavg()[0]
    state = "quiet" if load < 0.5 else "busy with other work"
    what = f"{os.cpu_count()} × {names[0] if names else platform.machine()}"
    return f"{what}; load average {load:.1f} before the measurement: {state}."


if __name__ == "__main__":
    main()
