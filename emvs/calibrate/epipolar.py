"""How far matched patches of two cameras lie off their epipolar lines: a check besides sharpness.

With a correct calibration the rows of the rectified views correspond. Patches of one view's event
image are searched in the other's, along the row and a few rows above and below; the residual is the
row offset of the best match by normalised cross-correlation.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.rectification import Rectified
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording

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
