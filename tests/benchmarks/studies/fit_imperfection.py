"""Which imperfections bring the published table of MVSEC's flights out of its twin.

`python tests/benchmarks fit_imperfection` tries errors of the twin's poses and
calibration within what real recordings bound (`pixel_spread`), for a few sensors, on flights 0 and
1, and prints those that come nearest to the published ratios of Alg1/H to one camera and to their
mean errors. `--held-out` shows the chosen one on flights 4 and 5, on which nothing was chosen.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from eventsweep.eval.cli.console import Console
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.cli.job_flags import JobFlags
from eventsweep.eval.perturbations import PRESETS
from imperfection_trials import CAPS, METRICS, Bench, Extraction, Numbers, Trial
from published_table import MONO, H
from twin_factors import DAVIS346, HALF, HALF_NOISY, head, line

FLIGHTS, HELD_OUT, TIMES = (0, 1), (4, 5), 2
SENSORS: Mapping[str, Mapping[str, Any]] = {
    "`davis346`": DAVIS346, "C .30, 0.3 of the noise": HALF, "C .30": HALF_NOISY,
}  # fmt: skip
WALKS_MM, PITCHES_DEG = (0, 9, 18), (0, 0.15, 0.3)
EXTRACTIONS = {"57.7": Extraction(), "by flight": Extraction(cap=CAPS)}
SHOWN = 6
EXACT, CHOSEN = (
    Trial(),
    Trial(sim=HALF, wrong=PRESETS["mvsec-v3"].model_dump(exclude_defaults=True)),
)


def off(found: Mapping[str, Numbers]) -> float:
    """Factor by which numbers are off the published ones: root mean square of logarithms.

    Four ratios of H to one camera, and both mean errors: medians hold the published truth's own
    error, which the twin's has not. Infinite where there is nothing.
    """
    h, mono = found[H.ours], found[MONO.ours]
    published = [*(H.value(m) / MONO.value(m) for m in METRICS[:3]), H.points_m / MONO.points_m]
    ratios = [h[m] / mono[m] / p if mono[m] else 0 for m, p in zip(METRICS, published, strict=True)]
    means = [100 * one["mean_error"] / p.mean_cm for one, p in ((h, H), (mono, MONO))]
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.exp(np.sqrt(np.mean(np.log([*ratios, *means]) ** 2))))


def candidates() -> Iterator[tuple[str, Trial]]:
    """Every sensor with every error."""
    for (name, sim), mm, deg in product(SENSORS.items(), WALKS_MM, PITCHES_DEG):
        wrong = {"pose_walk_mm": mm, "stereo_pitch_deg": deg}
        words = f"{name}, walk {mm} mm/√s, pitch {deg}°"
        yield words, Trial(sim=sim, wrong={key: size for key, size in wrong.items() if size})


def fitted(bench: Bench) -> str:
    """Markdown: nothing wrong, and what comes nearest to the publication, with how far it is."""
    tried = dict(candidates())
    bench.prepare([EXACT, *tried.values()], FLIGHTS, TIMES)
    found = {"exact": bench.numbers(EXACT, FLIGHTS, TIMES)}
    for (name, trial), (cap, how) in product(tried.items(), EXTRACTIONS.items()):
        one = replace(trial, extraction=how)
        found[f"{name}, cap {cap}"] = bench.numbers(one, FLIGHTS, TIMES)
    best = sorted(found, key=lambda name: off(found[name]))[:SHOWN]
    found["`mvsec-v3`"] = bench.numbers(CHOSEN, FLIGHTS, TIMES)
    shown = dict.fromkeys(["exact", *best, "`mvsec-v3`"])
    return _table({name: found[name] for name in shown}, FLIGHTS)


def held_out(bench: Bench) -> str:
    """Markdown: nothing wrong, and the chosen sensor and errors, on flights not chosen on."""
    trials = {
        "C .30, 0.3 of the noise, nothing wrong": Trial(sim=HALF), "`mvsec-v3`": CHOSEN,
        "`mvsec-v3`, caps by flight": replace(CHOSEN, extraction=Extraction(cap=CAPS)),
    }  # fmt: skip
    bench.prepare(list(trials.values()), HELD_OUT, TIMES)
    found = {name: bench.numbers(one, HELD_OUT, TIMES) for name, one in trials.items()}
    return _table(found, HELD_OUT)


def _table(found: Mapping[str, Mapping[str, Numbers]], flights: Sequence[int]) -> str:
    lines = [f"{line(name, one)} {off(one):.2f} |" for name, one in found.items()]
    title, rule, published = head()
    about = (
        f"Flights {' and '.join(map(str, flights))}, two windows of 1 s each, random errors drawn "
        f"{TIMES} times.\n"
    )
    rows = [about, f"{title} factor |", f"{rule}--:|", f"{published} |", *lines]
    return "\n".join(rows) + "\n"


def main() -> int:
    """Prints a table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--held-out", action="store_true", help="the choice, on other flights")
    parser.add_argument("--workers", type=int, help="worker processes")
    asked = parser.parse_args()
    with exit_code() as code:
        bench = Bench(JobFlags(workers=asked.workers), Console(quiet=False, as_json=False).progress)
        sys.stdout.write((held_out if asked.held_out else fitted)(bench))
    return code.value


if __name__ == "__main__":
    sys.exit(main())
