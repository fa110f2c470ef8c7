"""ESVO's parts, one by one: `python tests/benchmarks study_baselines SEQUENCE --page PAGE`.

SEQUENCE is a simulated twin of MVSEC's flights. Windows of 1 s follow each other, mapped by the
thresholds of the published table; errors are pooled over windows, as that table pools them. Truth
is known here, so what the ablation says explains ESVO and chooses no default.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import EsvoParameters, MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from published_table import TABLE, H

MARK, METHOD = "esvo-ablation", "ESVO/own-rate"
_WINDOW_S, _WRONG = 1.0, 0.1
_PUBLISHED: dict[str, Any] = {"threshold_c": 14, "median_px": 9, "max_confidence": 57.7}

# What is changed -> the group and its values; an empty group is ESVO's own.
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "nothing": ("", {}),
    "no refinement": ("refinement", {"steps": 0}),
    "3 steps of refinement": ("refinement", {"steps": 3}),
    "50 steps of refinement": ("refinement", {"steps": 50}),
    "coarse search every 4 px": ("matching", {"coarse_px": 4}),
    "matches from ZNCC 0.5": ("matching", {"least_zncc": 0.5}),
    "matches from ZNCC 0.95": ("matching", {"least_zncc": 0.95}),
    "no second estimate asked for": ("clean_up", {"least_fusions": 0}),
    "3 like estimates asked for": ("clean_up", {"least_fusions": 2}),
    "residuals up to 10": ("clean_up", {"most_spread": 10.0}),
    "residuals up to 40": ("clean_up", {"most_spread": 40.0}),
    "deviation up to 1 px": ("clean_up", {"most_deviation_px": 1.0}),
    "regularised, radius 5 px": ("regularisation", {"radius_px": 5}),
    "decay 10 ms": ("", {"decay_s": 0.01}),
    "decay 100 ms": ("", {"decay_s": 0.1}),
    "no median over the surface": ("", {"median_px": 1}),
    "Gaussian of 1 px over it": ("", {"blur_sigma_px": 1.0}),
    "300 events per map": ("", {"most_events": 300}),
    "3000 events per map": ("", {"most_events": 3000}),
    "1500 points fused": ("", {"most_points": 1500}),
    "10000 points fused": ("", {"most_points": 10_000}),
}


@dataclass(frozen=True, eq=False)
class Errors:
    """Of every point with known depth, of one or more windows.

    Attributes:
        error_m: (N,) absolute errors, m.
        truth_m: (N,) true depths, m.
    """

    error_m: NDArray[np.float64]
    truth_m: NDArray[np.float64]

    def cells(self, base: Errors) -> str:
        """Points, mean, median, share off by a tenth, and points and mean relative to a base."""
        wrong = (self.error_m > _WRONG * self.truth_m).mean()
        return (
            f"{len(self.error_m)} | {100 * self.error_m.mean():.1f} | "
            f"{100 * np.median(self.error_m):.1f} | {100 * wrong:.0f} | "
            f"{len(self.error_m) / len(base.error_m):.2f} | "
            f"{self.error_m.mean() / base.error_m.mean():.2f}"
        )


def configs(
    sequence: Sequence, esvo: EsvoParameters, methods: tuple[str, ...]
) -> Iterator[MapperConfig]:
    """One configuration per whole window of the sequence.

    Raises:
        InputError: a sequence without a whole window.
    """
    times_us = sequence.truth_times_us(0)
    count = int((times_us[-1] - times_us[0]) / 1e6 / _WINDOW_S)
    if count < 1:
        raise InputError(
            f"sequence of {(times_us[-1] - times_us[0]) / 1e6:g} s: needs a window of "
            f"{_WINDOW_S:g} s: simulate with --seconds {_WINDOW_S:g} or more"
        )
    for k in range(count):
        yield MapperConfig(
            methods=methods, start_s=k * _WINDOW_S, duration_s=_WINDOW_S, esvo=esvo, **_PUBLISHED
        )


def errors_of(sequence: Sequence, found: DepthMap) -> Errors:
    """Errors where the truth, of the stored time nearest to the map's, is known."""
    times_us = sequence.truth_times_us(0)
    nearest_us = int(times_us[np.argmin(np.abs(times_us - found.t_us))])
    truth_m = sequence.truth_view_depth_m(0, nearest_us)
    known = found.mask & (truth_m > 0)
    error_m = np.abs(found.depth_m[known].astype(np.float64) - truth_m[known])
    return Errors(error_m, truth_m[known].astype(np.float64))


def pooled(
    sequence: Sequence, methods: tuple[str, ...], esvo: EsvoParameters | None = None
) -> dict[str, Errors]:
    """Errors of each method over all windows."""
    parts: dict[str, list[Errors]] = {name: [] for name in methods}
    for config in configs(sequence, esvo or EsvoParameters(), methods):
        for name, found in map_window(sequence, config).depth_maps.items():
            parts[name].append(errors_of(sequence, found))
    return {
        name: Errors(
            np.concatenate([one.error_m for one in some]),
            np.concatenate([one.truth_m for one in some]),
        )
        for name, some in parts.items()
    }


def changed(group: str, values: Mapping[str, Any]) -> EsvoParameters:
    """ESVO's parameters with some values of a group replaced, checked as from a file."""
    return EsvoParameters.model_validate({group: values} if group else dict(values))


def report(sequence: Sequence) -> str:
    """Both tables, in Markdown."""
    names = (*(line.ours for line in TABLE), "EMVS/cam1", "SGM/ts", "ESVO/window")
    found = pooled(sequence, names)
    base, published = found[H.ours], {line.ours: line for line in TABLE}
    head = "points | mean, cm | median, cm | off by a tenth, % | points / H | mean / H |"
    lines = [f"| method | {head} published: points | mean |", "|---|" + "--:|" * 8]
    for name in sorted(names, key=lambda name: found[name].error_m.mean()):
        line = published.get(name)
        other = (
            f"{line.points_m / H.points_m:.2f} | {line.mean_cm / H.mean_cm:.2f}" if line else " | "
        )
        lines.append(f"| `{name}` | {found[name].cells(base)} | {other} |")
    lines += ["", f"One setting of `{METHOD}` changed at a time:", ""]
    lines += [f"| changed | {head}", "|---|" + "--:|" * 6]
    for title, (group, values) in VARIANTS.items():
        errors = pooled(sequence, (METHOD,), changed(group, values))[METHOD]
        lines.append(f"| {title} | {errors.cells(base)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Prints the tables, and writes them into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequence", type=Path, help="what eventsweep simulate wrote")
    parser.add_argument("--page", type=Path, help="page to write the tables into")
    asked = parser.parse_args()
    with exit_code() as code:
        text = report(Sequence.open(asked.sequence))
        show(text, asked.page, MARK)
    return code.value


if __name__ == "__main__":
    raise SystemExit(main())
