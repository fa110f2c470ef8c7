"""Which imperfections bring the published table of MVSEC's flights out of its twin.

`python tests/benchmarks fit_imperfection --page docs/studies.md` maps twins of other flights than
the suite's with errors of poses, clocks, calibration and truth, and searches at random for the
amounts that come nearest to the published errors and points of H and of one camera. The best are a
preset of `eval.perturbations`; `--held-out` shows what it does on the suite's flights, on which it
was not chosen, beside the networks.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.perturbations import PRESETS, Perturbation
from imperfection_trials import EQUAL, EXACT, METRICS, Draw, Trials, TruthError
from markdown_blocks import show
from published_table import MONO, RATIOS, SGM, H
from study_extraction import Numbers

MARK, HELD_OUT_MARK = "imperfection", "imperfection-held-out"
FLIGHTS, HELD_OUT = (3, 4, 5), (0, 1, 2)
PAIR = (H.ours, MONO.ours)
NETWORKS = (*PAIR, "Focus/H", "Learned/H")
TIMES = 4
"""How often the random errors of a flight are drawn; first as a suite draws them."""
DRAWS = tuple(Draw(flight, flight + 100 * k) for k in range(TIMES) for flight in FLIGHTS)
HELD_OUT_DRAWS = tuple(
    Draw(flight, flight + 100 * k, start_s)
    for k in range(TIMES)
    for flight in HELD_OUT
    for start_s in (0.0, 0.2)
)
ROUNDS = ((72, 3), (30, 6), (16, 12))
"""Of each round of the search how many new amounts, and on how many draws they are tried."""
KEPT = 6
"""How many of the best go on into the next round."""
ALIKE = 1.01
"""How much worse the best set may become where errors are left out of it, as a factor."""
KNOWN = {"none": Perturbation(), **PRESETS}
SHOWN = ("none", "mvsec-v2")
"""With which the networks are shown."""


class Axis(NamedTuple):
    """Sizes of an error that are tried where it is not 0."""

    least: float
    most: float
    signed: bool = True


AXES = {
    "pose_walk_deg": Axis(0.1, 1.5, signed=False),
    "pose_walk_mm": Axis(2, 40, signed=False),
    "pose_delay_ms": Axis(1, 30),
    "camera_delay_ms": Axis(0.3, 10),
    "focal_percent": Axis(0.3, 4),
    "stereo_yaw_deg": Axis(0.02, 0.4),
    "stereo_pitch_deg": Axis(0.02, 0.4),
}
TRUTHS = tuple(
    TruthError(mm, deg) for mm, deg in product((0.0, 20.0, 50.0, 100.0), (0.0, 0.3, 0.7, 1.5))
)


class Candidate(NamedTuple):
    """One set of errors, and what came out: numbers of each method, means over the draws."""

    amount: Perturbation
    truth: TruthError
    numbers: Mapping[str, Numbers]

    @property
    def sizes(self) -> dict[str, float]:
        """Of the errors that are there."""
        truth = {name: size for name, size in self.truth._asdict().items() if size}
        return {**self.amount.model_dump(exclude_defaults=True), **truth}

    def ratio(self, metric: str) -> float:
        """Of H to one camera."""
        return self.numbers[H.ours][metric] / self.numbers[MONO.ours][metric]

    @property
    def factors(self) -> dict[str, float]:
        """What the fit compares, over what is published: ratios, mean errors, points."""
        ratios = {name: self.ratio(m) / (H.value(m) / MONO.value(m)) for m, name in RATIOS.items()}
        means = {
            one.ours: 100 * self.numbers[one.ours]["mean_error"] / one.mean_cm for one in (H, MONO)
        }
        points = self.numbers[H.ours]["points"]
        shares = {
            f"points / {one.ours}": points
            / self.numbers[one.ours]["points"]
            / (H.points_m / one.points_m)
            for one in (MONO, SGM)
        }
        return {**ratios, **means, **shares}

    @property
    def off(self) -> float:
        """Factor by which a number is off the published one: root mean square of logarithms."""
        logs = np.log(list(self.factors.values()))
        return float(np.exp(np.sqrt(np.mean(logs**2))))


def main() -> int:
    """Maps, prints and writes a table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--held-out", action="store_true", help="the presets on the suite's flights"
    )
    parser.add_argument("--cache", type=Path, default=Path("out/imperfection"))
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args()
    with exit_code() as code:
        trials = Trials(asked.cache)
        if asked.held_out:
            show(held_out_table(trials), asked.page, HELD_OUT_MARK)
        else:
            show(table(*search(trials)), asked.page, MARK)
    return code.value


def search(trials: Trials) -> tuple[list[Candidate], list[Candidate]]:
    """Nothing wrong and the presets; and the best sets of a search in rounds, pruned ones first."""
    rng, best = np.random.default_rng(0), list[Candidate]()
    for new, draws in ROUNDS:
        tried = [one.amount for one in best[:KEPT]]
        tried += [_neighbour(rng, tried) if tried else _anywhere(rng) for _ in range(new)]
        best = _sorted(_best(trials, one, DRAWS[:draws]) for one in tried)
        sys.stderr.write(f"{draws} draws: {best[0].off:.2f}, {_words(best[0])}\n")
    known = [_measured(trials, one, [EXACT], DRAWS, PAIR)[0] for one in KNOWN.values()]
    return known, [*_pruned(trials, best[0]), *best]


def _sorted(found: Iterable[Candidate]) -> list[Candidate]:
    return sorted(found, key=lambda one: one.off)


def _best(trials: Trials, amount: Perturbation, draws: Sequence[Draw]) -> Candidate:
    """With the error of the truth that suits it best; that takes no mapping."""
    return _sorted(_measured(trials, amount, TRUTHS, draws, PAIR))[0]


def _pruned(trials: Trials, best: Candidate) -> list[Candidate]:
    """The best with fewer and fewer errors, as long as it is hardly worse: the fewest first."""
    found: list[Candidate] = []
    while fewer := _simpler(trials, found[0] if found else best):
        if fewer[0].off > ALIKE * best.off:
            break
        found.insert(0, fewer[0])
    return found


def _simpler(trials: Trials, one: Candidate) -> list[Candidate]:
    """What comes out with one error less, of the geometry or the truth; the least wrong first."""
    names = [name for name in AXES if getattr(one.amount, name)]
    fewer = [_best(trials, one.amount.model_copy(update={name: 0.0}), DRAWS) for name in names]
    fewer += _measured(trials, one.amount, [EXACT], DRAWS, PAIR)
    return [other for other in _sorted(fewer) if len(other.sizes) < len(one.sizes)]


def _measured(
    trials: Trials, amount: Perturbation, truths: Sequence[TruthError], draws: Sequence[Draw],
    methods: tuple[str, ...],
) -> list[Candidate]:  # fmt: skip
    found = [trials.numbers(amount, truths, draw, methods) for draw in draws]
    dense = [_sgm(trials, draw) for draw in draws]
    return [
        Candidate(amount, truth, _means([a[k] | b for a, b in zip(found, dense, strict=True)]))
        for k, truth in enumerate(truths)
    ]


def _sgm(trials: Trials, draw: Draw) -> dict[str, Numbers]:
    """What SGM reports of a window: it knows no poses, and here no other error either."""
    exact = Draw(draw.flight, 0, draw.start_s)
    found = trials.numbers(Perturbation(), [EXACT], exact, (H.ours, SGM.ours))[0]
    return {SGM.ours: found[SGM.ours]}


def _means(found: Sequence[Mapping[str, Numbers]]) -> dict[str, Numbers]:
    return {
        name: {m: float(np.mean([one[name][m] for one in found])) for m in METRICS}
        for name in found[0]
    }


def _anywhere(rng: np.random.Generator) -> Perturbation:
    """Each error there or not, its size between the limits, as likely in each octave."""
    return Perturbation(
        **{name: _size(rng, axis) for name, axis in AXES.items() if _coin(rng, 0.5)}
    )


def _neighbour(rng: np.random.Generator, best: Sequence[Perturbation]) -> Perturbation:
    """One of the best with every size changed a little, and now and then an error more or less."""
    near = best[int(rng.integers(len(best)))].model_dump()
    values = {}
    for name, axis in AXES.items():
        size = near[name] * float(np.exp(0.3 * rng.normal()))
        values[name] = _rounded(size)
        if _coin(rng, 0.15):
            values[name] = 0.0 if size else _size(rng, axis)
    return Perturbation(**values)


def _size(rng: np.random.Generator, axis: Axis) -> float:
    size = _rounded(float(np.exp(rng.uniform(np.log(axis.least), np.log(axis.most)))))
    return -size if axis.signed and _coin(rng, 0.5) else size


def _coin(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def _rounded(size: float) -> float:
    return float(f"{size:.2g}")


def table(known: Sequence[Candidate], best: Sequence[Candidate], rows: int = 2) -> str:
    """Markdown: nothing wrong, the presets, and the best sets that are no preset."""
    others = [one for one in best if one.amount not in PRESETS.values()]
    about = (
        f"Means over {len(DRAWS)} windows of 1 s: {len(FLIGHTS)} flights that the suite does not "
        f"have, the random errors drawn {TIMES} times.\n\n"
    )
    return about + _lines([*known, *others[:rows]])


def _lines(found: Iterable[Candidate]) -> str:
    ratios = " | ".join(f"{H.value(m) / MONO.value(m):.2f}" for m in RATIOS)
    lines = [
        f"| errors | {' | '.join(RATIOS.values())} | H, cm | mono, cm | points of H | H / mono "
        "| H / SGM | factor |",
        "|---|" + "--:|" * (len(RATIOS) + 6),
        f"| published | {ratios} | {H.mean_cm:.1f} | {MONO.mean_cm:.1f} | "
        f"| {H.points_m / MONO.points_m:.2f} | {H.points_m / SGM.points_m:.3f} | |",
    ]
    return "\n".join([*lines, *map(_line, found)]) + "\n"


def _line(one: Candidate) -> str:
    ratios = " | ".join(f"{one.ratio(m):.2f}" for m in RATIOS)
    cm = " | ".join(f"{100 * one.numbers[name]['mean_error']:.1f}" for name in PAIR)
    points = one.numbers[H.ours]["points"]
    return (
        f"| {_words(one)} | {ratios} | {cm} | {points:.0f} | {one.ratio('points'):.2f} "
        f"| {points / one.numbers[SGM.ours]['points']:.3f} | {one.off:.2f} |"
    )


def _words(one: Candidate) -> str:
    """Errors as a suite's file names them, behind their preset's name."""
    names = [f"`{name}`: " for name, preset in PRESETS.items() if preset == one.amount]
    words = [f"{name} {size:g}" for name, size in one.sizes.items()]
    return "".join(names) + (", ".join(words) or "none")


def held_out_table(trials: Trials) -> str:
    """Markdown: the presets on the suite's flights, and what other methods make of them.

    Focus and the network are shown at their own pixels, and at as many as Alg1/H has.
    """
    found = {
        name: _measured(trials, amount, [EXACT], HELD_OUT_DRAWS, NETWORKS)[0]
        for name, amount in KNOWN.items()
    }
    about = (
        f"Means over the suite's {len(HELD_OUT)} flights, two windows of 1 s each, the random "
        f"errors drawn {TIMES} times.\n\n"
    )
    head = (
        "| errors | method | points | mean, cm | median, cm | bad-pix | equal points: mean "
        "| median | bad-pix |\n|---|---|" + "--:|" * 7
    )
    methods = (H.ours, *NETWORKS[2:])
    lines = [_method_line(name, one, found[name].numbers) for name in SHOWN for one in methods]
    return about + _lines(found.values()) + "\n".join(["", head, *lines, ""])


def _method_line(errors: str, method: str, numbers: Mapping[str, Numbers]) -> str:
    points = f"{numbers[method]['points']:.0f}"
    own, equal = numbers[method], numbers.get(method + EQUAL, numbers[method])
    return f"| {errors} | `{method}` | {points} | {_errors(own)} | {_errors(equal)} |"


def _errors(numbers: Numbers) -> str:
    cm = [f"{100 * numbers[m]:.1f}" for m in ("mean_error", "median_error")]
    return " | ".join([*cm, f"{numbers['bad_published']:.2f}"])


if __name__ == "__main__":
    sys.exit(main())
