"""The study of `docs/extraction.md`: `python tests/benchmarks study_extraction --help`.

Every extraction of `study_variants.py` reports as many pixels as Alg1/H does on the same volumes,
and every number is a ratio to that of Alg1/H. The development samples of `study_samples.py` chose
the parameters; the others show what they are worth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.reference_view import inverse_depth_at
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.pairing import pair
from markdown_blocks import show
from study_cache import StudySample, load_sample
from study_samples import SETS, SampleSpec
from study_variants import (
    ALONE,
    BASE,
    BEFORE,
    OURS,
    RELIABILITIES,
    VariantEstimate,
    Volumes,
    estimates,
    finalists,
    threshold_name,
    thresholds,
)

_COLOURS = 255
_SHOWN = {BASE: "Alg1/H", OURS: "ours, same number of points"}


def draw(sample: StudySample, path: Path) -> None:
    """Writes a PNG: depth above, error in plane steps below, Alg1/H left, ours right."""
    found = estimates(Volumes.of(sample))
    figure, axes = plt.subplots(2, 2, figsize=(9, 7.2), layout="constrained", dpi=80)
    for column, (name, title) in enumerate(_SHOWN.items()):
        depth_m, error = _depth_and_error(sample, found[name])
        _panel(axes[0, column], depth_m, f"{title}: depth, m", "turbo_r", _range_m(sample))
        shown = f"{title}: |error|, planes"
        _panel(axes[1, column], error, shown, "inferno", (0, 5))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    drawn = Image.fromarray(pixels).convert("RGB")
    drawn.quantize(_COLOURS).save(path, optimize=True)
    plt.close(figure)


def _depth_and_error(
    sample: StudySample, estimate: VariantEstimate
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rho, reported = sample.view.rho, estimate.mask & sample.truth.scored
    depth_m = np.reciprocal(inverse_depth_at(rho, estimate.position))
    step = abs(float(rho[0]) - float(rho[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        error = abs(1 / depth_m - 1 / sample.truth.depth_m) / step
    return np.where(reported, depth_m, np.nan), np.where(reported, error, np.nan)


def _range_m(sample: StudySample) -> tuple[float, float]:
    return float(1 / sample.view.rho[0]), float(1 / sample.view.rho[-1])


def _panel(
    axes: Axes, image: NDArray[np.float32], title: str, colours: str, limits: tuple[float, float]
) -> None:
    rows, columns = np.nonzero(np.isfinite(image))
    # Dots, not an image: single pixels vanish when it is scaled down
    shown = axes.scatter(
        columns, rows, c=image[rows, columns], s=1.2, cmap=colours, vmin=limits[0], vmax=limits[1],
        linewidths=0,
    )  # fmt: skip
    axes.set(title=title, xlim=(0, image.shape[1]), ylim=(image.shape[0], 0), aspect="equal")
    axes.set_facecolor("#d8d8d8")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.figure.colorbar(shown, ax=axes, shrink=0.85)


ABLATED = "development"
PICTURED = SampleSpec("tumvie-6dof")
METRICS = ("median_error", "mean_error", "bad_published", "bad_1px")
WANTED = {"median_error": 0.75, "mean_error": 0.80, "bad_published": 0.80}
_BLOCK_PX = 8

Numbers = dict[str, float]


@dataclass(frozen=True)
class SampleOutcome:
    """What every extraction made of one sample."""

    case: str
    seed: int
    numbers: Mapping[str, Numbers]

    def ratio(self, name: str, metric: str) -> float:
        """A number of one extraction over that of Alg1/H; 1 where both are 0."""
        mine, base = self.numbers[name][metric], self.numbers[BASE][metric]
        if base == 0:
            return 1.0 if mine == 0 else float("inf")
        return mine / base

    def meets(self, name: str) -> bool:
        """Whether every wanted ratio is reached."""
        return all(self.ratio(name, metric) <= limit for metric, limit in WANTED.items())


def study(sample: StudySample, *, ablate: bool = True) -> SampleOutcome:
    """Tries every extraction on one sample, or only the finalists."""
    volumes = Volumes.of(sample)
    found = estimates(volumes) | thresholds(volumes) if ablate else finalists(volumes)
    numbers = {name: _numbers(sample, estimate) for name, estimate in found.items()}
    return SampleOutcome(sample.case, sample.seed, numbers)


def _numbers(sample: StudySample, estimate: VariantEstimate) -> Numbers:
    planes = len(sample.view.rho)
    position = np.clip(estimate.position, 0, planes - 1).astype(np.float32)
    depth_m = np.reciprocal(inverse_depth_at(sample.view.rho, position))
    pairs = pair(depth_m, estimate.mask, sample.truth)
    numbers = {name: ALL_METRICS[name](pairs) for name in ("points", *METRICS)}
    return numbers | {"blocks": float(blocks_with_points(estimate.mask))}


def blocks_with_points(mask: np.ndarray) -> int:
    """Squares of 8 pixels with a point in them: points that crowd in few places fill few."""
    rows, columns = (size // _BLOCK_PX for size in mask.shape)
    inner = mask[: rows * _BLOCK_PX, : columns * _BLOCK_PX]
    return int(inner.reshape(rows, _BLOCK_PX, columns, _BLOCK_PX).any((1, 3)).sum())


def ablation_table(outcomes: list[SampleOutcome]) -> str:
    """One line for each extraction: geometric means of the ratios over the samples."""
    lines = [
        "| Extraction | median | mean | bad pixels | bad 1 px | blocks | met |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    skipped = {threshold_name(reliability) for reliability in RELIABILITIES}
    for name in (name for name in outcomes[0].numbers if name not in skipped):
        ratios = [_geometric([o.ratio(name, m) for o in outcomes]) for m in (*METRICS, "blocks")]
        met = sum(o.meets(name) for o in outcomes)
        cells = " | ".join(f"{value:.2f}" for value in ratios)
        lines.append(f"| {_bold(name)} | {cells} | {met}/{len(outcomes)} |")
    return "\n".join(lines) + "\n"


def case_table(outcomes: Iterable[SampleOutcome]) -> str:
    """One line for each sample: our extraction beside Alg1/H at equal points."""
    lines = [
        "| Case | seed | points | median mm | mean mm | bad pixels % | median | mean | bad | met |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|---|",
    ]
    for o in outcomes:
        base, mine = o.numbers[BASE], o.numbers[OURS]
        points = f"{base['points']:.0f} → {mine['points']:.0f}"
        median = f"{1e3 * base['median_error']:.1f} → {1e3 * mine['median_error']:.1f}"
        mean = f"{1e3 * base['mean_error']:.0f} → {1e3 * mine['mean_error']:.0f}"
        bad = f"{base['bad_published']:.2f} → {mine['bad_published']:.2f}"
        ratios = " | ".join(f"{o.ratio(OURS, metric):.2f}" for metric in WANTED)
        met = "yes" if o.meets(OURS) else "no"
        lines.append(
            f"| {o.case} | {o.seed} | {points} | {median} | {mean} | {bad} | {ratios} | {met} |"
        )
    return "\n".join(lines) + "\n"


def calibration_table(outcomes: Iterable[SampleOutcome]) -> str:
    """One line for each reliability: points and errors over those of Alg1/H, and the precision."""
    lines = [
        "| `focus.reliability` | points | fewest | median | mean | bad pixels | within 1 px % |",
        "|--:|--:|--:|--:|--:|--:|--:|",
    ]
    chosen = list(outcomes)
    for reliability in RELIABILITIES:
        name = threshold_name(reliability)
        points = [o.ratio(name, "points") for o in chosen]
        ratios = [_geometric([o.ratio(name, metric) for o in chosen]) for metric in WANTED]
        precise = 100 - float(np.mean([o.numbers[name]["bad_1px"] for o in chosen]))
        cells = " | ".join(f"{v:.2f}" for v in (_geometric(points), min(points), *ratios))
        lines.append(f"| {reliability:g} | {cells} | {precise:.0f} |")
    return "\n".join(lines) + "\n"


def report(outcomes: Mapping[str, list[SampleOutcome]], *, cases: bool = False) -> str:
    """Markdown: each set, with `cases` a line per sample; then calibration and ablation."""
    parts = []
    for title, chosen in outcomes.items():
        met = sum(o.meets(OURS) for o in chosen)
        parts += [
            f"### Every {title} sample, Alg1/H → ours: {met} of {len(chosen)} met\n",
            *([case_table(chosen)] if cases else []),
            summary_table(chosen),
        ]
    ablated = outcomes.get(ABLATED, [])
    if ablated:
        parts += ["### Reliability, development samples\n", calibration_table(ablated)]
        parts += ["### Ablation, development samples\n", ablation_table(ablated)]
    return "\n".join(parts)


def summary_table(outcomes: list[SampleOutcome]) -> str:
    """The finalists' lines of the ablation."""
    kept = [
        SampleOutcome(
            o.case, o.seed, {name: o.numbers[name] for name in (BASE, BEFORE, OURS, ALONE)}
        )
        for o in outcomes
    ]
    return ablation_table(kept)


def _geometric(values: list[float]) -> float:
    # A ratio of 0 (no bad pixel left) would make the mean 0.
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-3)))))


def _bold(name: str) -> str:
    return f"**{name}**" if name == OURS else name


def main(arguments: list[str] | None = None) -> int:
    """Runs the study and prints its tables; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description="Compare extractions at equal points.")
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=list(SETS))
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    parser.add_argument("--mark", default="study", help="name of that part")
    parser.add_argument("--cases", action="store_true", help="also a line for each sample")
    parser.add_argument("--picture", type=Path, help="PNG of the picture's sample")
    chosen = parser.parse_args(arguments)
    with exit_code() as code:
        if chosen.picture is not None:
            draw(_load(PICTURED, chosen.cache), chosen.picture)
        outcomes: dict[str, list[SampleOutcome]] = {}
        for name in chosen.sets:
            outcomes[name] = [
                study(_load(wanted, chosen.cache), ablate=name == ABLATED) for wanted in SETS[name]
            ]
        text = report(outcomes, cases=chosen.cases)
        show(text, chosen.page, chosen.mark)
    return code.value


def _load(wanted: SampleSpec, cache: Path) -> StudySample:
    return load_sample(
        wanted.case, wanted.seed, cache, MapperConfig(), rig=wanted.rig, seconds=wanted.seconds,
        sensor=wanted.sensor,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
