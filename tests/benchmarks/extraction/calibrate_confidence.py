"""What each method's reliability is worth: `python tests/benchmarks calibrate_confidence --help`.

Calibrates on the calibration sequences of training, and writes `emvs/depth/precision.json`, which
ships. With `--page` it then asks samples of the extraction study, which nothing was trained or
calibrated on, whether the stated errors and precisions hold there. `--left-out` calibrates without
each sequence in turn, and asks that one how much its band holds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth import precision
from eventsweep.emvs.depth.precision import Precision, table_name, tables
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.progress import SILENT
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.methods.learned import precision_of
from eventsweep.plugins.learned.networks.network import NAME, network
from eventsweep.plugins.learned.networks.weights import write_weights
from eventsweep.plugins.learned.training import confidence
from eventsweep.plugins.learned.training.confidence import Scored
from eventsweep.plugins.learned.training.data import simulated
from eventsweep.plugins.learned.training.sequences import TrainingSequence, sequences
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.sensor_presets import SensorConfig
from eventsweep.sim.simulate import simulate
from markdown_blocks import into_page, show
from study_samples import SETS, SampleSpec, chosen_samples
from table_code import Code, of_methods, of_scenes

METHODS = (
    *(f"Alg1/{name}" for name in ("min", "H", "G", "A", "RMS", "max")),
    "EMVS/cam0", "EMVS/cam1", "Focus/H", "Focus/cam0",
)  # fmt: skip
LEARNED = "Learned/H", "Learned/cam0"
ASKED = ("Alg1/H", "EMVS/cam0", "Focus/H", "Learned/H", "Focus/cam0", "Learned/cam0")
WANTED = (0.9, 0.95)
TABLE = precision.PRECISION
_OF_THE_FILE = "network", "arrays_sha256"


def calibrate(folder: Path, scenes: Sequence[str], methods: Sequence[str]) -> dict[str, Precision]:
    """Tables of methods, from the calibration sequences in a folder; made if not there."""
    found = confidence.collect(folder, _simulated(folder, scenes), methods)
    return {name: confidence.fit(one) for name, one in found.items()}


def _simulated(folder: Path, scenes: Sequence[str]) -> list[TrainingSequence]:
    wanted = [one for one in sequences("calibration") if one.scene in scenes]
    simulated(wanted, folder, SILENT)
    return wanted


def left_out(folder: Path, scenes: Sequence[str], methods: Sequence[str]) -> dict[str, list[float]]:
    """By method, the share of each sequence's errors that tables of all others hold."""
    each = [confidence.collect(folder, [one], methods) for one in _simulated(folder, scenes)]
    held: dict[str, list[float]] = defaultdict(list)
    for own in each:
        for name, points in own.items():
            others = confidence.joined([one[name] for one in each if one is not own])
            held[name].append(_within(confidence.fit(others), better_half(points)))
    return held


def better_half(points: Scored) -> Scored:
    """Those of the larger scores: others are never reported."""
    return points[points.score >= np.quantile(points.score, 0.5)]


def _within(table: Precision, points: Scored) -> float:
    return float((points.error_px <= _stated_px(table, points)).mean())


def _stated_px(table: Precision, points: Scored) -> NDArray[np.float32]:
    scatter = None if points.scatter_px is None else points.scatter_px.astype(np.float32)
    return table.error_at(points.score.astype(np.float32), scatter)


def spread(held: Mapping[str, Sequence[float]]) -> str:
    """Markdown: how much a band holds in sequences that its table does not know."""
    lines = ["| Method | within the band, %: median | least | most |", "|---|--:|--:|--:|"]
    for name, shares in held.items():
        cells = (100 * f(shares) for f in (np.median, np.min, np.max))
        lines.append(f"| `{name}` | " + " | ".join(f"{cell:.0f}" for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def write_tables(made: Mapping[str, Precision]) -> None:
    """Writes tables of learned methods into their manifest, all others into one file.

    Tables of methods that were not calibrated stay as they are.
    """
    learned = [name for name in map(table_name, LEARNED) if name in made]
    own = {name: made[name].to_json() for name in learned}
    others = {name: one for name, one in made.items() if name not in own}
    plain = {name: one.to_json() for name, one in sorted({**tables(), **others}.items())}
    with atomic_path(TABLE) as part:
        part.write_text(json.dumps({"methods": plain}, indent=1) + "\n", encoding="utf-8")
    tables.cache_clear()
    weights = network().weights
    learnt = {k: v for k, v in weights.manifest.items() if k not in _OF_THE_FILE}
    precision_too = {**learnt.get("precision", {}), **own}
    write_weights(weights.path, NAME, weights.arrays, {**learnt, "precision": precision_too})


def held_out(cache: Path, specs: Sequence[SampleSpec], methods: Sequence[str]) -> dict[str, Scored]:
    """Candidates of the study's samples, by method."""
    found: dict[str, list[Scored]] = defaultdict(list)
    for spec in specs:
        sequence = _sequence(spec, cache)
        result = map_window(sequence, MapperConfig(methods=tuple(methods)))
        truth = truth_of(sequence, result.view.t_us, EvalConfig())
        for name, depth_map in result.depth_maps.items():
            found[name].append(confidence.points_of(depth_map, truth))
    return {name: confidence.joined(parts) for name, parts in found.items()}


def _sequence(spec: SampleSpec, cache: Path) -> EventSequence:
    """A sample's sequence, simulated where the folder does not hold it."""
    name = f"{spec.case}-{spec.rig}-{spec.seconds:g}s-seed{spec.seed}"
    path = cache / (name + ("" if spec.sensor == "ideal" else f"-{spec.sensor}"))
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        asked = SimConfig(duration_s=spec.seconds, sensor=SensorConfig(preset=spec.sensor))
        simulate(scenes.load(spec.case), named_rig(spec.rig), asked, spec.seed, path)
    return EventSequence.open(path)


def table_of(method: str) -> Precision:
    """The table of a method, where it ships.

    Raises:
        InputError: there is none.
    """
    known = (
        precision_of(network(), method) if method in LEARNED else tables().get(table_name(method))
    )
    if known is None:
        raise InputError(f"{method}: no table of precision; calibrate first")
    return known


def reliability_diagram(
    table: Precision, points: Scored, bins: int = 10
) -> list[Mapping[str, float]]:
    """Stated against found errors: points sorted by what is stated, in bins of as many each.

    Args:
        table: what scores were worth on the calibration windows.
        points: others.
        bins: how many.

    Returns:
        Per bin the mean stated error, the found quantile, and the share within the stated band.
    """
    said, error_px = _stated_px(table, points), points.error_px
    parts = np.array_split(np.argsort(said, kind="stable"), bins)
    return [
        {
            "stated_px": float(said[part].mean()),
            "found_px": float(np.quantile(error_px[part], precision.BAND)),
            "within": float((error_px[part] <= said[part]).mean()),
            "points": float(len(part)),
        }
        for part in parts
        if len(part)
    ]


def report(found: Mapping[str, Scored]) -> str:
    """Markdown: stated bands and wanted precisions beside those that were found."""
    lines = [
        "| Method | bin | stated error px | found px | within % |",
        "|---|--:|--:|--:|--:|",
    ]
    for name, points in found.items():
        diagram = reliability_diagram(table_of(name), better_half(points), bins=5)
        for k, line in enumerate(diagram, 1):
            cells = f"{line['stated_px']:.2f} | {line['found_px']:.2f} | {100 * line['within']:.0f}"
            lines.append(f"| `{name}` | {k} | {cells} |")
    lines += ["", "| Method | wanted precision % | found % | points |", "|---|--:|--:|--:|"]
    for name, points in found.items():
        lines += [_reached(name, points, wanted) for wanted in WANTED]
    return "\n".join(lines) + "\n"


def _reached(name: str, points: Scored, wanted: float) -> str:
    table = table_of(name)
    if wanted > table.precision[-1]:
        return f"| `{name}` | {100 * wanted:.0f} | not to be had | |"
    kept = points.score >= table.least_score(wanted, name)
    right = float((points.error_px[kept] <= precision.WITHIN_PX).mean()) if kept.any() else 0.0
    return f"| `{name}` | {100 * wanted:.0f} | {100 * right:.1f} | {int(kept.sum())} |"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    unscored = Code(without=("eventsweep.eval.scoring.metrics",))  # only the truth is asked for
    return {
        "plugins/learned/learned.md#left-out": Code(
            ("calibrate_confidence:left_out", "calibrate_confidence:spread")
        )
        + of_methods((*METHODS, *LEARNED))
        + unscored
        + of_scenes(one.scene for one in sequences("calibration")),
        "plugins/learned/learned.md#confidence": Code(
            ("calibrate_confidence:held_out", "calibrate_confidence:report")
        )
        + of_methods(ASKED)
        + unscored
        + of_scenes(one.case for one in chosen_samples(["held-out"], None)),
    }


def main(arguments: list[str] | None = None) -> int:
    """Calibrates, or reports; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks calibrate_confidence", description=__doc__
    )
    parser.add_argument("--sequences", type=Path, help="folder of the calibration sequences")
    scenes = [one.scene for one in sequences("calibration")]
    parser.add_argument("--scenes", nargs="+", default=scenes, choices=scenes,
                        help="calibrate on these only")  # fmt: skip
    parser.add_argument("--methods", nargs="+", default=[*METHODS, *LEARNED],
                        choices=[*METHODS, *LEARNED],
                        help="calibrate these only: tables of others stay as they are")  # fmt: skip
    parser.add_argument(
        "--left-out", action="store_true", help="with --sequences: ask each, calibrated without it"
    )
    parser.add_argument("--sets", nargs="+", default=["held-out"], choices=list(SETS))
    parser.add_argument("--cases", nargs="+", help="ask these samples of the sets only")
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    chosen = parser.parse_args(arguments)
    with exit_code() as ended:
        if chosen.left_out:
            if chosen.sequences is None:
                raise InputError("--left-out needs --sequences, the folder of the sequences")
            held = left_out(chosen.sequences, chosen.scenes, chosen.methods)
            show(spread(held), chosen.page, "left-out", code)
            return ended.value
        if chosen.sequences is not None:
            write_tables(calibrate(chosen.sequences, chosen.scenes, chosen.methods))
        if chosen.page is not None:
            specs = chosen_samples(chosen.sets, chosen.cases)
            asked = [name for name in ASKED if name in chosen.methods]
            text = report(held_out(chosen.cache, specs, asked))
            sys.stdout.write(text)
            into_page(chosen.page, "confidence", text, code)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
