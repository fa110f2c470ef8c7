"""Twin of rpg_eccv18 reader: somebody sits at a table and reads a book."""

from __future__ import annotations

from eventsweep.scenes.parts.office import case

SCENE = case(
    "rpg-reader",
    "somebody reading at a table in an office, 0.5 to 6 m",
    eye_m=(1.38, 0.86, 1.2),
    target_m=(1.52, 2.4, 1.02),
)
