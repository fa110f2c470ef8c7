"""Head motion in a table: `python tests/benchmarks motion_statistics [TUM files...]`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.curves import CurveMotion, curve_of
from eventsweep.sim.motion.head_motion import generate
from eventsweep.sim.motion.head_styles import STYLES
from eventsweep.sim.motion.replay import Replay

Array = NDArray[np.float64]
_RATE_HZ = 200.0
CUTOFF_HZ = 10.0


@dataclass(frozen=True)
class Spread:
    """Median, 95th percentile and maximum of one quantity over time."""

    median: float
    p95: float
    maximum: float

    def __str__(self) -> str:
        return " / ".join(f"{value:.3g}" for value in (self.median, self.p95, self.maximum))


@dataclass(frozen=True)
class HeadStatistics:
    """How a head moves.

    Attributes:
        speed_m_s: of the body's origin.
        acceleration_m_s2: of the body's origin, without gravity.
        rate_rad_s: rotation.
        angular_acceleration_rad_s2: rotation.
        acceleration_hz: frequency with most power in the acceleration.
        rate_hz: frequency with most power in the rotation rate.
    """

    speed_m_s: Spread
    acceleration_m_s2: Spread
    rate_rad_s: Spread
    angular_acceleration_rad_s2: Spread
    acceleration_hz: float
    rate_hz: float


def statistics(motion: Motion, duration_s: float) -> HeadStatistics:
    """Statistics of a motion over [0, `duration_s`]; the first and last 50 ms are left out.

    There a smoothed recording has ends, which no filter knows well.
    """
    smooth = curve_of(motion, duration_s)
    margin_s = min(0.05, 0.1 * duration_s)
    count = max(16, int(duration_s * _RATE_HZ))
    moving = smooth.kinematics(np.linspace(margin_s, duration_s - margin_s, count))
    rate_hz = (count - 1) / (duration_s - 2 * margin_s)
    return HeadStatistics(
        _spread(moving.velocity_m_s),
        _spread(moving.acceleration_m_s2),
        _spread(moving.angular_velocity_rad_s),
        _spread(moving.angular_acceleration_rad_s2),
        _dominant_hz(moving.acceleration_m_s2, rate_hz),
        _dominant_hz(moving.angular_velocity_rad_s, rate_hz),
    )


def recorded(path: Path, cutoff_hz: float = CUTOFF_HZ) -> CurveMotion:
    """A TUM file as a smooth motion, low-passed at `cutoff_hz`, the recording's own scale."""
    from eventsweep.emvs.data.poses import read_poses

    try:
        return Replay(position_hz=cutoff_hz, rotation_hz=cutoff_hz).motion(read_poses(path))
    except InputError as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise InputError(f"{path}: {reason}") from error


def table(rows: Iterable[tuple[str, float, HeadStatistics]]) -> str:
    """Markdown table of (name, duration in s, statistics)."""
    lines = [
        "| motion | length s | speed m/s | acceleration m/s² | rotation rad/s "
        "| angular acceleration rad/s² | acceleration peak Hz | rotation peak Hz |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {duration_s:.0f} | {s.speed_m_s} | {s.acceleration_m_s2} | {s.rate_rad_s} "
        f"| {s.angular_acceleration_rad_s2} | {s.acceleration_hz:.2f} | {s.rate_hz:.2f} |"
        for name, duration_s, s in rows
    ]
    return "\n".join(lines)


def rows_of(
    paths: Sequence[Path], duration_s: float, seed: int
) -> list[tuple[str, float, HeadStatistics]]:
    """Table rows: the recordings first, then every generator."""
    rows = []
    for path in paths:
        motion = recorded(path)
        rows.append((path.name, motion.duration_s, statistics(motion, motion.duration_s)))
    for name in STYLES:
        motion = generate(name, duration_s, seed)
        rows.append((f"`{name}`", duration_s, statistics(motion, duration_s)))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table; exit code 2 and one line where a file cannot be used."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks motion_statistics", description=__doc__
    )
    parser.add_argument("paths", nargs="*", type=Path, help="trajectories in TUM format")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the generators")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    try:
        printed = table(rows_of(chosen.paths, chosen.seconds, chosen.seed))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"Median / 95th percentile / maximum.\n\n{printed}\n")
    return 0


def _spread(vectors: Array) -> Spread:
    sizes = np.linalg.norm(vectors, axis=1)
    return Spread(*(float(value) for value in np.percentile(sizes, (50, 95, 100))))


def _dominant_hz(vectors: Array, rate_hz: float) -> float:
    """Frequency of the highest peak of Welch's spectrum, summed over the three axes."""
    from scipy.signal import welch

    segment = min(len(vectors), int(8 * rate_hz))
    frequency, power = welch(vectors, rate_hz, nperseg=segment, axis=0)
    return float(frequency[1:][np.argmax(power[1:].sum(axis=1))])


if __name__ == "__main__":
    raise SystemExit(main())
