"""Whether depth errors, and the order of methods, depend on how finely a scene is sampled.

`python tests/benchmarks sampling_depth --out DIR --page docs/simulator.md` simulates each case in
every way that `fidelity` knows, maps it with all methods and scores it. Jobs are kept in the cache.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy import stats

from eventsweep.eval.suite.results import read_suite
from eventsweep.eval.suite.series import Key, Series, of_suite
from fidelity import WAYS
from markdown_blocks import show

CASES = ("desk", "boxes", "thin-structures", "planes")
SHOWN = ("Alg1/H", "Focus/H", "EMVS/cam0")
METRICS = ("mean_error", "bad_published", "points")
MARK = "sampling-depth"
_HEAD = """\
name = "sampling-depth"
summary = "scenes simulated in several ways"
seeds = [0, 1, 2]
spread_seeds = [0]
metrics = ["points", "mean_error", "median_error", "bad_published"]

[mappers.default]
methods = ["all"]
"""
_CASE = """
[cases.{name}]
scene = "{scene}"
rig = "davis346"
seconds = 0.4
windows = [{{ start_s = 0.1, duration_s = 0.2 }}]
mappers = ["default"]
sim = {{ {settings} }}
"""


def name_of(scene: str, way: str) -> str:
    """A case's name."""
    return f"{scene}-{list(WAYS).index(way)}"


def definition() -> str:
    """The suite, as TOML."""
    cases = []
    for scene in CASES:
        for way, settings in WAYS.items():
            said = ", ".join(f"{key} = {json.dumps(value)}" for key, value in settings.items())
            cases.append(_CASE.format(name=name_of(scene, way), scene=scene, settings=said))
    return _HEAD + "".join(cases)


def order(found: Mapping[Key, Series], case: str) -> dict[str, float]:
    """Mean error by method, mean over seeds."""
    return {
        key.method: float(np.mean([*series.values.values()]))
        for key, series in found.items()
        if key.case == case and key.metric == "mean_error"
    }


def table(found: Mapping[Key, Series]) -> str:
    """Errors of some methods, and how the order of all agrees with that of the finest."""
    finest = list(WAYS)[-1]
    head = " | ".join(f"{method}" for method in SHOWN)
    lines = [
        "Mean error (cm), bad pixels (%), points; means of three seeds. *Order*: Kendall's τ "
        f"between the order of all methods by mean error and that with {finest}. Written by "
        "`python tests/benchmarks sampling_depth`.",
        "",
        f"| Scene | sampling | {head} | order |",
        f"|---|---|{'--:|' * len(SHOWN)}--:|",
    ]
    for scene in CASES:
        best = order(found, name_of(scene, finest))
        for way in WAYS:
            name = name_of(scene, way)
            own = order(found, name)
            tau = stats.kendalltau([best[m] for m in best], [own[m] for m in best]).statistic
            cells = [shown(found, name, method) for method in SHOWN]
            lines.append(f"| {scene} | {way} | {' | '.join(cells)} | {tau:.2f} |")
    return "\n".join(lines) + "\n"


def shown(found: Mapping[Key, Series], case: str, method: str) -> str:
    """The three numbers of a method."""
    mean_m, bad, points = (
        float(np.mean([*found[Key(case, method, metric)].values.values()])) for metric in METRICS
    )
    return f"{100 * mean_m:.1f} cm, {bad:.1f} %, {points:.0f}"


def main() -> None:
    """Runs what is not in the cache yet; prints the table, and writes it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the suite's result")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--workers", default="2")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "sampling-depth.toml"
    file.write_text(definition(), encoding="utf-8")
    words = ["suite", str(file), "--out", str(asked.out / "result"), "--workers", asked.workers]
    flags = ["--no-speed", "--force", "--quiet"]
    subprocess.run([sys.executable, "-m", "eventsweep", *words, *flags], check=True)
    text = table(of_suite(read_suite(asked.out / "result")).series)
    show(text, asked.page, MARK)


if __name__ == "__main__":
    main()
