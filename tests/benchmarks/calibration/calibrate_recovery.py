"""How well `calibrate` recovers what was spoilt, on simulated twins with a noisy sensor.

`python tests/benchmarks calibrate_recovery --page plugins/diagnose/calibrate.md` simulates short sequences into
the cache, spoils their calibration by known amounts, refines it, and writes tables of what is left,
of depth, and of how often the stated uncertainty covers the truth. Finished cases are kept: the
same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import sys
import time
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.cache import default_cache
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.windows import Window
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.diagnose.calibrate.parameters import Correction, Parameter, parameters_of
from eventsweep.plugins.diagnose.calibrate.refine import RefineConfig, Refinement, refine
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import HeadSway, Wave
from eventsweep.sim.rigs import rig
from eventsweep.sim.sensor_presets import SensorConfig
from eventsweep.sim.simulate import simulate
from markdown_blocks import show

TWINS = (
    "desk", "tumvie-6dof", "rpg-boxes", "boxes", "mvsec-flying", "rpg-bin", "rpg-monitor",
    "rpg-reader", "tumvie-3d", "tumvie-desk2",
)  # fmt: skip
QUICK = ("desk", "tumvie-6dof", "rpg-bin", "rpg-monitor")
SECONDS = 1.5
# Quick turns about all axes on top of a scene's own motion: up to 170 deg/s, as of a head that
# shakes and nods.
_SHAKE = HeadSway(
    np.eye(4),
    (
        Wave(0.53, amplitude_deg=(7.0, 8.0, 6.0), phase_rad=(0, 0, 0, 0.4, 2.3, 4.1)),
        Wave(0.31, amplitude_deg=(3.0, 2.5, 3.0), phase_rad=(0, 0, 0, 5.2, 1.1, 3.0)),
    ),
)


@dataclass(frozen=True)
class Study:
    """What is spoilt and refined.

    Attributes:
        refine: keys of `plugins.diagnose.calibrate.parameters.NAMES`.
        sizes: kind of parameter -> by how much it is spoilt at most: deg, ms.
        twins: scenes.
        quick: whether quick turns are added to the scenes' motions.
    """

    refine: tuple[str, ...]
    sizes: dict[str, float]
    twins: tuple[str, ...] = TWINS
    quick: bool = False


_POSES = ("pose-delay", "hand-eye"), {"pose clock": 20.0, "hand-eye": 2.0}
STUDIES = {
    "stereo": Study(("stereo", "delay"), {"stereo": 0.5, "clock": 6.0}),
    "poses": Study(*_POSES),
    "turns": Study(*_POSES, QUICK, quick=True),
}
_DEPTH_AT_S = (0.35, 0.75, 1.15)
_DEPTH_WINDOW_S = 0.3
_EMVS = Path(__file__).parents[3] / "emvs"
_LAG_STEP_US, _LAG_FAR_US, _LAG_EVENTS, _LAG_S = 500, 40_000, 200_000, 0.4
_PER_PIXEL_US = 10_000_000  # longer than any twin


@dataclass(frozen=True, eq=False)
class Shaken:
    """A motion with quick turns of the head added.

    Attributes:
        own: the scene's.
    """

    own: Motion

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at `t_s`."""
        return self.own.T_world_body(t_s) @ _SHAKE.T_world_body(t_s)


def twin(name: str, *, quick: bool = False, prompt: bool = False) -> EventSequence:
    """A short sequence of a scene, 346 x 260 px, DAVIS346 with noise; simulated once.

    Args:
        name: of the scene.
        quick: whether quick turns are added to its motion.
        prompt: whether its pixels answer at once, whatever the light; then it is shorter.
    """
    words = (name, *("quick",) * quick, *("prompt",) * prompt)
    folder = default_cache() / "calibrate_recovery" / "-".join(words)
    if not folder.exists():
        at_once = {"bandwidth_hz": 0.0, "latency_us": 0.0} if prompt else {}
        sensor = SensorConfig(preset="davis346", **at_once)
        config = SimConfig(duration_s=_LAG_S if prompt else SECONDS, sensor=sensor)
        scene = scenes.load(name)
        own = scene.motion(SECONDS, 0)
        moved = Shaken(own) if quick else own
        scene = replace(scene, motion=lambda _length_s, _seed: moved)
        simulate(scene, rig("davis346"), config, 0, folder)
    return EventSequence.open(folder)


def lag_ms(name: str, *, quick: bool) -> float:
    """How much later the events of camera 0 come than from pixels that answer at once; mean.

    Of each event: which of the prompt twin's events of the same pixel and polarity lie how far off?
    Those of the same edge pile up around the lag; all others are alike everywhere.
    """
    late, at_once = (_in_order(twin(name, quick=quick, prompt=prompt)) for prompt in (False, True))
    late = late[late % _PER_PIXEL_US < 1e6 * _LAG_S]
    late = late[:: max(1, len(late) // _LAG_EVENTS)]
    edges_us = np.arange(-_LAG_FAR_US, _LAG_FAR_US + 1, _LAG_STEP_US)
    before = np.array([np.searchsorted(at_once, late - edge).sum() for edge in edges_us])
    found = -np.diff(before).astype(np.float64)
    outer = len(found) // 8
    excess = found - np.r_[found[:outer], found[-outer:]].mean()
    middle_us = (edges_us[1:] + edges_us[:-1]) / 2
    inner = slice(outer, -outer)
    return float((middle_us[inner] * excess[inner]).sum() / excess[inner].sum() / 1e3)


def _in_order(sequence: EventSequence) -> NDArray[np.int64]:
    """(N,) times of camera 0's events, pixel after pixel and polarity, far apart between them."""
    first_us, last_us = sequence.event_span_us(0)
    events = sequence.events(0, first_us, last_us + 1)
    width = sequence.rig.cameras[0].width_px
    place = 2 * (events.y.astype(np.int64) * width + events.x) + events.p
    return np.sort(place * _PER_PIXEL_US + events.t_us)


def spoilt(
    study: str, name: str, seed: int, parameters: Sequence[Parameter]
) -> dict[Parameter, float]:
    """Errors of a twin's calibration: stereo and clocks uniform, the others of full size."""
    rng = np.random.default_rng([seed, zlib.crc32(f"{study} {name}".encode())])
    sizes = STUDIES[study].sizes
    axis = rng.normal(size=3)
    axis *= sizes.get("hand-eye", 0.0) / np.linalg.norm(axis)
    errors = {}
    for one in parameters:
        size = sizes.get(one.kind, 0.0)
        errors[one] = float(rng.uniform(-size, size))
        if one.kind == "hand-eye":
            errors[one] = float(axis["xyz".index(one.axis)])
        if one.kind == "pose clock":
            errors[one] = size * float(rng.choice([-1, 1]))
    return errors


def run(name: str, study: str, seed: int) -> dict[str, Any]:
    """Spoils one twin and refines it; plain values, kept in the cache."""
    kept = default_cache() / "calibrate_recovery" / f".{name}-{study}-{seed}-{_version()}.json"
    if kept.exists():
        found: dict[str, Any] = json.loads(kept.read_text("utf-8"))
        return found
    names, quick = STUDIES[study].refine, STUDIES[study].quick
    sequence = twin(name, quick=quick)
    errors = spoilt(study, name, seed, parameters_of(names, 2))
    given = Correction(errors).applied(sequence)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    refinement = refine(given, RefineConfig(names))
    result = {
        "scene": name,
        "study": study,
        "seed": seed,
        "wall_s": time.perf_counter() - wall_s,
        "cpu_s": time.process_time() - cpu_s,
        "estimates": _compared(refinement, errors),
        "lag_ms": lag_ms(name, quick=quick) if "pose-delay" in names else None,
        "depth": _depths(sequence, given, refinement.applied(given)),
    }
    with atomic_path(kept) as partial:
        partial.write_text(json.dumps(result), encoding="utf-8")
    return result


def _version() -> str:
    """Of the code that refines: comments and layout aside."""
    files = sorted([*_EMVS.glob("calibrate/*.py"), *_EMVS.glob("sharpness*.py")])
    trees = [ast.dump(ast.parse(path.read_text("utf-8"))) for path in files
             if path.stem not in ("folder", "epipolar")]  # fmt: skip
    return hashlib.sha256("".join(trees).encode()).hexdigest()[:12]


def _compared(refinement: Refinement, errors: dict[Parameter, float]) -> list[dict[str, Any]]:
    return [
        {
            "parameter": one.parameter.name,
            "kind": one.parameter.kind,
            "spoilt": errors[one.parameter],
            "left": one.value + errors[one.parameter],
            "uncertainty": one.uncertainty if math.isfinite(one.uncertainty) else None,
            "refused": one.refused,
        }
        for one in refinement.estimates
    ]


def _depths(truth: EventSequence, *told: Recording) -> list[float]:
    """Mean absolute relative depth error of Alg1/H with the true and with other calibrations, %."""
    return [
        100 * float(np.mean(np.concatenate([_errors(truth, one, t_s) for t_s in _DEPTH_AT_S])))
        for one in (truth, *told)
    ]


def _errors(truth: EventSequence, told: Recording, t_s: float) -> NDArray[np.float64]:
    t_us, half_us = round(1e6 * t_s), round(0.5e6 * _DEPTH_WINDOW_S)
    window = Window(t_us - half_us, t_us + half_us, t_us, (0, 0))
    mapped = map_window(told, MapperConfig(methods=("Alg1/H",)), window=window)
    depth = mapped.depth_maps["Alg1/H"]
    true_m = truth.truth_view_depth_m(0, t_us)
    both = depth.mask & np.isfinite(true_m)
    return np.asarray(np.abs(depth.depth_m[both] - true_m[both]) / true_m[both], np.float64)


def summary(results: Sequence[dict[str, Any]]) -> str:
    """A line per kind of parameter: what was spoilt, what is left, coverage, refusals."""
    lines = [
        "| parameter | spoilt by, median | left, median | left, largest | 95 % stated, median | "
        "truth covered | refused |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    every = [estimate for one in results for estimate in (*one["estimates"], *_lagging(one))]
    for name in dict.fromkeys(one["parameter"] for one in every):
        mine = [one for one in every if one["parameter"] == name]
        lines.append(_summary_line(name, mine, _unit(mine[0]["kind"])))
    return "\n".join(lines) + "\n"


def _lagging(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The pose clock once more: the truth is then the clock of the events as the sensor gave them.

    Those lag behind the light, and it is events that poses must fit.
    """
    return [
        {**one, "parameter": "pose clock, from the events'", "left": one["left"] - result["lag_ms"]}
        for one in result["estimates"]
        if one["kind"] == "pose clock"
    ]


def _summary_line(name: str, mine: Sequence[dict[str, Any]], unit: str) -> str:
    refined = [one for one in mine if not one["refused"]]
    refused = f"{len(mine) - len(refined)}/{len(mine)}"
    spoilt_by = f"{np.median([abs(one['spoilt']) for one in mine]):.2f} {unit}"
    if not refined:
        stated = [one["uncertainty"] for one in mine if one["uncertainty"] is not None]
        known = f"{np.median(stated):.2f} {unit}" if stated else "unknown"
        return f"| {name} | {spoilt_by} | – | – | {known} | – | {refused} |"
    left = np.abs([one["left"] for one in refined])
    stated = [one["uncertainty"] for one in refined]
    covered = sum(abs(one["left"]) <= one["uncertainty"] for one in refined)
    return (
        f"| {name} | {spoilt_by} | {np.median(left):.3f} {unit} | {left.max():.3f} {unit} | "
        f"{np.median(stated):.3f} {unit} | {covered}/{len(refined)} | {refused} |"
    )


def per_twin(results: Sequence[dict[str, Any]]) -> str:
    """A line per twin: depth with the true, the spoilt and the refined calibration, and time."""
    lag = any(one["lag_ms"] is not None for one in results)
    heads = ["twin", "depth error, true calibration", "spoilt", "refined", "CPU time", "wall time"]
    heads += ["events late by"] * lag
    lines = [f"| {' | '.join(heads)} |", "|---" + "|--:" * (len(heads) - 1) + "|"]
    for one in results:
        cells = [one["scene"], *(f"{error:.2f} %" for error in one["depth"])]
        cells += [f"{one['cpu_s']:.0f} s", f"{one['wall_s']:.0f} s"]
        cells += [f"{one['lag_ms']:.1f} ms"] if lag else []
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _unit(kind: str) -> str:
    return {"clock": "ms", "pose clock": "ms", "lever": "mm"}.get(kind, "deg")


def main(arguments: Iterable[str] | None = None) -> int:
    """Runs the cases, prints tables and writes them into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--twin", action="append", choices=TWINS, help="repeatable; default: all")
    parser.add_argument("--study", action="append", choices=list(STUDIES), help="default: all")
    parser.add_argument("--seeds", type=int, default=1, help="spoilt calibrations per twin")
    parser.add_argument("--page", type=Path, help="page whose marked part gets the first table")
    chosen = parser.parse_args(None if arguments is None else list(arguments))
    with exit_code() as code:
        for study in chosen.study or STUDIES:
            results = []
            twins = [one for one in STUDIES[study].twins if one in (chosen.twin or TWINS)]
            for seed, name in product(range(chosen.seeds), twins):
                results.append(run(name, study, seed))
                sys.stderr.write(f"{study} {name} {seed}: {_brief(results[-1])}\n")
            sys.stdout.write(f"{per_twin(results)}\n")
            show(summary(results), chosen.page, f"recovery-{study}")
    return code.value


def _brief(result: dict[str, Any]) -> str:
    each = [
        f"{one['parameter']} " + ("refused" if one["refused"] else f"{one['left']:+.3f}")
        for one in result["estimates"]
    ]
    return f"{', '.join(each)}; {result['cpu_s']:.0f} s CPU"


if __name__ == "__main__":
    sys.exit(main())
