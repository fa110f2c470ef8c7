"""The event model pixel by pixel and event by event, in exact arithmetic.

Nothing here is rounded but the times of events: the inputs are binary fractions, and fractions add
up exactly. So the reference is one number that moves, and no count of crossings.
"""

from fractions import Fraction
from itertools import pairwise
from math import floor

import numpy as np

TIE = Fraction(1, 10**6)
"""A level counts as reached from this close."""


def log_of(frames, log_eps):
    """Logarithms as float32, each the nearest one."""
    light = np.asarray(frames, np.float32) + np.float32(log_eps)
    return np.log(light.astype(float)).astype(np.float32)


def simulate(frames, times_us, config):
    """Returns rows (t_us, y, x, p) of all events of `frames` (N, H, W), in the order emitted."""
    logs = log_of(frames, config.log_eps)
    thresholds = config.contrast_threshold_pos, config.contrast_threshold_neg
    intervals = [[] for _ in times_us]
    for y, x in np.ndindex(logs.shape[1:]):
        history = [Fraction(float(log)) for log in logs[:, y, x]]
        found = crossings(history, times_us, *map(Fraction, thresholds))
        for n, t_us, p in awake(found, config.refractory_period_us):
            intervals[n].append((t_us, y, x, p))
    return [row for rows in intervals for row in sorted(rows, key=lambda row: row[0])]


def crossings(history, times_us, c_pos, c_neg):
    """Rows (n, t_us, p): the crossings of one pixel on the way to frame n."""
    rows, reference = [], history[0]
    for n, (before, now) in enumerate(pairwise(history), start=1):
        rises = max(0, floor((now - reference + TIE) / c_pos))
        falls = max(0, floor((reference - now + TIE) / c_neg))
        for _ in range(rises + falls):
            reference += c_pos if rises else -c_neg
            passed = (reference - before) / (now - before)
            rows.append((n, moment(passed, times_us[n - 1], times_us[n]), int(rises > 0)))
    return rows


def moment(passed, before_us, now_us):
    """The whole microsecond at which that share of an interval has passed."""
    return min(max(before_us + round(passed * (now_us - before_us)), before_us + 1), now_us)


def awake(found, refractory_us):
    """The crossings that are emitted: none within the time after an emitted one."""
    silent_until_us = None
    for row in found:
        if silent_until_us is None or row[1] >= silent_until_us:
            silent_until_us = row[1] + refractory_us
            yield row


def published(logs, times_us, c, refractory_us):
    """Events (t_us, y, x, p) by the law as its authors run it: a float32 reference that moves.

    A level counts where it lies in the stretch from the value before, without it, to the value now.
    """
    found = set()
    for y, x in np.ndindex(logs.shape[1:]):
        reference, last_us = logs[0, y, x], -np.inf
        for k in range(1, len(logs)):
            before, now = logs[k - 1, y, x], logs[k, y, x]
            step = np.float32(c) if now > before else np.float32(-c)
            level = reference + step
            while before < level <= now or now <= level < before:
                share = float(level - before) / float(now - before)
                t_us = times_us[k - 1] + share * (times_us[k] - times_us[k - 1])
                if t_us - last_us >= refractory_us:
                    found.add((round(t_us), y, x, int(step > 0)))
                    last_us = t_us
                reference, level = level, level + step
    return found
