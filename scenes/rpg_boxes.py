"""Twin of rpg_eccv18 boxes: cartons, a crate and toy blocks on the floor of an office."""

from __future__ import annotations

from eventsweep.scenes.parts.office import case

SCENE = case(
    "rpg-boxes",
    "boxes on an office floor before a sofa and a whiteboard, 0.5 to 6 m",
    eye_m=(0.15, 0.75, 1.3),
    target_m=(0.05, 2.8, 0.75),
)
