"""Pictures of the head generators: `python docs/figures/draw_motion.py docs/images`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.motion.head_motion import generate
from eventsweep.sim.motion.head_styles import STYLES

# Okabe and Ito's colours, told apart by colour-blind readers; the line styles tell them apart too.
_LINES = (("#0072B2", "-"), ("#D55E00", "--"), ("#009E73", ":"))
_RATE_HZ = 100.0


def draw(name: str, path: Path, duration_s: float = 8.0, seed: int = 0) -> None:
    """Draws position (without the way forward), rotation and its rate over time to a PNG."""
    from matplotlib.figure import Figure
    from PIL import Image
    from scipy.spatial.transform import Rotation

    style, motion = STYLES[name], generate(name, duration_s, seed)
    t_s = np.linspace(0, duration_s, int(duration_s * _RATE_HZ) + 1)
    poses = motion.poses(t_s)
    offset_m = poses[:, :3, 3] - np.outer(style.speed_m_s * t_s, (1.0, 0.0, 0.0))
    neutral = Rotation.from_matrix(look_at((0, 0, 0), (1, 0, 0))[:3, :3])
    turned = neutral.inv() * Rotation.from_matrix(poses[:, :3, :3])
    yaw_pitch_roll = turned.as_euler("YXZ", degrees=True)
    rate = np.degrees(motion.kinematics(t_s).angular_velocity_rad_s)[:, [1, 0, 2]]
    figure = Figure(figsize=(8, 5.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    moving = f" minus {style.speed_m_s:g} m/s forward" if style.speed_m_s else ""
    axes[0].set_title(f"{name}, seed {seed}{moving}")
    panels = (
        (100 * offset_m, "position (cm)", ("forward", "left", "up")),
        (yaw_pitch_roll, "rotation (deg)", ("yaw", "pitch", "roll")),
        (rate, "rotation rate (deg/s)", ("yaw", "pitch", "roll")),
    )
    for axis, (values, label, names) in zip(axes, panels, strict=True):
        for column, line, (colour, dash) in zip(values.T, names, _LINES, strict=True):
            axis.plot(t_s, column, dash, color=colour, label=line, linewidth=1.4)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes[-1].set_xlabel("time (s)")
    drawn = BytesIO()
    figure.savefig(drawn, format="png")
    # A palette of 32 colours keeps the picture under 100 kB, and nothing of it is lost to the eye.
    Image.open(drawn).convert("RGB").quantize(32).save(path, optimize=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draws `motion-NAME.png` for every generator into a folder."""
    parser = argparse.ArgumentParser(prog="python docs/figures/draw_motion.py", description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    folder.mkdir(parents=True, exist_ok=True)
    for name in STYLES:
        draw(name, folder / f"motion-{name.replace('_', '-')}.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
