"""The imperfect sensor's parts, pixel by pixel and request by request, in plain Python."""

from __future__ import annotations

import math


def leaked(t_s, phase, slot_durations_s):
    """Thresholds leaked at `t_s` by a pixel that starts `phase` of the way through slot 0."""
    left_s, total, slot = t_s, phase, 0
    while True:
        rest_s = (slot + 1 - total) * slot_durations_s(slot)
        if left_s < rest_s:
            return total + left_s / slot_durations_s(slot)
        left_s, slot = left_s - rest_s, slot + 1
        total = float(slot)


def comparator(light, leak, times_us, c_pos, c_neg):
    """Rows (t_us, p, leaky) of one pixel, from its photoreceptor's output and leak per frame."""
    rows, up, down, lit_last, leak_last = [], 0, 0, light[0], leak[0]
    for n in range(1, len(light)):
        before, now = light[n - 1] + c_pos * leak[n - 1], light[n] + c_pos * leak[n]
        while True:
            reference = light[0] + up * c_pos - down * c_neg
            if now - reference >= c_pos:
                up, p = up + 1, 1
            elif reference - now >= c_neg:
                down, p = down + 1, 0
            else:
                break
            share = (light[0] + up * c_pos - down * c_neg - before) / (now - before)
            step_us = times_us[n] - times_us[n - 1]
            t_us = times_us[n - 1] + min(max(round(share * step_us), 1), step_us)
            leak_here = leak[n - 1] + share * (leak[n] - leak[n - 1])
            lit_here = light[n - 1] + share * (light[n] - light[n - 1])
            drift = c_pos * (leak_here - leak_last)
            rows.append((t_us, p, int(p == 1 and drift > lit_here - lit_last)))
            lit_last, leak_last = lit_here, leak_here
    return rows


def low_pass(log, light, times_s, cutoff_hz, dark_level, order, parts=2000):
    """Output at the frames, by many small explicit steps through each interval."""
    states, out = [log[0]] * order, [log[0]]
    for n in range(1, len(log)):
        mean = (light[n - 1] + light[n]) / 2
        tau_s = (1 + dark_level) / (2 * math.pi * cutoff_hz * (mean + dark_level))
        dt_s = (times_s[n] - times_s[n - 1]) / parts
        for k in range(parts):
            value = log[n - 1] + (log[n] - log[n - 1]) * (k + 0.5) / parts
            for i in range(order):
                states[i], value = states[i] + dt_s / tau_s * (value - states[i]), states[i]
        out.append(states[-1])
    return out


def arbiter(requests, row_us, event_us, capacity):
    """Serves (t_us, row) in order of time; returns [(index, stamp)] and the dropped indices."""
    served, dropped, waiting = [], [], []
    free_us, arrivals = -math.inf, list(enumerate(requests))
    while arrivals or waiting:
        now = free_us if waiting else max(free_us, arrivals[0][1][0])
        while arrivals and arrivals[0][1][0] <= now:
            index, (_, row) = arrivals.pop(0)
            if len(waiting) >= capacity:
                dropped.append(index)
            else:
                waiting.append((index, row))
        chosen = waiting[0][1]
        mine = [index for index, row in waiting if row == chosen]
        waiting = [(index, row) for index, row in waiting if row != chosen]
        served += [(index, math.floor(now)) for index in mine]
        free_us = now + row_us + len(mine) * event_us
    return served, dropped
