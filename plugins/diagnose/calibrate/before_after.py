"""The given and the refined calibration, compared: maps of one window, and epipolar lines.

With a correct calibration the rows of the rectified views correspond. Patches of one view's event
image are searched in the other's, along the row and a few rows above and below; the residual is the
row offset of the best match by normalised cross-correlation: a check besides sharpness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.rectification import Rectified
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.window_result import WindowResult
from eventsweep.emvs.windows import Window
from eventsweep.plugins.diagnose.calibrate.refine import Refinement

Floats = NDArray[np.float64]
_HALF_PX = (15, 8)  # columns and rows of a patch to each side of its middle
_ROWS_PX = 5  # that a patch may lie above or below
_STEP_PX = 12
_EVENTS = 40_000  # of an event image: edges a few pixels wide
_FEWEST = 60  # events in a patch
_SURE = 0.6  # correlation


def epipolar_residuals_px(recording: Recording, t_us: int, nearest_m: float) -> Floats:
    """(N,) rows between a patch of camera 0 and its match in camera 1, rectified px.

    The nearest depth bounds disparity.

    Raises:
        InputError: a pair that cannot be rectified.
    """
    pair = Rectified.of(recording.rig)
    left, right = (_event_image(recording, pair, side, t_us) for side in (0, 1))
    most_px = int(np.ceil(pair.disparity_px(nearest_m))) + 2
    half_u, half_v = _HALF_PX
    offsets = []
    for v in range(half_v + _ROWS_PX, left.shape[0] - half_v - _ROWS_PX, _STEP_PX):
        for u in range(half_u + most_px, left.shape[1] - half_u, _STEP_PX):
            patch = left[v - half_v : v + half_v + 1, u - half_u : u + half_u + 1]
            rows = slice(v - half_v - _ROWS_PX, v + half_v + _ROWS_PX + 1)
            if patch.sum() >= _FEWEST:
                strip = right[rows, u - half_u - most_px : u + half_u + 1]
                offsets.append(_row_offset(patch, strip))
    return np.array([offset for offset in offsets if offset is not None])


def _event_image(
    recording: Recording, pair: Rectified, side: int, t_us: int
) -> NDArray[np.float32]:
    """The newest events before a time, counted per rectified pixel and blurred a little."""
    events = _before(recording, side, t_us)
    sensor = recording.rig.cameras[side]
    counts = np.zeros((sensor.height_px, sensor.width_px), np.float32)
    np.add.at(counts, (events.y, events.x), 1)
    image = pair.image(side, np.minimum(counts, 3))
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), np.float32)


def _before(recording: Recording, camera: int, t_us: int) -> Events:
    events = recording.events(camera, t_us - 30_000, t_us)
    return events.slice(max(0, len(events) - _EVENTS), len(events))


def _row_offset(patch: NDArray[np.float32], strip: NDArray[np.float32]) -> float | None:
    score = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    if score[row, column] < _SURE or row in (0, score.shape[0] - 1):
        return None
    above, best, below = (float(score[row + k, column]) for k in (-1, 0, 1))
    bend = 2 * best - above - below
    return float(row - _ROWS_PX + (0.5 * (below - above) / bend if bend > 0 else 0.0))


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
