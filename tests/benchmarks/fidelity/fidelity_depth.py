"""Whether depth from simulated events is as good as from true ones, in the worlds of `fidelity`.

A stereo pair of the case's camera maps each still world twice: from the events that the simulator
makes by default, and from those of the ray caster. Both maps are scored against the same truth.
Maps of so few pixels have few points: a case is mapped as it stands and with sizes, speeds and
textures drawn by each of `SEEDS`, and its points are taken together.

Run: python tests/benchmarks fidelity_depth --truth FOLDER [CASE ...] [--page docs/simulator.md].
True events are kept in FOLDER.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import eventsweep as es
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.config import EvalConfig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from fidelity import ray_truth
from markdown_blocks import show
from panel_cases import CASES, PanelCase, panel_case
from panel_scene import panel_rig, panel_scene

METHODS = ("Alg1/H", "Focus/H")
SEEDS = (None, 2028, 2029)
MARK = "fidelity-depth"
_REGION = "all"
# Of the nearest depth: parallax of the pair, as large as that of the motion.
_BASELINE = 0.06
_HEAD = """\
How much larger the mean depth error is from the simulator's events than from the ray caster's, \
and points of both maps, three draws of each case together. Written by \
`python tests/benchmarks fidelity_depth`.
"""


class Scored(NamedTuple):
    """A map's mean error, m, and its points."""

    error_m: float
    points: int


class Pair(NamedTuple):
    """A method's scores from simulated events and from true ones."""

    simulated: Scored
    true: Scored


class TrueEvents(DerivedRecording):
    """A recording with the ray caster's events in place of its own."""

    def __init__(self, recording: Recording, events: tuple[Events, ...]) -> None:
        super().__init__(recording)
        self._events = events

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        all_, times_us = self._events[camera], self._events[camera].t_us
        some = slice(*np.searchsorted(times_us, (t0_us, t1_us)))
        return Events(all_.x[some], all_.y[some], times_us[some], all_.p[some])


def beside(case: PanelCase) -> tuple[PanelCase, NDArray[np.float64]]:
    """The case seen from a camera to the right, and that camera's pose (4, 4) in the first's."""
    T = np.eye(4)
    T[0, 3] = _BASELINE * case.depth_range_m[0]
    pose = case.world.T_world_cam
    world = replace(case.world, T_world_cam=lambda t_s: pose(t_s) @ T)
    return replace(case, world=world), T


def true_events(case: PanelCase, kept: Path) -> Events:
    """The ray caster's, in whole microseconds."""
    found = ray_truth(case, kept)
    columns = found.x.astype(np.uint16), found.y.astype(np.uint16)
    return Events(*columns, np.ceil(found.t_us).astype(np.int64), found.p.astype(np.uint8))


def drawn(name: str, kept: Path) -> dict[str, Pair]:
    """A case's scores by method, of all draws together."""
    return together([compared(name, seed, kept) for seed in SEEDS])


def compared(name: str, seed: int | None, kept: Path) -> dict[str, Pair]:
    """The scores of one draw of a case, by method."""
    left = panel_case(name, seed)
    right, T_left_right = beside(left)
    one = panel_rig(left.world.camera)
    rig = Rig("pair", one.cameras * 2, (np.eye(4), T_left_right), ("left", "right"))
    of_seed = "" if seed is None else f", seed {seed}"
    true = (
        true_events(left, kept / f"rays, {name}{of_seed}.npz"),
        true_events(right, kept / f"rays, {name}, right{of_seed}.npz"),
    )
    with tempfile.TemporaryDirectory() as folder:
        scene = panel_scene(left.world, left.depth_range_m, Path(folder), hdr=left.hdr)
        config = SimConfig(duration_s=left.duration_s, log_eps=left.log_eps)
        simulate(scene, rig, config, 0, Path(folder) / "clip")
        recording = es.open_recording(Path(folder) / "clip")
        some, others = scored(recording), scored(TrueEvents(recording, true), recording)
    return {method: Pair(some[method], others[method]) for method in METHODS}


def scored(recording: Recording, truth: Recording | None = None) -> dict[str, Scored]:
    """Scores by method, of one window of all events."""
    config = es.MapperConfig(methods=METHODS)
    mapped = es.map_window(recording, config)
    rows = es.score(mapped, truth or recording, EvalConfig()).rows
    found = {}
    for method in METHODS:
        own = rows[(rows["method"] == method) & (rows["region"] == _REGION)]
        of = dict(zip(own["metric"], own["value"], strict=True))
        found[method] = Scored(float(of["mean_error"]), int(of["points"]))
    return found


def pooled(parts: Sequence[Scored]) -> Scored:
    """Of the points of several maps."""
    points = [part.points for part in parts]
    if not any(points):
        return Scored(float("nan"), 0)
    errors_m = [part.error_m if part.points else 0.0 for part in parts]
    return Scored(float(np.average(errors_m, weights=points)), sum(points))


def together(results: Sequence[dict[str, Pair]]) -> dict[str, Pair]:
    """The same of the points of several, by method."""
    sides = {m: zip(*(one[m] for one in results), strict=True) for m in METHODS}
    return {method: Pair(*map(pooled, pairs)) for method, pairs in sides.items()}


def table(results: dict[str, dict[str, Pair]]) -> str:
    """The results as Markdown."""
    lines = [_HEAD, f"| Case | {' | '.join(METHODS)} |", f"|---|{'---|' * len(METHODS)}"]
    for name, pairs in {**results, "*All*": together([*results.values()])}.items():
        cells = [shown(pairs[method]) for method in METHODS]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def shown(pair: Pair) -> str:
    """A method's cell."""
    more = pair.simulated.error_m / pair.true.error_m - 1
    return f"{100 * more:+.1f} % ({pair.simulated.points}, {pair.true.points})".replace("-", "−")


def main(arguments: Sequence[str] | None = None) -> None:
    """Compares all cases, and prints or writes the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    still = [name for name in CASES if not any(p.moves for p in panel_case(name).world.panels)]
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(still))
    parser.add_argument("--truth", type=Path, required=True, help="folder that keeps the truth")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    given.truth.mkdir(parents=True, exist_ok=True)
    results = {}
    for name in given.cases or still:
        results[name] = drawn(name, given.truth)
        sys.stderr.write(f"{name}: {results[name]}\n")
    show(table(results), given.page, MARK)


if __name__ == "__main__":
    main()
