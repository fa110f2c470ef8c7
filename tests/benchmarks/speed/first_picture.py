"""What happens before the first picture: `python tests/benchmarks first_picture [SCENE ...]`.

    python tests/benchmarks first_picture desk tumvie-6dof --page docs/performance.md

Every run is a process of its own: `eventsweep simulate SCENE`, ended when the first picture is
there. *Warm*: kernels and textures are kept from before. *Cold*: as after an installation, both
folders are empty. Times are of processors, each stage without those inside it; wall time runs from
the start of the process. Of several runs the median counts.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import _bootstrap
from pathlib import Path
from typing import Any, NamedTuple

MARK = "first-picture"
STATES = ("warm", "cold")
IMPORTS, PICTURE, REST = "imports", "the picture", "everything else"
# What a stage is made of: module, attributes, stage.
STAGES = (
    ("numba.core.dispatcher", "Dispatcher.compile", "kernels"),
    ("eventsweep.sim.scene", "Scene.spec", "geometry and shadows"),
    ("eventsweep.sim.rendering.lens", "lens_of", "lens tables"),
    ("eventsweep.sim.rendering.renderer", "_compiled", "MuJoCo's compiler"),
    ("eventsweep.sim.rendering.renderer", "open_context", "graphics context"),
    ("mujoco", "MjrContext", "textures onto the card"),
    ("eventsweep.sim.rendering.renderer", "StereoRenderer.frame", PICTURE),
)
TEXTURES = "textures"
ORDER = (IMPORTS, TEXTURES, *dict.fromkeys(stage for *_, stage in STAGES), REST)


class Cost(NamedTuple):
    """What one run took, s: CPU time by stage, and wall-clock time in all."""

    stages_s: dict[str, float]
    wall_s: float


class Stopwatch:
    """Time of processors by stage; a stage inside another does not count for that one."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)
        self._stage, self._since_s = IMPORTS, 0.0  # the interpreter's own start is among them

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time inside for the stage."""
        before = self._to(name)
        try:
            yield
        finally:
            self._to(before)

    def watch(self, inner: Callable[..., Any], name: str) -> Callable[..., Any]:
        """A function whose time counts for the stage."""

        @functools.wraps(inner)
        def watched(*args: Any, **kwargs: Any) -> Any:
            with self.stage(name):
                return inner(*args, **kwargs)

        return watched

    def _to(self, name: str) -> str:
        now_s, before = time.process_time(), self._stage
        self.spent_s[before] += now_s - self._since_s
        self._stage, self._since_s = name, now_s
        return before


class _Done(BaseException):
    """The first picture is there."""


def child(scene: str, out: str) -> None:
    """Runs the command up to its first picture and prints the stages as JSON."""
    watch = Stopwatch()
    # Called for what is not loaded yet: a watch on `__import__` would cost more than it measures.
    bootstrap: Any = _bootstrap
    load = watch.watch(bootstrap._find_and_load, IMPORTS)

    def loaded(name: str, import_: Any) -> Any:
        module = load(name, import_)
        _watch_stages(watch, name, module)
        return module

    bootstrap._find_and_load = loaded
    sys.argv = ["eventsweep", "simulate", scene, "--seconds", "0.01", "--out", out, "--quiet"]
    with watch.stage(REST):
        from eventsweep.__main__ import main

        try:
            main()
        except _Done:
            sys.stdout.write(json.dumps(watch.spent_s))
            sys.stdout.flush()
            os._exit(0)
    sys.exit("it ended without a picture")


def _watch_stages(watch: Stopwatch, name: str, module: Any) -> None:
    """Puts watches into a module that was just imported."""
    for _, names, stage in (one for one in STAGES if one[0] == name):
        *owners, function = names.split(".")
        owner = functools.reduce(getattr, owners, module)
        watched = watch.watch(getattr(owner, function), stage)
        setattr(owner, function, _ending(watched) if stage == PICTURE else watched)
    if name == "scenes":
        module.load = _drawing(watch, module.load)


def _drawing(watch: Stopwatch, load: Callable[[str], Any]) -> Callable[[str], Any]:
    def watched(name: str) -> Any:
        scene = load(name)
        return replace(scene, textures=watch.watch(scene.textures, TEXTURES))

    return watched


def _ending(picture: Callable[..., Any]) -> Callable[..., Any]:
    def ended(*args: Any, **kwargs: Any) -> None:
        picture(*args, **kwargs)
        raise _Done

    return ended


def measured(scene: str, kept: Path | None) -> Cost:
    """Runs it in a process of its own, with what is kept below a folder, or in empty ones."""
    with tempfile.TemporaryDirectory() as folder:
        home = kept or Path(folder)
        places = {"EVENTSWEEP_CACHE": str(home / "cache"), "NUMBA_CACHE_DIR": str(home / "kernels")}
        command = [sys.executable, __file__, "--child", scene, f"{folder}/out"]
        began_s = time.perf_counter()
        done = subprocess.run(command, env={**os.environ, **places}, capture_output=True, text=True)
        wall_s = time.perf_counter() - began_s
    if done.returncode:
        sys.exit(f"{scene}: {done.stderr}")
    return Cost(json.loads(done.stdout), wall_s)


def median_of(runs: Sequence[Cost]) -> Cost:
    """Stage by stage."""
    stages_s = {s: statistics.median(run.stages_s.get(s, 0.0) for run in runs) for s in ORDER}
    return Cost(stages_s, statistics.median(run.wall_s for run in runs))


def table(costs: dict[tuple[str, str], Cost]) -> str:
    """A row for each stage, a column for each scene and state."""
    head = "| CPU seconds until the first picture |"
    lines = [head + "".join(f" {scene}, {state} |" for scene, state in costs)]
    lines.append("|---|" + "--:|" * len(costs))
    for stage in ORDER:
        row = "".join(f" {cost.stages_s[stage]:.2f} |" for cost in costs.values())
        lines.append(f"| {stage} |{row}")
    sums = "".join(f" **{sum(cost.stages_s.values()):.2f}** |" for cost in costs.values())
    walls = "".join(f" {cost.wall_s:.2f} |" for cost in costs.values())
    return "\n".join([*lines, f"| **together** |{sums}", f"| wall-clock time, s |{walls}"])


def main() -> None:
    """Measures and prints; with `--page` also writes the table there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=["desk", "tumvie-6dof"])
    parser.add_argument("--runs", type=int, default=5, help="warm ones; a third as many cold")
    parser.add_argument("--page", type=Path, help="page whose table is replaced")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(*options.child)
    # Only here: what this file imports at the top counts for every child.
    from markdown_blocks import show
    from study_cost import machine

    about = machine()
    costs: dict[tuple[str, str], Cost] = {}
    for scene in options.scenes:
        with tempfile.TemporaryDirectory() as folder:
            measured(scene, Path(folder))
            warm = [measured(scene, Path(folder)) for _ in range(options.runs)]
        cold = [measured(scene, None) for _ in range(max(1, options.runs // 3))]
        costs |= {(scene, s): median_of(runs) for s, runs in zip(STATES, (warm, cold), strict=True)}
    text = f"{about}\n\n{table(costs)}\n"
    show(text, options.page, MARK)


if __name__ == "__main__":
    main()
