"""Twin of rpg_eccv18 bin: a waste-paper bin on the floor of an office."""

from __future__ import annotations

from eventsweep.scenes.parts.office import case

SCENE = case(
    "rpg-bin",
    "a waste-paper bin and what missed it, 0.5 to 6 m",
    eye_m=(-0.4, 0.62, 1.0),
    target_m=(-0.3, 1.75, 0.42),
)
