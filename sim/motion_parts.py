"""What a head's motion is made of: smooth noise, gaze shifts, a way with rounded corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError

Array = NDArray[np.float64]
_TONES = 12


def smooth_noise(
    t_s: Array, rng: np.random.Generator, band_hz: tuple[float, float], channels: int
) -> Array:
    """Noise (N, channels) of rms 1 and any number of derivatives: sines of random frequency.

    Frequencies are log-uniform in the band and amplitudes fall as 1/f, so that every octave
    moves about equally fast.
    """
    low, high = np.log(band_hz)
    noise = np.zeros((len(t_s), channels))
    for channel in range(channels):
        frequency = np.exp(rng.uniform(low, high, _TONES))
        phase = rng.uniform(0, 2 * np.pi, _TONES)
        amplitude = np.sqrt(2) / frequency / np.linalg.norm(1 / frequency)
        for a, f, p in zip(amplitude, frequency, phase, strict=True):
            noise[:, channel] += a * np.sin(2 * np.pi * f * t_s + p)
    return noise


def minimum_jerk(share: Array) -> Array:
    """Profile from 0 to 1 (Flash and Hogan, J. Neurosci. 1985): 10 s^3 - 15 s^4 + 6 s^5."""
    s = np.clip(share, 0, 1)
    profile: Array = s**3 * (10 + s * (6 * s - 15))
    return profile


def gaze_shifts(
    t_s: Array,
    rng: np.random.Generator,
    shifts_hz: float,
    spread_rad: NDArray[np.float64],
    shift_s: float,
    shift_s_rad: float,
) -> Array:
    """Pitch and yaw (N, 2) of a head that turns to one fixation after another.

    Fixations are Gaussian about straight ahead, cut at two and a half standard deviations, and
    last at least a third of their mean; each turn takes `shift_s + shift_s_rad * angle` and has
    a minimum-jerk profile.
    """
    angles = np.zeros((len(t_s), 2))
    if shifts_hz == 0:
        return angles
    now_s, gaze = 0.0, np.zeros(2)
    while True:
        now_s += (1 / 3 + rng.exponential(2 / 3)) / shifts_hz
        target = spread_rad * np.clip(rng.standard_normal(2), -2.5, 2.5)
        if now_s >= t_s[-1]:
            return angles
        length_s = shift_s + shift_s_rad * float(np.linalg.norm(target - gaze))
        first = int(np.searchsorted(t_s, now_s))
        share = minimum_jerk((t_s[first:] - now_s) / length_s)
        angles[first:] += share[:, None] * (target - gaze)
        now_s, gaze = now_s + length_s, target


def way_along(
    t_s: Array, rng: np.random.Generator, speed_m_s: float, path_m: Array, corner_s: float
) -> tuple[Array, Array]:
    """Positions (N, 3) in m and headings (N,) in rad of a steady way along a polyline.

    Both are averaged over `corner_s` with a Hann window, which rounds corners with continuous
    acceleration and leaves straight parts alone; the way goes straight on at both ends.

    Raises:
        InputError: no two distinct corners, or a turn back of more than 170 degrees.
    """
    legs, headings = _legs(path_m)
    step_s = t_s[1] - t_s[0]
    half = max(1, round(0.5 * corner_s / step_s))
    padded_s = step_s * np.arange(-half, len(t_s) + half)
    speed = 1 + 0.03 * smooth_noise(padded_s, rng, (0.1, 0.4), 1)[:, 0]
    along_m = speed_m_s * step_s * (np.cumsum(speed) - np.cumsum(speed)[half])
    corners_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(legs, axis=1))])
    leg = np.clip(np.searchsorted(corners_m, along_m, side="right") - 1, 0, len(legs) - 1)
    unit = np.column_stack([np.cos(headings), np.sin(headings)])
    flat = np.vstack([[0.0, 0.0], np.cumsum(legs, axis=0)])[leg]
    flat = flat + (along_m - corners_m[leg])[:, None] * unit[leg]
    window = np.hanning(2 * half + 3)[1:-1]
    window /= window.sum()
    x, y, heading = (np.convolve(column, window, "valid") for column in (*flat.T, headings[leg]))
    return np.column_stack([x - x[0], y - y[0], np.zeros_like(x)]), heading


def _legs(path_m: Array) -> tuple[Array, Array]:
    if path_m.ndim != 2 or path_m.shape[1] != 2 or len(path_m) < 2:
        raise InputError(f"a way with corners of shape {path_m.shape}: need (N, 2), N >= 2")
    legs = np.diff(path_m, axis=0)
    if (np.linalg.norm(legs, axis=1) < 1e-6).any():
        raise InputError("a way with a corner twice in a row: remove the repeated one")
    headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    turns = np.abs(np.diff(headings))
    if (turns > np.radians(170)).any():
        k = int(np.argmax(turns)) + 1
        raise InputError(
            f"the way turns by {np.degrees(turns[k - 1]):.0f} degrees at corner {k}: "
            "a person walks a bend, put more corners there (170 degrees at most)"
        )
    return legs, headings
