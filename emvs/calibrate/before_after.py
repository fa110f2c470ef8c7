"""One window mapped with the given and with the refined calibration, to compare them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eventsweep.emvs.baselines.rectification import Rectified
from eventsweep.emvs.calibrate.epipolar import Floats, epipolar_residuals_px
from eventsweep.emvs.calibrate.refine import Refinement
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.window_result import WindowResult
from eventsweep.emvs.windows import Window


@dataclass(frozen=True, eq=False)
class MappedWith:
    """A window mapped under one calibration, `as given` or `refined`.

    `residuals_px` are (N,) rows between matched patches of both cameras; none for one camera.
    """

    name: str
    mapped: WindowResult
    residuals_px: Floats

    @property
    def method(self) -> str:
        """The only mapped method."""
        return next(iter(self.mapped.depth_maps))


def before_and_after(
    recording: Recording, refinement: Refinement, update: Callable[[float, str], None]
) -> list[MappedWith]:
    """Maps the window with the largest gain with both calibrations.

    `update` is called with how many are mapped, and the name of the next.
    """
    gain = refinement.sharpness[:, 1] / refinement.sharpness[:, 0]
    t0_us, t1_us = refinement.windows[int(gain.argmax())]
    window = Window(t0_us, t1_us, (t0_us + t1_us) // 2, (0,) * len(recording.rig))
    config = MapperConfig(
        methods=("Alg1/H" if len(recording.rig) > 1 else "EMVS/cam0",),
        min_depth_m=refinement.config.min_depth_m,
        max_depth_m=refinement.config.max_depth_m,
        threads=refinement.config.threads,
    )
    sides = []
    pair = (("as given", recording), ("refined", refinement.applied(recording)))
    for done, (name, calibrated) in enumerate(pair):
        update(float(done), name)
        mapped = map_window(calibrated, config, window=window)
        sides.append(MappedWith(name, mapped, _residuals_px(calibrated, config, refinement)))
    return sides


def _residuals_px(recording: Recording, config: MapperConfig, refinement: Refinement) -> Floats:
    if len(recording.rig) < 2:
        return np.empty(0)
    near_m, _ = depth_range_m(recording, config)
    try:
        Rectified.of(recording.rig)
    except InputError:  # no common view of both cameras
        return np.empty(0)
    times_us = [(t0_us + t1_us) // 2 for t0_us, t1_us in refinement.windows]
    return np.concatenate([epipolar_residuals_px(recording, t_us, near_m) for t_us in times_us])
