"""From which size on `eventsweep check` calls an amount wrong, beside the size that hurts.

    python tests/benchmarks check_sizes --out FOLDER [--page plugins/diagnose/check.md]

Growing amounts are planted, with both signs, in the sequences on which limits were chosen, and
tried against the alternative that mends them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import eventsweep as es
from check_cases import DEVELOPMENT
from check_faults import sequence
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.plugins.diagnose.check.alternatives import Chosen
from eventsweep.plugins.diagnose.check.amounts import Amount, amounts_of_one, amounts_of_pair
from eventsweep.plugins.diagnose.check.trial_windows import TrialWindows
from eventsweep.plugins.diagnose.check.trials import CameraTrials
from markdown_blocks import show

_SIGNS = (-1.0, 1.0)
_SCENES = ("boxes", "desk", "thin-structures", "tumvie-6dof")


@dataclass(frozen=True)
class Study:
    """One amount.

    Attributes:
        name: of the alternative.
        sizes: tried, growing; of factors, as shares.
        hurts: where a map suffers, in words.
    """

    name: str
    sizes: tuple[float, ...]
    hurts: str


STUDIES = (
    Study("camera clock", (2, 5, 7, 10, 15, 20), "5 ms"),
    Study("stereo yaw", (0.1, 0.2, 0.4, 0.7, 1.0, 1.5), "0.2 deg"),
    Study("stereo pitch", (0.1, 0.15, 0.2, 0.3, 0.5), "0.15 deg"),
    Study("stereo roll", (0.2, 0.3, 0.5, 0.8, 1.2), "not studied"),
    Study("baseline", (0.05, 0.1, 0.2, 0.3, 0.5), "20 to 40 % (twice the error)"),
    Study("pose clock", (10, 20, 30, 40, 60), "40 ms (twice the error)"),
    Study("focal length", (0.1, 0.2, 0.3, 0.5), "15 % (twice the error)"),
    Study("hand-eye rotation about x", (1, 2, 3, 5, 8), "not studied"),
    Study("hand-eye rotation about y", (1, 2, 3, 5, 8), "not studied"),
    Study("hand-eye rotation about z", (1, 2, 3, 5, 8), "not studied"),
)


def amount_of(name: str) -> Amount:
    """The alternative of a name."""
    every = (*amounts_of_one(paired=True), *amounts_of_pair())
    return next(one for one in every if one.name == name)


def seen_share(amount: Amount, size: float, recordings: Sequence[Recording]) -> float:
    """Share of sequences and signs in which so much is called wrong."""
    verdicts = []
    for recording in recordings:
        pair = Chosen(recording, (0, 1))
        for sign in _SIGNS:
            signed_size = float(np.exp(sign * np.log1p(size))) if amount.is_factor else sign * size
            windows = TrialWindows.of(amount.change(pair, signed_size), MapperConfig())
            trial = CameraTrials(windows, (0, 1)).trial(amount)
            verdicts.append(trial.verdict == "wrong")
    return float(np.mean(verdicts))


def line(study: Study, recordings: Sequence[Recording]) -> str:
    """The table's line of one amount."""
    amount = amount_of(study.name)
    unit = "%" if amount.is_factor else amount.unit
    factor = 100 if amount.is_factor else 1
    needed, seen = 1 - 1 / len(recordings), None
    shares: dict[float, float] = {}
    for size in study.sizes:
        shares[size] = seen_share(amount, size, recordings)
        sys.stderr.write(f"{study.name} {size}: {shares[size]:.0%}\n")
        if shares[size] >= needed:
            seen = size
            break
    words = "none tried" if seen is None else f"{factor * seen:g} {unit}"
    cells = ", ".join(f"{factor * s:g}: {share:.0%}" for s, share in shares.items())
    return f"| {study.name} | {words} | {study.hurts} | {cells} |"


def table(recordings: Sequence[Recording]) -> str:
    """The table as Markdown."""
    lines = [
        f"Planted with both signs in {len(recordings)} sequences. An amount counts as seen if "
        f"{1 - 1 / len(recordings):.0%} of them or more are called wrong; the last column has that "
        "share for each amount tried, up to the first that is seen.",
        "",
        "| Amount | seen from | hurts from | called wrong |",
        "|---|--:|--:|---|",
        *(line(study, recordings) for study in STUDIES),
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Tries every amount, and writes the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of check_faults")
    parser.add_argument("--page", type=Path, help="page whose table is rewritten")
    flags = parser.parse_args()
    bases = [base for base in DEVELOPMENT if base.scene in _SCENES]
    text = table([es.open_recording(sequence(base, flags.out)) for base in bases])
    show(text, flags.page, "check-sizes")


if __name__ == "__main__":
    main()
