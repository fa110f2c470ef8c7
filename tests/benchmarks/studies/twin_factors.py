"""What makes fusion gain less on the twin of MVSEC's flights than on the flights, one by one.

`python tests/benchmarks twin_factors [--flights 0,1] [--only WORD]` changes the
twin's sensor, way, textures, geometry, extraction and scores, one at a time and together, and sets
Alg1/H over one camera beside the published table. Sequences and sweeps are jobs that the cache
keeps: a second run goes on where the first one stopped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import Any

from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.console import Console
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.perturbations import PRESETS
from imperfection_trials import CAPS, METRICS, Bench, Extraction, Numbers, Trial
from published_table import MONO, H

DAVIS346: dict[str, Any] = {"sensor": {"preset": "davis346"}}
_UNEQUAL = {"sensor": {"preset": "davis346", "threshold_sigma": 0.05}}
_NOISE = {
    "preset": "davis346", "leak_rate_hz": 0.03, "shot_rate_dark_hz": 0.12,
    "shot_rate_bright_hz": 0.03, "hot_pixel_fraction": 0,
}  # fmt: skip
REAL: dict[str, Any] = {
    "contrast_threshold_pos": 0.60,
    "contrast_threshold_neg": 0.43,
    "sensor": {**_NOISE, "threshold_sigma": 0.05},
}
"""Thresholds, their spread, and noise of the real DAVIS240C that `pixel_spread` looks at."""
HALF: dict[str, Any] = {
    "contrast_threshold_pos": 0.3,
    "contrast_threshold_neg": 0.3,
    "sensor": {**_NOISE, "threshold_sigma": 0.03},
}
"""The same noise and relative spread, with the thresholds at which the greatest votes are about
those that the authors' configurations take as full confidence."""
HALF_NOISY = {**HALF, "sensor": {"preset": "davis346"}}
"""The same with the preset's noise, of which a lit desk shows a real camera to have a third."""
V3 = PRESETS["mvsec-v3"].model_dump(exclude_defaults=True)

FACTORS: dict[str, Trial] = {
    "exact geometry, ideal sensor": Trial(),
    "preset `davis346`: C .143/.225, σ .03": Trial(sim=DAVIS346),
    "the same, σ .05": Trial(sim=_UNEQUAL),
    "a real DAVIS240C's: C .60/.43, σ .05, 0.3 of the noise": Trial(sim=REAL),
    "C .30, σ .03, 0.3 of the noise": Trial(sim=HALF),
    "C .30, σ .03, the preset's noise": Trial(sim=HALF_NOISY),
    "sideways alone, 25 cm": Trial(change={"heading_deg": 0}),
    "forward alone, 25 cm": Trial(change={"heading_deg": 90}),
    "textures twice as dense": Trial(change={"texture_density": 2}),
    "textures half as dense": Trial(change={"texture_density": 0.5}),
    "radius filter: 3 within 5 cm": Trial(extraction=Extraction(radius_m=0.05)),
    "errors over 1 m count as 1 m": Trial(extraction=Extraction(most_error_m=1)),
    "border of 20 px left out": Trial(extraction=Extraction(border_px=20)),
    "caps 57.7, 78, 78.8 by flight": Trial(extraction=Extraction(cap=CAPS)),
    "cap: mean of H's maxima": Trial(extraction=Extraction(cap=None)),
    "C = 10 for cam0 alone": Trial(extraction=Extraction(mono_c=10)),
    "poses walk by 18 mm per √s": Trial(wrong={"pose_walk_mm": 18}),
    "rotation noise of .026°": Trial(wrong={"pose_white_deg": 0.026}),
    "stereo pitch .3°": Trial(wrong={"stereo_pitch_deg": 0.3}),
    "C .30, 0.3 of the noise, `mvsec-v3`": Trial(sim=HALF, wrong=V3),
    "the same, the preset's noise": Trial(sim=HALF_NOISY, wrong=V3),
    "`mvsec-v3`, caps by flight": Trial(sim=HALF, wrong=V3, extraction=Extraction(cap=CAPS)),
    "`mvsec-v3`, radius filter": Trial(sim=HALF, wrong=V3, extraction=Extraction(radius_m=0.05)),
    "`mvsec-v3`, errors over 1 m count as 1 m": Trial(
        sim=HALF, wrong=V3, extraction=Extraction(most_error_m=1)
    ),
}
"""What is changed; all else is as the suite `mvsec-table-v2` has it."""


def line(name: str, found: Mapping[str, Numbers]) -> str:
    """Markdown: ratios of H to one camera, and the numbers of both."""
    h, mono = found[H.ours], found[MONO.ours]
    ratios = " | ".join(f"{h[m] / mono[m]:.2f}" if mono[m] else "–" for m in METRICS)
    both = " | ".join(
        f"{100 * one['mean_error']:.1f}/{100 * one['median_error']:.1f}/{one['bad_published']:.2f}"
        for one in (h, mono)
    )
    return f"| {name} | {ratios} | {both} | {h['points']:.0f} | {h['top']:.0f} |"


def head() -> list[str]:
    """The table's head, and what is published."""
    ratios = [H.value(m) / MONO.value(m) for m in METRICS[:3]]
    ratios.append(H.points_m / MONO.points_m)
    both = [f"{one.mean_cm:.1f}/{one.median_cm:.1f}/{one.bad_percent:.2f}" for one in (H, MONO)]
    cells = [*(f"{ratio:.2f}" for ratio in ratios), *both]
    return [
        "| `Alg1/H` over `EMVS/cam0` | mean | median | bad | points | H: cm/cm/% | cam0: cm/cm/% "
        "| H's points | votes |",
        "|---|" + "--:|" * 8,
        f"| **published** | {' | '.join(cells)} | | 58 to 79 |",
    ]


def main() -> int:
    """Prints the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", default="0,1", help="seeds of the twin's motion")
    parser.add_argument("--times", type=int, default=2, help="how often random errors are drawn")
    parser.add_argument("--only", default="", help="factors whose name holds this")
    parser.add_argument("--workers", type=int, help="worker processes")
    asked = parser.parse_args()
    with exit_code() as code:
        sys.stdout.write(table(asked))
    return code.value


def table(asked: argparse.Namespace) -> str:
    """Markdown: a line for each factor."""
    flights = job_flags.seed_numbers(asked.flights, "--flights") or ()
    chosen = {name: one for name, one in FACTORS.items() if asked.only in name}
    progress = Console(quiet=False, as_json=False).progress
    bench = Bench(job_flags.JobFlags(workers=asked.workers), progress)
    bench.prepare(list(chosen.values()), flights, asked.times)
    lines = [line(name, bench.numbers(one, flights, asked.times)) for name, one in chosen.items()]
    about = (
        f"Flights {asked.flights}, two overlapping windows of 1 s each, random errors drawn "
        f"{asked.times} times; pixels of all windows together. Differences under 0.1 say nothing.\n"
    )
    return "\n".join([about, *head(), *lines]) + "\n"


if __name__ == "__main__":
    sys.exit(main())
