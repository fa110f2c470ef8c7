"""Twin of rpg_eccv18 monitor: a screen, a keyboard and papers on a desk in an office."""

from __future__ import annotations

from eventsweep.scenes.parts.office import case

SCENE = case(
    "rpg-monitor",
    "a monitor on a desk, the office behind it, 0.5 to 6 m",
    eye_m=(-1.92, 0.92, 1.18),
    target_m=(-1.85, 2.0, 0.95),
)
