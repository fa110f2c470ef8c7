"""The desk scene seen by three cameras on one head."""

from __future__ import annotations

from dataclasses import replace

from eventsweep.scenes.desk import SCENE as _DESK

SCENE = replace(
    _DESK,
    name="trinocular-desk",
    rig="trinocular",
    summary="the cluttered desk seen by three cameras on the head, 0.45 to 4 m",
)
