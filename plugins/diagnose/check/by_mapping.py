"""Checks by mapping: do rays meet more sharply under an alternative? Then something is wrong.

Three windows are mapped as given, and again under every alternative (`trials`). The best one is
named only if it is decisive, far beyond what any small free turn gains, and explains: no other one
does as well, its amount is an optimum within its search, and after it the cameras gain nothing by
turning otherwise (`TrialWindows.free_turn_gains`). Else no cause is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.alternatives import Alternative, Amount, alternatives_of
from eventsweep.plugins.diagnose.check.diagnosis import (
    Diagnosis,
    amount_words,
    as_finding,
    percent,
    percents,
)
from eventsweep.plugins.diagnose.check.findings import Finding
from eventsweep.plugins.diagnose.check.limits import MARGIN
from eventsweep.plugins.diagnose.check.trial_windows import Gains, TrialWindows
from eventsweep.plugins.diagnose.check.trials import CameraTrials, Trial


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
        alternatives = alternatives_of(recording, first=at == 0, paired=len(cameras) > 1)
        shown = _shown(alternatives, progress, "alternatives", at, len(groups))
        diagnosis = _diagnosis(CameraTrials(windows, cameras), alternatives, shown, progress)
        names_text = " and ".join(names[k] for k in cameras)
        findings.append(as_finding(f"mapping-{cameras[-1]}", names_text, diagnosis))
        if findings[-1].verdict == "wrong" and not diagnosis.best.alternative.of_pair:
            break
    return findings


def _diagnosis(
    trials: CameraTrials, alternatives: Sequence[Alternative],
    shown: Iterator[Alternative], progress: Progress,
) -> Diagnosis:  # fmt: skip
    tried = tuple(trials.trials(shown, most=limits.FINE_TRIALS))
    best = trials.best(tried)
    if best.verdict == "good":
        return Diagnosis(tried, best, _unfit(trials))
    if best.verdict == "doubtful":
        return Diagnosis(tried, best, f"{_sharper([best])}, too little to be sure")
    in_order = sorted(tried, key=lambda trial: trial.gain, reverse=True)
    sharp = [t for t in in_order if t.is_sharper and t.gain >= limits.LIKELY * best.gain]
    likely = [trial for trial in sharp[: limits.MOST_LIKELY] if trials.agrees(trial)]
    wrong = (trial for trial in likely if trial.verdict == "wrong")
    best = next((trial for trial in wrong if _explains(trials, trial)), best)
    enough = limits.RIVAL * best.gain
    rivals = tuple(
        trial for trial in likely
        if trial.alternative.kind != best.alternative.kind and trial.gain >= enough
        and _explains(trials, trial)
    )  # fmt: skip
    cured, causes = trials.after(best), [best]
    besides = _besides(cured, best, alternatives, progress) if best.is_cause else None
    second = besides if besides and _is_clear(besides, best) else None
    if second:
        rivals += tuple(_other_firsts(trials, (best, second), likely, alternatives))
        if second.gain > best.gain:
            rivals += _in_other_order(trials, best, second, alternatives)
        cured, causes = cured.after(second), [best, second]
    if undecided := _undecided(trials, causes):
        return Diagnosis(tried, best, undecided)
    unexplained = _unexplained(cured, causes, rivals, alternatives)
    if not unexplained:
        unexplained = _several(trials, causes, None if second else besides, alternatives)
    return Diagnosis(tried, best, unexplained, rivals, second, decisive=True)


def _unfit(trials: CameraTrials) -> str:
    """Whether poses and events do not fit although no alternative helps, in words."""
    if _is_much(trials.free_turn_gains, trials.margin(limits.LEFT)):
        # Moving objects look the same.
        return (
            f"sharper by {percents(trials.free_turn_gains)} if the camera may turn freely; or "
            "most events are of moving objects"
        )
    if _is_much(trials.free_squint_gains, limits.LEFT_SQUINT):
        gains = percents(trials.free_squint_gains)
        return f"sharper by {gains} if the second camera may turn on the rig"
    if trials.agreement < -limits.APART:
        return f"less sharp by {percent(-trials.agreement)} than where the cameras agree"
    return ""


def _free_gain(trials: CameraTrials, cause: Trial) -> float:
    """What the recording as given gains at most on average where a camera may turn freely.

    Angles between the cameras are not measured against the same angles that are free.
    """
    free = float(trials.free_turn_gains.mean())
    if cause.alternative.kind.startswith("stereo"):
        return free
    return max(free, float(trials.free_squint_gains.mean()))


def _undecided(trials: CameraTrials, causes: Sequence[Trial]) -> str:
    """Why these causes gain too little to be named, in words; empty where they do not."""
    gains = np.sum([trial.gains for trial in causes], axis=0)
    free = _free_gain(trials, causes[0])
    if gains.mean() < limits.DECISIVE or gains.min() < limits.DECISIVE / 2:
        return f"{_sharper(causes)}, too little to be sure"
    if gains.mean() <= limits.BEYOND_FREE * free:
        return f"{_sharper(causes)}, but also by {percent(free)} where a camera may turn freely"
    return ""


def _sharper(causes: Sequence[Trial]) -> str:
    return (
        f"sharper by {percent(sum(t.gain for t in causes))} with "
        f"{' and '.join(map(amount_words, causes))}"
    )


def _unexplained(
    cured: CameraTrials, causes: Sequence[Trial], rivals: Sequence[Trial],
    alternatives: Sequence[Alternative],
) -> str:  # fmt: skip
    """What speaks against the causes that `cured` has cured, in words; empty where nothing does."""
    sharper = _sharper(causes)
    if not all(trial.is_inside for trial in causes):
        return f"{sharper}, the largest amount tried"
    if not all(trial.is_common for trial in causes):
        return f"{sharper}, but by a different amount in each window"
    if _is_ambiguous(causes, rivals):
        return f"{sharper}, but about as much with {' or '.join(map(amount_words, rivals))}"
    left = cured.free_turn_gains
    if _is_much(left, cured.margin(limits.LEFT)):
        return f"{sharper}, and then by {percents(left)} more if the camera may turn freely"
    left = cured.free_squint_gains
    if _is_much(left, limits.LEFT_SQUINT):
        return f"{sharper}, and then by {percents(left)} more if the second camera may turn"
    if cured.agreement < -limits.DISAGREE:
        lost = percent(-cured.agreement)
        return f"{sharper}, but still less by {lost} than where the cameras agree"
    of_poses = (a for a in alternatives if not isinstance(a, Amount) and not a.of_pair)
    alone = cured.gain_alone(of_poses)
    if alone > cured.margin(MARGIN):
        return f"{sharper}, but camera 0 alone by {percent(alone)} more with other poses"
    return ""


def _several(
    trials: CameraTrials, causes: Sequence[Trial], besides: Trial | None,
    alternatives: Sequence[Alternative],
) -> str:  # fmt: skip
    """Why something else may be wrong besides these causes, in words; empty where nothing may be.

    Small turns of the camera on the body are not considered: windows hardly show them.
    """
    if besides:
        more = f"{percent(besides.gain)} more with {amount_words(besides)}"
        return f"{_sharper(causes)}, and then by {more}: more than one thing is wrong"
    named = {cause.alternative.kind for cause in causes} | {"hand-eye rotation"}
    others = [a for a in alternatives if isinstance(a, Amount) and a.kind not in named]
    for cause in (cause for cause in causes if cause.amount is not None):
        rest = reduce(CameraTrials.after, (c for c in causes if c is not cause), trials)
        traded = next((other for other in others if rest.is_traded(cause, other)), None)
        if traded:
            return f"{_sharper(causes)}, but as much with another {traded.name} as well"
    return ""


def _is_much(left: Gains, most: float) -> bool:
    """Whether windows could still gain more than so much on average, or one far more."""
    return bool(left.mean() > most or left.max() > limits.LEFT_IN_ONE * most)


def _is_ambiguous(causes: Sequence[Trial], rivals: Sequence[Trial]) -> bool:
    """Whether rivals leave open more than a few windows tell.

    Conventions may be the same for a motion, and are named together. Amounts never are: they only
    trade off. And the place of a cause must be clear: between the cameras, or in poses and lens.
    """
    either = [trial.alternative for trial in (causes[0], *rivals)]
    places = {alternative.of_pair for alternative in either}
    amounts = any(isinstance(alternative, Amount) for alternative in either)
    return bool(rivals) and (len(causes) > 1 or len(places) > 1 or amounts)


def _explains(trials: CameraTrials, trial: Trial) -> bool:
    return trial.is_cause and not _is_much(
        trials.after(trial).free_turn_gains, trials.margin(limits.LEFT)
    )


def _besides(
    cured: CameraTrials, best: Trial, alternatives: Sequence[Alternative],
    progress: Progress,
) -> Trial | None:  # fmt: skip
    """What is still wrong after the best cure; None where nothing is: then it explains all.

    Conventions only where free turns gain something; amounts always: they trade off with turns.
    """
    left = max(cured.free_turn_gains.mean(), cured.free_squint_gains.mean()) >= limits.NOTHING_LEFT
    others = [
        other for other in alternatives
        if other.kind != best.alternative.kind
        and (isinstance(other, Amount) or (left and _may_be_second(other, best.alternative)))
    ]  # fmt: skip
    shown = _shown(others, progress, "after the best cure")
    second = cured.best(cured.trials(shown, most=limits.FINE_SECONDS))
    return second if second.verdict == "wrong" else None


def _is_clear(second: Trial, best: Trial) -> bool:
    """Whether a second cause may be named beside the best cure, and is clear enough."""
    may_be = _may_be_second(second.alternative, best.alternative)
    return may_be and second.gain > limits.CLEAR * second.margin


def _other_firsts(
    trials: CameraTrials, causes: tuple[Trial, Trial], likely: Sequence[Trial],
    alternatives: Sequence[Alternative],
) -> Iterator[Trial]:  # fmt: skip
    """Other first causes that explain about as much with a second one in the second one's place.

    Rows counted from below and left-handed poses are the same for cameras side by side.
    """
    best, second = causes
    enough, amount = limits.RIVAL * (best.gain + second.gain), second.alternative
    # Of a convention all that concern the poses as well, or the cameras.
    alike = [amount] if isinstance(amount, Amount) else [
        a for a in alternatives if not isinstance(a, Amount) and a.of_pair == amount.of_pair
    ]  # fmt: skip
    for first in likely:
        if first.alternative.kind == best.alternative.kind or not first.is_cause:
            continue
        tried = [other for other in alike if _may_be_second(other, first.alternative)]
        after = trials.after(first).trials(tried, most=limits.FINE_SECONDS) if tried else []
        if first.gain + max((trial.gain for trial in after), default=0.0) >= enough:
            yield first


def _in_other_order(
    trials: CameraTrials, first: Trial, second: Trial, alternatives: Sequence[Alternative]
) -> tuple[Trial, ...]:
    """Another first cause, if one is sharper once the larger second one is cured."""
    cured = trials.after(second)
    others = [other for other in alternatives if _may_be_second(other, second.alternative)]
    again = cured.best(cured.trials(others, most=limits.FINE_SECONDS))
    return (again,) if again.alternative.kind != first.alternative.kind else ()


def _may_be_second(other: Alternative, first: Alternative) -> bool:
    """Whether it can be wrong besides: poses have one convention, an amount is corrected once.

    A convention and a free turn of the camera on the body together, or two amounts, would fit too
    much by chance.
    """
    if isinstance(other, Amount) and isinstance(first, Amount):
        return False
    conventions = [not isinstance(a, Amount) and not a.of_pair for a in (other, first)]
    turned = [a.kind == "hand-eye rotation" for a in (other, first)]
    if all(c or t for c, t in zip(conventions, turned, strict=True)):
        return False
    return other.kind != first.kind


def _shown(
    alternatives: Sequence[Alternative], progress: Progress, stage: str,
    group: int = 0, groups: int = 1,
) -> Iterator[Alternative]:  # fmt: skip
    """Each alternative, and before it a step of the progress."""
    count = len(alternatives)
    for done, alternative in enumerate(alternatives, group * count):
        progress(stage, done, groups * count)
        yield alternative
