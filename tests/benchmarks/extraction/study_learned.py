"""The networks beside Alg1/H and Focus/H: `python tests/benchmarks study_learned --help`.

Every method reports as many pixels as Alg1/H, those that it holds most reliable, and numbers are
ratios to those of Alg1/H: also with camera 0 alone. DERD-Net holds no pixel more reliable than
others: it reports Alg1/H's own, but for the rim that its patches cannot reach. With
`--imperfection` the mapper is given wrong poses and calibrations.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap, without_border
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.perturbations import Perturbation, amounts, perturbed
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.pairing import Truth, pair
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.networks.judgement import at_reference_px
from markdown_blocks import show
from study_cache import load_sequence
from study_extraction import METRICS, Numbers, blocks_with_points
from study_samples import SETS, SampleSpec, chosen_samples

BASE, FOCUS, LEARNED, DERD = STEREO = ("Alg1/H", "Focus/H", "Learned/H", "DERD/H")
METHODS = (*STEREO, "Focus/cam0", "Learned/cam0")
OTHERS = METHODS[1:]
JUDGED = ("Focus", "Learned")
"""Families whose reliability chooses among more candidates than they report."""
WANTED = ("median_error", "mean_error", "bad_published", "bad_1px", "blocks")
SUMMARY = "median | mean | bad pixels | bad 1 px | blocks | mean worse than Alg1/H"
SUMMARY_RULE = "|---|--:|--:|--:|--:|--:|--:|"
ERRORS_PX = (0.1, 0.2, 0.3, 0.5, 1.0)
_RESAMPLES = 2000
_PLAIN = ""
Outcomes = dict[SampleSpec, dict[str, Numbers]]


def told(recording: Recording, imperfection: str, seed: int) -> Recording:
    """What the mapper is told: the truth, or what a preset makes of it."""
    if imperfection == _PLAIN:
        return recording
    return perturbed(recording, Perturbation.model_validate(amounts(imperfection)), seed)


def outcome(
    spec: SampleSpec,
    cache: Path,
    imperfection: str,
    weights: Path | None,
    derd_weights: Path | None,
) -> dict[str, Numbers]:
    """Every method's numbers on one sample."""
    sequence = load_sequence(
        spec.case, spec.seed, cache, rig=spec.rig, seconds=spec.seconds, sensor=spec.sensor
    )
    config = MapperConfig(
        methods=METHODS, learned={"weights": weights},
        derd={"weights": derd_weights, "threshold_c": MapperConfig().threshold_c},
    )  # fmt: skip
    result = map_window(told(sequence, imperfection, spec.seed), config)
    truth = truth_of(sequence, result.view.t_us, EvalConfig())
    points, per_rho_px = result.depth_maps[BASE].points, truth.baseline_focal_px_m
    found = {
        name: numbers(depth_map.depth_m, most_reliable(depth_map, per_rho_px, points), truth)
        for name, depth_map in result.depth_maps.items()
    }
    learned = result.depth_maps[LEARNED]
    for error_px in ERRORS_PX:
        mask = ranks(learned, per_rho_px) >= 1 / error_px
        found[_limit(error_px)] = numbers(learned.depth_m, mask, truth)
    return found


def _limit(error_px: float) -> str:
    return f"`learned.error_px` {error_px:g}"


def ranks(depth_map: DepthMap, per_rho_px: float) -> NDArray[np.float32]:
    """(H, W) what ranks the pixels of a method, 0 or less where there is no candidate.

    `per_rho_px` is disparity per inverse depth, px m. Methods that hold no pixel more reliable than
    others rank those that they report.
    """
    reliability = depth_map.reliability
    if reliability is None:
        return depth_map.mask.astype(np.float32)
    if MethodName.of(depth_map.method).family == "Learned":
        return at_reference_px(reliability, per_rho_px / depth_map.depth_m)
    return reliability


def most_reliable(depth_map: DepthMap, per_rho_px: float, points: int) -> NDArray[np.bool_]:
    """As many pixels as wanted, the most reliable first; what votes rank keeps to its own."""
    judged = MethodName.of(depth_map.method).family in JUDGED
    candidates = depth_map.mask
    if judged and depth_map.reliability is not None:
        candidates = without_border(depth_map.reliability > 0, MapperConfig().border_px)
    rank, allowed = ranks(depth_map, per_rho_px), np.flatnonzero(candidates)
    mask = np.zeros(rank.shape, np.bool_)
    mask.flat[allowed[np.argsort(-rank.flat[allowed], kind="stable")[:points]]] = True
    return mask


def numbers(depth_m: NDArray[np.floating], mask: NDArray[np.bool_], truth: Truth) -> Numbers:
    """Every metric of some pixels, and how many blocks of the image they lie in."""
    pairs = pair(depth_m, mask, truth)
    found = {name: ALL_METRICS[name](pairs) for name in ("points", *METRICS)}
    return found | {"blocks": float(blocks_with_points(mask))}


def ratio(found: Mapping[str, Numbers], name: str, metric: str) -> float:
    """A number over that of Alg1/H; at least a thousandth, so that means are above 0."""
    mine, base = found[name][metric], found[BASE][metric]
    return max(mine / base, 1e-3) if base > 0 else 1.0 if mine == 0 else float("inf")


def interval(ratios: Sequence[float]) -> tuple[float, float, float]:
    """Geometric mean, and its 95 % interval over samples drawn with replacement."""
    logs = np.log(ratios)
    rng = np.random.default_rng(0)
    drawn = logs[rng.integers(len(logs), size=(_RESAMPLES, len(logs)))].mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(np.exp(logs.mean())), float(np.exp(low)), float(np.exp(high))


def case_table(outcomes: Outcomes) -> str:
    """One line for each sample: ratios of each method; blocks are those of Learned/H."""
    heads = " | ".join(f"{name} median | mean | bad" for name in OTHERS)
    lines = [
        f"| Case | seed | points | {heads} | blocks |",
        f"|---|{'--:|' * (3 + 3 * len(OTHERS))}",
    ]
    for spec, found in outcomes.items():
        ratios = [ratio(found, name, m) for name in OTHERS for m in WANTED[:3]]
        ratios.append(ratio(found, LEARNED, "blocks"))
        cells = " | ".join(f"{value:.2f}" for value in ratios)
        points = f"{found[LEARNED]['points']:.0f}"
        lines.append(f"| {spec.case} | {spec.seed} | {points} | {cells} |")
    return "\n".join(lines) + "\n"


def summary_table(outcomes: Outcomes) -> str:
    """Geometric means of the ratios with their intervals, and on how many samples it is worse."""
    lines = [f"| Method | {SUMMARY} |", SUMMARY_RULE]
    lines += [f"| `{name}` | {summary_cells(list(outcomes.values()), name)} |" for name in OTHERS]
    return "\n".join(lines) + "\n"


def summary_cells(outcomes: Sequence[Mapping[str, Numbers]], name: str) -> str:
    """What `SUMMARY` heads, of one method."""
    ratios = {m: [ratio(found, name, m) for found in outcomes] for m in WANTED}
    cells = " | ".join("{:.2f} ({:.2f}–{:.2f})".format(*interval(ratios[m])) for m in WANTED)
    worse = sum(value > 1 for value in ratios["mean_error"])
    return f"{cells} | {worse}/{len(outcomes)}"


def limit_table(outcomes: Outcomes) -> str:
    """One line for each limit of the expected error: points and errors over those of Alg1/H."""
    lines = [
        "| `learned.error_px` | points | fewest | median | mean | bad pixels | within 1 px % |",
        "|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for error_px in ERRORS_PX:
        found = [(one, _limit(error_px)) for one in outcomes.values()]
        points = [ratio(one, name, "points") for one, name in found]
        means = [interval([ratio(one, name, m) for one, name in found])[0] for m in WANTED[:3]]
        precise = 100 - float(np.mean([one[name]["bad_1px"] for one, name in found]))
        cells = " | ".join(f"{v:.2f}" for v in (interval(points)[0], min(points), *means))
        lines.append(f"| {error_px:g} | {cells} | {precise:.0f} |")
    return "\n".join(lines) + "\n"


TABLES = {"summary": summary_table, "cases": case_table, "limits": limit_table}


def main(arguments: list[str] | None = None) -> int:
    """Runs the study and prints its tables; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks study_learned", description=__doc__
    )
    parser.add_argument("--sets", nargs="+", default=["held-out"], choices=list(SETS))
    parser.add_argument("--cases", nargs="+", help="these of them only, such as desk or desk-2")
    parser.add_argument("--imperfection", default=_PLAIN, help="preset of what is told wrongly")
    parser.add_argument("--weights", type=Path, help="by default those that ship")
    parser.add_argument("--derd-weights", type=Path, help="likewise")
    parser.add_argument("--tables", nargs="+", default=list(TABLES), choices=list(TABLES))
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    parser.add_argument("--mark", default="learned", help="name of that part")
    chosen = parser.parse_args(arguments)
    with exit_code() as code:
        outcomes: Outcomes = {}
        weights = chosen.weights, chosen.derd_weights
        for spec in chosen_samples(chosen.sets, chosen.cases):
            outcomes[spec] = outcome(spec, chosen.cache, chosen.imperfection, *weights)
        text = "\n".join(TABLES[name](outcomes) for name in chosen.tables)
        show(text, chosen.page, chosen.mark)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
