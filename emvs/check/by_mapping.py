"""Checks by mapping: do rays meet more sharply under an alternative? Then something is wrong.

Three windows are mapped as given, and again under every alternative (`trials`). The best one is
named only if it explains: no other one does as well, its amount is an optimum within its search,
and after it the camera gains nothing by turning otherwise (`TrialWindows.free_turn_gains`). Else
the poses do not fit the events, and no cause is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eventsweep.emvs.check.alternatives import (
    MARGIN,
    Alternative,
    Amount,
    amounts_of_one,
    amounts_of_pair,
    of_pair,
    of_poses,
)
from eventsweep.emvs.check.findings import Finding, Series, Verdict
from eventsweep.emvs.check.trial_windows import Gains, TrialWindows
from eventsweep.emvs.check.trials import CameraTrials, Trial
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.utils.runtime import Progress, silent

_BARS = 12  # alternatives in the page, the best ones
# Gain in log sharpness where the camera may turn freely: more after a cure, and it does not explain
# (half as much again for a single camera); more where nothing helps, and the poses do not fit.
# Where the second camera may turn on the rig, sound recordings leave as much as the third.
_LEFT, _UNFIT, _LEFT_SQUINT = 0.02, 0.05, 0.03
_LEFT_IN_ONE = 2.5  # times as much in a single window
_NOTHING_LEFT = 0.01  # on average: then no second fault is looked for
_FINE = 8  # alternatives that are tried on fine volumes, those that gain most
_LIKELY, _CANDIDATES = 0.5, 4  # what may be the cause: its share of the best gain, and how many
_CLEAR = 2  # margins: what a first cure leaves over looks like a small second fault
_RIVAL = 0.75  # of the gain: another cause that explains as well
# Of two causes: how many second ones are looked at closely, and what may be left after both, less
# than after one: two cures have more freedom to fit by chance.
_SECONDS, _LEFT_OF_TWO = 3, 0.01


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
    """

    trials: tuple[Trial, ...]
    best: Trial
    unexplained: str
    rivals: tuple[Trial, ...] = ()
    second: Trial | None = None


def check_by_mapping(
    recording: Recording, config: MapperConfig, progress: Progress = silent
) -> list[Finding]:
    """Tries every alternative with each pair of camera 0 and another, or with a single camera.

    Args:
        recording: with poses.
        config: depth range and threads.
        progress: called with the stage, `alternatives` or `after the best cure`, how many are
            tried, and their number.

    Returns:
        A finding per pair; only that of the first if poses or lens are wrong, since nothing else is
        sharp under wrong poses.

    Raises:
        InputError: poses and events cover no window together, or an impossible depth range.
    """
    windows, names = TrialWindows.of(recording, config), recording.rig.camera_names
    groups: list[tuple[int, ...]] = [(0, k) for k in range(1, len(names))] or [(0,)]
    findings: list[Finding] = []
    for at, cameras in enumerate(groups):
        alternatives = _alternatives(recording, first=at == 0, paired=len(cameras) > 1)
        shown = _shown(alternatives, progress, "alternatives", at, len(groups))
        diagnosis = _diagnosis(CameraTrials(windows, cameras), alternatives, shown, progress)
        names_text = " and ".join(names[k] for k in cameras)
        findings.append(_finding(f"mapping-{cameras[-1]}", names_text, diagnosis))
        if findings[-1].verdict == "wrong" and not diagnosis.best.alternative.of_pair:
            break
    return findings


def _diagnosis(
    trials: CameraTrials, alternatives: Sequence[Alternative | Amount],
    shown: Iterator[Alternative | Amount], progress: Progress,
) -> Diagnosis:  # fmt: skip
    tried = tuple(trials.trials(shown, most=_FINE))
    best = trials.best(tried)
    if best.verdict != "wrong":
        return Diagnosis(tried, best, _unfit(trials))
    likely = _likely(trials, tried, best)
    wrong = (trial for trial in likely if trial.verdict == "wrong")
    best = next((trial for trial in wrong if _explains(trials, trial)), best)
    rivals = tuple(t for t in likely if _is_rival(t, best) and _explains(trials, t))
    cured = trials.after(best)
    second = _second(cured, best, alternatives, progress) if best.is_cause else None
    if second and second.gain > best.gain:
        rivals += _in_other_order(trials, best, second, alternatives)
    cured = cured.after(second) if second else cured
    unexplained = _unexplained(cured, best, second, rivals, _conventions(alternatives))
    return Diagnosis(tried, best, unexplained, rivals, second)


def _unfit(trials: CameraTrials) -> str:
    """Whether poses and events are far apart although no alternative helps, in words."""
    free_gain = float(trials.free_turn_gains.mean())
    # Moving objects look the same.
    words = "sharper by {} if the camera may turn freely; or most events are of moving objects"
    return words.format(_percent(free_gain)) if free_gain > _UNFIT else ""


def _unexplained(
    cured: CameraTrials, best: Trial, second: Trial | None, rivals: Sequence[Trial],
    conventions: Sequence[Alternative],
) -> str:  # fmt: skip
    """What speaks against the causes that `cured` has cured, in words; empty where nothing does."""
    causes = [best, *([second] if second else [])]
    sharper = (
        f"sharper by {_percent(sum(t.gain for t in causes))} with "
        f"{' and '.join(map(_amount_words, causes))}"
    )
    if not all(trial.is_inside for trial in causes):
        return f"{sharper}, the largest amount tried"
    if not all(trial.is_even for trial in causes):
        return f"{sharper}, but in one window far more than in the others"
    if not all(trial.is_cause for trial in causes):
        return f"{sharper}, but by a different amount in each window"
    if _is_ambiguous(causes, rivals):
        return f"{sharper}, but about as much with {' or '.join(map(_amount_words, rivals))}"
    left = cured.free_turn_gains
    if _is_much(left, cured.margin(_LEFT_OF_TWO if second else _LEFT)):
        return f"{sharper}, and then by {_percents(left)} more if the camera may turn freely"
    left = cured.free_squint_gains
    if _is_much(left, _LEFT_SQUINT):
        return f"{sharper}, and then by {_percents(left)} more if the second camera may turn"
    alone = cured.gain_alone(conventions)
    if alone > cured.margin(MARGIN):
        return f"{sharper}, but camera 0 alone by {_percent(alone)} more with other poses"
    return ""


def _is_much(left: Gains, most: float) -> bool:
    """Whether windows could still gain more than so much on average, or one far more."""
    return bool(left.mean() > most or left.max() > _LEFT_IN_ONE * most)


def _is_ambiguous(causes: Sequence[Trial], rivals: Sequence[Trial]) -> bool:
    """Whether rivals leave open more than a few windows tell.

    Conventions may be the same for a motion, and are named together. Amounts never are: they only
    trade off. And the place of a cause must be clear: between the cameras, or in poses and lens.
    """
    either = [trial.alternative for trial in (causes[0], *rivals)]
    places = {alternative.of_pair for alternative in either}
    amounts = any(isinstance(alternative, Amount) for alternative in either)
    return bool(rivals) and (len(causes) > 1 or len(places) > 1 or amounts)


def _conventions(alternatives: Sequence[Alternative | Amount]) -> list[Alternative]:
    """Mistakes about the poses, without amounts."""
    return [a for a in alternatives if isinstance(a, Alternative) and not a.of_pair]


def _likely(trials: CameraTrials, tried: Sequence[Trial], best: Trial) -> list[Trial]:
    """The sharpest alternatives, those that camera 0 alone contradicts left out."""
    in_order = sorted(tried, key=lambda trial: trial.gain, reverse=True)
    sharp = [t for t in in_order if t.is_sharper and t.gain >= _LIKELY * best.gain]
    return [trial for trial in sharp[:_CANDIDATES] if trials.agrees(trial)]


def _explains(trials: CameraTrials, trial: Trial) -> bool:
    return trial.is_cause and not _is_much(
        trials.after(trial).free_turn_gains, trials.margin(_LEFT)
    )


def _is_rival(trial: Trial, best: Trial) -> bool:
    """Whether a cause of another kind explains about as much."""
    is_other = _kind(trial.alternative) != _kind(best.alternative)
    return is_other and trial.gain >= _RIVAL * best.gain


def _second(
    cured: CameraTrials, best: Trial, alternatives: Sequence[Alternative | Amount],
    progress: Progress,
) -> Trial | None:  # fmt: skip
    """What is still wrong after the best cure; None where nothing is: then it explains all."""
    if max(cured.free_turn_gains.mean(), cured.free_squint_gains.mean()) < _NOTHING_LEFT:
        return None
    others = [other for other in alternatives if _may_be_second(other, best.alternative)]
    shown = _shown(others, progress, "after the best cure")
    second = cured.best(cured.trials(shown, most=_SECONDS))
    return second if second.verdict == "wrong" and second.gain > _CLEAR * second.margin else None


def _in_other_order(
    trials: CameraTrials, first: Trial, second: Trial, alternatives: Sequence[Alternative | Amount]
) -> tuple[Trial, ...]:
    """Another first cause, if one is sharper once the larger second one is cured."""
    cured = trials.after(second)
    others = [other for other in alternatives if _may_be_second(other, second.alternative)]
    again = cured.best(cured.trials(others, most=_SECONDS))
    return (again,) if _kind(again.alternative) != _kind(first.alternative) else ()


def _may_be_second(other: Alternative | Amount, first: Alternative | Amount) -> bool:
    """Whether it can be wrong besides: poses have one convention, an amount is corrected once.

    A convention and a free turn of the camera on the body together would fit too much by chance.
    """
    conventions = [isinstance(a, Alternative) and not a.of_pair for a in (other, first)]
    turned = [_kind(a) == "hand-eye rotation" for a in (other, first)]
    if all(c or t for c, t in zip(conventions, turned, strict=True)):
        return False
    return _kind(other) != _kind(first)


def _shown(
    alternatives: Sequence[Alternative | Amount], progress: Progress, stage: str,
    group: int = 0, groups: int = 1,
) -> Iterator[Alternative | Amount]:  # fmt: skip
    """Each alternative, and before it a step of the progress."""
    count = len(alternatives)
    for done, alternative in enumerate(alternatives, group * count):
        progress(stage, done, groups * count)
        yield alternative


def _kind(alternative: Alternative | Amount) -> str:
    """What an alternative corrects; of a rotation whatever its axis."""
    return alternative.name.partition(" about ")[0]


def _alternatives(recording: Recording, *, first: bool, paired: bool) -> list[Alternative | Amount]:
    """All that is tried with some cameras; what concerns camera 0 only with the first of them."""
    alternatives: list[Alternative | Amount] = []
    if first:
        alternatives += [*of_poses(recording), *amounts_of_one(paired=paired)]
    if paired:
        alternatives += [*of_pair(), *amounts_of_pair()]
    return alternatives


_MEANING = "depth comes from where rays meet, and they meet less sharply than they could"


def _finding(name: str, cameras: str, diagnosis: Diagnosis) -> Finding:
    best, gain = diagnosis.best, float(np.expm1(diagnosis.best.gain))
    if best.verdict == "good" and not diagnosis.unexplained:
        words = f"{cameras}: none of {len(diagnosis.trials)} alternatives makes the map sharper"
        return Finding(name, "good", gain, "", words, series=_series(diagnosis.trials))
    if best.verdict == "doubtful" or not diagnosis.unexplained:
        return _named_finding(name, cameras, diagnosis)
    who = "the cameras do not agree with each other" if best.alternative.of_pair else (
        "poses do not agree with the events"
    )  # fmt: skip
    verdict: Verdict = "wrong" if best.verdict == "wrong" else "doubtful"
    return Finding(
        name, verdict, gain, "",
        f"{cameras}: {who}, and no single cause was found: {diagnosis.unexplained}", _MEANING,
        "check by hand how the poses are stored (handedness, degrees or radians, order of "
        "Euler angles, direction) and that clocks and calibration belong to this recording",
        "no single cause found", _series(diagnosis.trials),
    )  # fmt: skip


def _named_finding(name: str, cameras: str, diagnosis: Diagnosis) -> Finding:
    best, second, gain = diagnosis.best, diagnosis.second, float(np.expm1(diagnosis.best.gain))
    either = [best, *diagnosis.rivals]
    words = " or ".join(map(_amount_words, either))
    cure = "; or ".join(map(_cure, either))
    suspect = " or ".join(trial.alternative.name for trial in either)
    if second is not None:
        words += f", and {np.expm1(second.gain):.1%} more with {_amount_words(second)}"
        cure = f"{cure}; and {_cure(second)}; then check again"
        suspect = f"{suspect} and {second.alternative.name}"
    words = (
        f"{cameras}: correcting this makes the map {gain:.1%} sharper: {words}; "
        f"windows {', '.join(f'{np.expm1(g):+.1%}' for g in best.gains)}"
    )
    series = _series(diagnosis.trials) if best.amount is None else _curve(best)
    return Finding(name, best.verdict, gain, "", words, _MEANING, cure, suspect, series)


def _percent(gain: float) -> str:
    """A gain in log sharpness as a share."""
    return f"{np.expm1(gain):.1%}"


def _percents(gains: Gains) -> str:
    return ", ".join(map(_percent, gains))


def _unit(trial: Trial) -> str:
    return (trial.alternative.unit if isinstance(trial.alternative, Amount) else "") or "times"


def _amount_words(trial: Trial) -> str:
    by = "" if trial.amount is None else f" by {trial.amount:.3g} {_unit(trial)}"
    return f"{trial.alternative.name}{by}"


def _cure(trial: Trial) -> str:
    if trial.amount is None:
        return trial.alternative.cure
    return f"{trial.alternative.cure.format(amount=trial.amount)}; `calibrate` refines it"


def _curve(best: Trial) -> Series:
    x, y = best.curve
    x_label = f"{best.alternative.name}, {_unit(best)}"
    return Series(100 * np.expm1(y), x, x_label, "sharper by, %", (0.0,))


def _series(trials: Sequence[Trial]) -> Series:
    """The best alternatives, by name."""
    best = sorted(trials, key=lambda trial: trial.gain, reverse=True)[:_BARS]
    gains = np.array([100 * np.expm1(trial.gain) for trial in best])
    names = tuple(trial.alternative.name for trial in best)
    return Series(gains, x_label="sharper by, %", limits=(0.0,), names=names)
