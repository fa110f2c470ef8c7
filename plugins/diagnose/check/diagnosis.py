"""What trials say together, and how a finding says it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eventsweep.plugins.diagnose.check.alternatives import Amount
from eventsweep.plugins.diagnose.check.findings import Finding, Series
from eventsweep.plugins.diagnose.check.limits import BARS
from eventsweep.plugins.diagnose.check.trial_windows import Gains
from eventsweep.plugins.diagnose.check.trials import Trial


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the trials of one pair of cameras, or of one camera, say together.

    Attributes:
        trials: of all alternatives.
        best: the sharpest one that explains, or the sharpest if none does; camera 0 alone does not
            contradict it.
        unexplained: what speaks against these causes, in words; empty where they explain.
        rivals: other causes that explain about as much.
        second: what is still wrong after the best cure; None where nothing is.
        decisive: whether the map becomes so much sharper that something is certainly wrong.
    """

    trials: tuple[Trial, ...]
    best: Trial
    unexplained: str
    rivals: tuple[Trial, ...] = ()
    second: Trial | None = None
    decisive: bool = False


_MEANING = "depth comes from where rays meet, and they meet less sharply than they could"


def as_finding(name: str, cameras: str, diagnosis: Diagnosis) -> Finding:
    """The finding: only a cause that explains is named, with its cure.

    Args:
        name: of the check.
        cameras: their names.
        diagnosis: what the trials say.
    """
    best, gain = diagnosis.best, float(np.expm1(diagnosis.best.gain))
    if best.verdict == "good" and not diagnosis.unexplained:
        words = f"{cameras}: none of {len(diagnosis.trials)} alternatives makes the map sharper"
        return Finding(name, "good", gain, "", words, series=_series(diagnosis.trials))
    if not diagnosis.unexplained:
        return _named_finding(name, cameras, diagnosis)
    who = "the cameras do not agree with each other" if best.alternative.of_pair else (
        "poses do not agree with the events"
    )  # fmt: skip
    return Finding(
        name, "wrong" if diagnosis.decisive else "doubtful", gain, "",
        f"{cameras}: {who}: {diagnosis.unexplained}",
        f"{_MEANING}: run `calibrate`; if it does not help, look at how the poses are stored "
        "(handedness, degrees or radians, order of Euler angles, direction) and whether clocks and "
        "calibration belong to this recording",
        "", "no single cause found", _series(diagnosis.trials),
    )  # fmt: skip


def _named_finding(name: str, cameras: str, diagnosis: Diagnosis) -> Finding:
    best, second, gain = diagnosis.best, diagnosis.second, float(np.expm1(diagnosis.best.gain))
    either = [best, *diagnosis.rivals]
    words = " or ".join(map(amount_words, either))
    cure = "; or ".join(map(_cure, either))
    suspect = " or ".join(trial.alternative.name for trial in either)
    if second is not None:
        words += f", and {np.expm1(second.gain):.1%} more with {amount_words(second)}"
        cure = f"{cure}; and {_cure(second)}; then check again"
        suspect = f"{suspect} and {second.alternative.name}"
    words = (
        f"{cameras}: correcting this makes the map {gain:.1%} sharper: {words}; "
        f"windows {', '.join(f'{np.expm1(g):+.1%}' for g in best.gains)}"
    )
    series = _series(diagnosis.trials) if best.amount is None else _curve(best)
    return Finding(name, best.verdict, gain, "", words, _MEANING, cure, suspect, series)


def percent(gain: float) -> str:
    """A gain in log sharpness as a share."""
    return f"{np.expm1(gain):.1%}"


def percents(gains: Gains) -> str:
    """Gains of windows as shares."""
    return ", ".join(map(percent, gains))


def _unit(trial: Trial) -> str:
    return (trial.alternative.unit if isinstance(trial.alternative, Amount) else "") or "times"


def amount_words(trial: Trial) -> str:
    """What is corrected, and by how much."""
    by = "" if trial.amount is None else f" by {trial.amount:.3g} {_unit(trial)}"
    return f"{trial.alternative.name}{by}"


def _cure(trial: Trial) -> str:
    if trial.amount is None:
        return trial.alternative.cure
    return f"{trial.alternative.cure.format(amount=trial.amount)}; `calibrate` refines it"


def _curve(best: Trial) -> Series:
    amounts, gains = best.curve
    x_label = f"{best.alternative.name}, {_unit(best)}"
    return Series(100 * np.expm1(gains.mean(axis=1)), amounts, x_label, "sharper by, %", (0.0,))


def _series(trials: Sequence[Trial]) -> Series:
    """The best alternatives, by name."""
    best = sorted(trials, key=lambda trial: trial.gain, reverse=True)[:BARS]
    gains = np.array([100 * np.expm1(trial.gain) for trial in best])
    names = tuple(trial.alternative.name for trial in best)
    return Series(gains, x_label="sharper by, %", limits=(0.0,), names=names)
