"""What smoothing takes from a trajectory: `python tests/benchmarks replay_cost FILE`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.errors import InputError
from eventsweep.sim.motion.replay import Replay

_RATE_HZ = 200.0


def row(path: Path, cutoff_hz: float, max_gap_s: float, max_speed_m_s: float) -> str:
    """One line of the table: the trajectory at one cut-off.

    Raises:
        InputError: what `Replay` refuses.
    """
    recorded = read_poses(path)
    replay = Replay(
        position_hz=cutoff_hz,
        rotation_hz=cutoff_hz,
        max_gap_s=max_gap_s,
        max_speed_m_s=max_speed_m_s,
    )
    motion = replay.motion(recorded)
    t_s = np.minimum((recorded.t_us - recorded.t_us[0]) * 1e-6, motion.duration_s)
    moved_mm = 1e3 * (motion.poses(t_s)[:, :3, 3] - recorded.positions_m)
    times_s = np.arange(0, motion.duration_s, 1 / _RATE_HZ)
    acceleration = motion.kinematics(times_s).acceleration_m_s2
    poses = f"{len(recorded)} poses, longest gap {np.diff(t_s).max():.3f} s"
    cells = (path.name, poses, f"{cutoff_hz:g}", _spread(moved_mm), _spread(acceleration))
    return f"| {' | '.join(cells)} |"


def _spread(vectors: NDArray[np.float64]) -> str:
    sizes = np.percentile(np.linalg.norm(vectors, axis=1), (50, 95, 100))
    return " / ".join(f"{size:.2g}" if size < 100 else f"{size:.0f}" for size in sizes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a Markdown table; exit code 2 and one line where a file cannot be replayed."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks replay_cost", description=__doc__
    )
    parser.add_argument("paths", nargs="+", type=Path, help="trajectories in TUM format")
    parser.add_argument("--hz", nargs="+", type=float, default=[10.0], help="cut-offs")
    parser.add_argument("--max-gap-s", type=float, default=0.05)
    parser.add_argument("--max-speed-m-s", type=float, default=12.0)
    chosen = parser.parse_args(arguments)
    limits = chosen.max_gap_s, chosen.max_speed_m_s
    try:
        lines = [row(path, hz, *limits) for path in chosen.paths for hz in chosen.hz]
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    head = "| recording | poses | cut-off Hz | moved by mm | acceleration m/s² |\n" + "|---" * 5
    sys.stdout.write("Median / 95th percentile / maximum.\n\n")
    sys.stdout.write("\n".join([f"{head}|", *lines]) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
