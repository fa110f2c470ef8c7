"""Pixels from render samples, and the imperfect sensor's parts, request by request."""

import math
from fractions import Fraction

import numpy as np

from eventsweep.emvs.geometry import se3
from naive_esim import TIE, moment


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
    """Rows (t_us, p, leaky) of one pixel, from its photoreceptor's output and leak per frame.

    In exact arithmetic but for the leak, which comes rounded.
    """
    light, leak = ([Fraction(value) for value in values] for values in (light, leak))
    c_pos, c_neg = Fraction(c_pos), Fraction(c_neg)
    seen = [bright + c_pos * dark for bright, dark in zip(light, leak, strict=True)]
    rows, reference, lit_last, leak_last = [], light[0], light[0], leak[0]
    for n in range(1, len(seen)):
        before, now = seen[n - 1], seen[n]
        rises = max(0, math.floor((now - reference + TIE) / c_pos))
        falls = max(0, math.floor((reference - now + TIE) / c_neg))
        for _ in range(rises + falls):
            reference += c_pos if rises else -c_neg
            share = (reference - before) / (now - before)
            leak_here = leak[n - 1] + share * (leak[n] - leak[n - 1])
            lit_here = light[n - 1] + share * (light[n] - light[n - 1])
            is_leak = rises > 0 and c_pos * (leak_here - leak_last) > lit_here - lit_last
            t_us = moment(share, times_us[n - 1], times_us[n])
            rows.append((t_us, int(rises > 0), int(is_leak)))
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


def average(rgb, window_depth, supersample):
    """Mean luma (H, W), 0 to 1, and largest window depth, top row first."""
    height, width = (n // supersample for n in window_depth.shape)
    blocks = (height, supersample, width, supersample)
    luma = rgb[::-1].astype(float) @ [0.2126, 0.7152, 0.0722] / 255
    return luma.reshape(blocks).mean((1, 3)), window_depth[::-1].reshape(blocks).max((1, 3))


def displacements_px(rig, depths_m, T_world_body_a, T_world_body_b):
    """Per camera, (H, W) distance between each pixel and where its surface point goes."""
    moved = []
    for camera, depth_m, T_body_cam in zip(rig.cameras, depths_m, rig.T_body_cam, strict=True):
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        far_m = np.where(np.isfinite(depth_m), depth_m, 1e9).astype(float)
        bearing = camera.unproject(np.stack([u, v], -1))
        points_a = np.dstack([bearing, np.ones_like(far_m)]) * far_m[..., None]
        points_world = se3.transform(T_world_body_a @ T_body_cam, points_a)
        points_b = se3.transform(se3.inverse(T_world_body_b @ T_body_cam), points_world)
        moved.append(np.linalg.norm(camera.project(points_b) - np.stack([u, v], -1), axis=-1))
    return moved
