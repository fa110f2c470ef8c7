"""A sequence on disk, in our layout: read lazily, with ground truth."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.data import manifest
from emvs.data.event_store import EventReader
from emvs.data.events import Events
from emvs.data.rig import Rig
from emvs.data.trajectory import Trajectory
from emvs.data.truth_store import TruthReader
from emvs.data.tum import read_tum
from emvs.errors import InputError


class Sequence:
    """A `Recording` with ground truth; opening reads calibration and poses, never the events.

    Attributes:
        path: the folder.
        manifest: what made the sequence.
        rig: its cameras.
        trajectory: `T_world_body`.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.manifest = manifest.read(self.path)
        self.rig = _read_rig(self.path / "rig.json")
        self.trajectory: Trajectory = read_tum(self.path / "poses.txt")

    @classmethod
    def open(cls, path: Path) -> Sequence:
        """Opens a sequence folder.

        Raises:
            InputError: a missing, truncated or impossible file.
        """
        return cls(path)

    @property
    def name(self) -> str:
        """What the sequence is called."""
        return self.manifest.name

    @property
    def depth_range_m(self) -> tuple[float, float] | None:
        """Nearest and farthest depth, if known."""
        return self.manifest.depth_range_m

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant of the recording, µs: a silent start belongs to it."""
        del camera
        return self.manifest.span_us

    def event_count(self, camera: int) -> int:
        """Events of a camera."""
        return self._events[camera].count

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self._events[camera].read(t0_us, t1_us)

    def frame(self, camera: int, t_us: int) -> NDArray[np.uint8] | None:
        """(H, W) intensity of a camera at the stored time nearest to `t_us`, if there is one."""
        times_us = self.truth_times_us(camera)
        if not len(times_us):
            return None
        return self.truth_intensity(camera, int(times_us[np.argmin(np.abs(times_us - t_us))]))

    def truth_times_us(self, camera: int) -> NDArray[np.int64]:
        """Times at which ground truth is stored, µs."""
        return self._truth[camera].t_us

    def truth_depth_m(self, camera: int, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth of a camera at a stored time, m."""
        return self._truth[camera].depth_m(t_us)

    def truth_intensity(self, camera: int, t_us: int) -> NDArray[np.uint8]:
        """(H, W) linear intensity of a camera at a stored time, 0..255."""
        return self._truth[camera].intensity(t_us)

    def verify(self) -> None:
        """Compares every file with its hash.

        Raises:
            InputError: a file that changed.
        """
        manifest.check_hashes(self.path, self.manifest)

    @cached_property
    def _events(self) -> list[EventReader]:
        return [
            EventReader(self.path / f"cam{k}" / "events.h5", camera.width_px, camera.height_px)
            for k, camera in enumerate(self.rig.cameras)
        ]

    @cached_property
    def _truth(self) -> list[TruthReader]:
        return [TruthReader(self.path / f"cam{k}" / "truth.h5") for k in range(len(self.rig))]


def _read_rig(path: Path) -> Rig:
    try:
        return Rig.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a rig's calibration ({error})") from error
