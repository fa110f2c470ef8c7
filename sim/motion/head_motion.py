"""How human heads move: one generator per way of moving, any length, fixed by its seed.

`walk(duration_s, seed, **parameters)` and its sisters return a smooth motion from a neutral head
at the origin of a world whose z is up, looking along +x; `placed` puts it into a scene. The
parameters are the fields of `HeadStyle`; `head_styles` gives the sources of their values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.motion.curves import CurveMotion, curve, look_at, moved
from eventsweep.sim.motion.head_styles import KNOT_HZ, STYLES, HeadStyle

Array = NDArray[np.float64]
# Knots beyond the end of a motion.
_MARGIN = 6
# Sines per channel of noise.
_TONES = 12


def generate(name: str, duration_s: float, seed: int, **parameters: Any) -> CurveMotion:
    """Returns a head's motion of the style `name`.

    Args:
        name: a key of `STYLES`.
        duration_s: length, s; a longer motion of the same seed continues a shorter one.
        seed: fixes phases, fixations and frequencies.
        parameters: fields of `HeadStyle` that replace the style's own.

    Raises:
        InputError: an unknown style or parameter, or a value that no head can have.
    """
    style = _style(name, parameters)
    if not (np.isfinite(duration_s) and duration_s > 0):
        raise InputError(f"{name} for {duration_s} s: the duration must be positive")
    knots = np.arange(int(np.ceil(duration_s * KNOT_HZ)) + _MARGIN) / KNOT_HZ
    draws = np.random.default_rng(seed).spawn(4)
    offset_m, angles_rad = _wandering(style, knots, draws[0])
    bob_m, bob_rad = _gait(style, knots, draws[1])
    angles_rad[:, :2] += gaze_shifts(
        knots, draws[2], style.gaze_hz, np.radians(style.gaze_deg),
        style.shift_s, np.degrees(style.shift_s_deg),
    )  # fmt: skip
    way_m, heading = way_along(
        knots, draws[3], style.speed_m_s, np.asarray(style.path_m, float), style.corner_s
    )
    quats = _quats(heading, angles_rad + bob_rad)
    whole = curve(knots, way_m + _turned(heading, offset_m + bob_m), quats)
    return CurveMotion(whole.spline, float(duration_s))


seated: Callable[..., CurveMotion] = partial(generate, "seated")
translate_1d: Callable[..., CurveMotion] = partial(generate, "translate_1d")
translate_3d: Callable[..., CurveMotion] = partial(generate, "translate_3d")
six_dof: Callable[..., CurveMotion] = partial(generate, "six_dof")
shake: Callable[..., CurveMotion] = partial(generate, "shake")
walk: Callable[..., CurveMotion] = partial(generate, "walk")
run: Callable[..., CurveMotion] = partial(generate, "run")
skate: Callable[..., CurveMotion] = partial(generate, "skate")
bike: Callable[..., CurveMotion] = partial(generate, "bike")


def placed(motion: CurveMotion, T_scene_start: Array) -> CurveMotion:
    """Puts a generated motion into a scene: its neutral head at time 0 comes to `T_scene_start`.

    The way stays level and the bob vertical whatever the pose's tilt is: a pose that looks down
    gives a head that looks down while it moves, see `sim.motion.curves.look_at`.

    Raises:
        InputError: the pose looks straight up or down, so that "forward" has no meaning.
    """
    eye, forward = T_scene_start[:3, 3], T_scene_start[:3, 2]
    level = np.array([forward[0], forward[1], 0.0])
    T_scene_level = look_at(eye, eye + level)
    T_rest = look_at((0, 0, 0), (1, 0, 0))
    tilt = np.eye(4)
    tilt[:3, :3] = T_scene_level[:3, :3].T @ T_scene_start[:3, :3]
    T_scene_world = T_scene_level @ np.linalg.inv(T_rest)
    return moved(motion, T_scene_world, tilt)


def styled(style: str, T_scene_start: Array, duration_s: float, seed: int) -> CurveMotion:
    """A motion of a style of `generate`, `placed` at a pose."""
    return placed(generate(style, duration_s, seed), T_scene_start)


def along(points_m: ArrayLike) -> tuple[Array, tuple[tuple[float, float], ...]]:
    """Start pose and `path_m` of a head that follows (N, 3) points of a scene, from the first.

    Use as `start, path = along(points)`, `placed(walk(10, 0, path_m=path), start)`. The way is
    level, at the first point's height.
    """
    points = np.asarray(points_m, float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise InputError(f"a path through points of shape {points.shape}: need (N, 3), N >= 2")
    first = points[1] - points[0]
    start = look_at(points[0], points[0] + (first[0], first[1], 0.0))
    forward, left = start[:3, 2], -start[:3, 0]
    path = (points - points[0]) @ np.column_stack([forward, left])
    return start, tuple((float(x), float(y)) for x, y in path)


def _style(name: str, parameters: dict[str, Any]) -> HeadStyle:
    if name not in STYLES:
        raise InputError(f"no head motion named {name!r}: choose from {', '.join(STYLES)}")
    known = [field.name for field in fields(HeadStyle) if field.name != "summary"]
    unknown = sorted(set(parameters) - set(known))
    if unknown:
        raise InputError(f"{name} has no parameter {unknown[0]!r}: it has {', '.join(known)}")
    style = replace(STYLES[name], **parameters)
    for key in known:
        value = np.asarray(getattr(style, key), float)
        if not np.isfinite(value).all() or (key != "path_m" and (value < 0).any()):
            raise InputError(f"{name} with {key} = {value.tolist()}: must be finite, not negative")
    for key in ("drift_hz", "vibration_hz"):
        low, high = getattr(style, key)
        if not 0 < low <= high <= 0.2 * KNOT_HZ:
            raise InputError(
                f"{name} with {key} = {(low, high)}: needs 0 < low <= high <= {0.2 * KNOT_HZ:g} Hz"
            )
    if style.step_hz > 5 or style.shift_s <= 0.1 or style.corner_s <= 0:
        raise InputError(f"{name}: needs step_hz <= 5, shift_s > 0.1 and corner_s > 0")
    return style


def _wandering(style: HeadStyle, t_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Offsets (N, 3) in m and angles (N, 3) in rad: slow drift and fast vibration."""
    rms = np.array([*style.drift_m, *np.radians(style.drift_deg)])
    noise = smooth_noise(t_s, rng, style.drift_hz, 6) * rms
    rms = np.array([*style.vibration_m, *np.radians(style.vibration_deg)])
    noise += smooth_noise(t_s, rng, style.vibration_hz, 6) * rms
    return noise[:, :3], noise[:, 3:]


def _gait(style: HeadStyle, t_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Offsets (N, 3) in m and angles (N, 3) in rad of steps, strokes or pushes."""
    start = rng.uniform(0, 4 * np.pi)
    uneven = style.unevenness * smooth_noise(t_s, rng, (0.1, 0.5), 3)
    phase = 2 * np.pi * (style.step_hz * t_s + uneven[:, 0]) + start
    on = 1.0 if style.step_hz > 0 else 0.0
    step, stride = on * (1 + uneven[:, 1]), on * (1 + uneven[:, 2])
    up, left = -np.cos(phase) * step, np.sin(phase / 2) * stride
    offset_m = 0.5 * np.column_stack(
        [
            style.surge_m * np.sin(phase) * step,
            style.sway_m * left,
            style.bob_m * (up - style.impact * np.cos(2 * phase) * step),
        ]
    )
    amplitudes = np.radians([style.pitch_deg, style.yaw_deg, style.roll_deg])
    roll = np.sin(phase / 2 + 0.6) * stride
    return offset_m, amplitudes * np.column_stack([-up, left, roll])


def _quats(heading_rad: Array, angles_rad: Array) -> Array:
    """Quaternions (N, 4) of the head: its heading, then yaw, pitch and roll in its own axes."""
    from scipy.spatial.transform import Rotation

    rest = Rotation.from_matrix(look_at((0, 0, 0), (1, 0, 0))[:3, :3])
    body = Rotation.from_euler("YXZ", angles_rad[:, [1, 0, 2]])
    quats: Array = (Rotation.from_euler("z", heading_rad[:, None]) * rest * body).as_quat()
    return quats


def _turned(heading_rad: Array, offset_m: Array) -> Array:
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    forward, left, up = offset_m.T
    return np.column_stack([cos * forward - sin * left, sin * forward + cos * left, up])


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
        raise InputError(f"a path with corners of shape {path_m.shape}: need (N, 2), N >= 2")
    legs = np.diff(path_m, axis=0)
    if (np.linalg.norm(legs, axis=1) < 1e-6).any():
        raise InputError("a path with a corner twice in a row: remove the repeated one")
    headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    turns = np.abs(np.diff(headings))
    if (turns > np.radians(170)).any():
        k = int(np.argmax(turns)) + 1
        raise InputError(
            f"the path turns by {np.degrees(turns[k - 1]):.0f} degrees at corner {k}: "
            "people walk in a curve, add corners there (170 degrees at most)"
        )
    return legs, headings
