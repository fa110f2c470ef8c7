"""The event model pixel by pixel and event by event, in plain Python."""

from __future__ import annotations

import numpy as np


def simulate(frames, times_us, config):
    """Returns rows (t_us, y, x, p) of all events of `frames` (N, H, W), in the order emitted."""
    c_pos, c_neg = config.contrast_threshold_pos, config.contrast_threshold_neg
    logs = np.log(np.asarray(frames, np.float32) + np.float32(config.log_eps)).astype(float)
    _, height, width = logs.shape
    rows = []
    for n in range(1, len(logs)):
        interval = []
        for y in range(height):
            for x in range(width):
                history = logs[: n + 1, y, x].tolist()
                interval += pixel_events(history, times_us[: n + 1], c_pos, c_neg, config, (y, x))
        interval.sort(key=lambda event: event[0])
        rows += interval
    return rows


def pixel_events(history, times_us, c_pos, c_neg, config, where):
    """Events of one pixel in the last interval of its history, replayed from the first frame."""
    first, up, down, last_us, events = history[0], 0, 0, None, []
    for n in range(1, len(history)):
        events = []
        while True:
            reference = first + up * c_pos - down * c_neg
            if history[n] - reference >= c_pos:
                up, p = up + 1, 1
            elif reference - history[n] >= c_neg:
                down, p = down + 1, 0
            else:
                break
            level = first + up * c_pos - down * c_neg
            share = (level - history[n - 1]) / (history[n] - history[n - 1])
            step_us = times_us[n] - times_us[n - 1]
            t_us = times_us[n - 1] + min(max(round(share * step_us), 1), step_us)
            if last_us is None or t_us - last_us >= config.refractory_period_us:
                events.append((t_us, *where, p))
                last_us = t_us
    return events
