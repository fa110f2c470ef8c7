"""How sharp the DSI of a window is: the higher, the better events, calibration and poses agree.

Rays of one edge meet in few voxels where all of them are right, and spread over many where a clock,
a pose or a calibration is wrong: votes are as many, their maxima are lower. Contrast of votes as a
measure of alignment is Gallego et al., CVPR 2018; here it is that of the fused volume, which also
tells how well the cameras agree with each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.dsi.backend import SweepSettings
from emvs.dsi.backprojection import CpuProjector, back_project
from emvs.dsi.maxima import Measures
from emvs.dsi.method import CODES, WHOLE, Method, single_camera
from emvs.dsi.sweep import group_by_split, sweep
from emvs.reference_view import reference_view
from emvs.windows import Window, choose_window

LARGEST = 2000
"""Rays whose maxima count: those through edges, not those through what is between them."""


def sharpness(
    recording: Recording,
    config: MapperConfig,
    window: Window | None = None,
    camera: int | None = None,
) -> float:
    """Mean of the `LARGEST` largest ray maxima of a window's DSI, in votes.

    Args:
        recording: events, poses and calibration.
        config: planes, voting and threads; the window where none is given.
        window: which events, and the time of the reference view; by default what the configuration
            says.
        camera: of this camera's volume alone; by default the harmonic mean of all cameras.

    Raises:
        InputError: what `emvs.mapper.map_window` refuses: a window that events or poses do not
            cover, a camera none of whose events can vote, an impossible depth range.
    """
    return sharpnesses(recording, config, (camera,), window)[0]


def sharpnesses(
    recording: Recording,
    config: MapperConfig,
    cameras: Sequence[int | None],
    window: Window | None = None,
) -> tuple[float, ...]:
    """The same of several volumes, from one sweep.

    Args:
        recording: events, poses and calibration.
        config: planes, voting and threads; the window where none is given.
        cameras: of which camera's volume each; None: the harmonic mean of all cameras.
        window: which events, and the time of the reference view.

    Raises:
        InputError: as `sharpness`.
    """
    window = choose_window(recording, config) if window is None else window
    view = reference_view(recording, config, window.t_ref_us)
    n_cameras = len(recording.rig)
    fused = Method("Alg1/H", CODES["H"], "harmonic mean") if n_cameras > 1 else single_camera(0)
    methods = [fused if camera is None else single_camera(camera) for camera in cameras]
    projected = back_project(recording, window, view, [WHOLE], CpuProjector())
    votes = Measures("votes", config.focus_measure, config.focus_sigma_px)
    sums = "nearest" if config.voting == "nearest" else config.voting_precision
    settings = SweepSettings(sums, 1, votes, config.threads)
    groups = group_by_split(tuple(dict.fromkeys(methods)), n_cameras)
    maxima = sweep(projected, view, groups, settings).maxima
    return tuple(_mean_of_largest(maxima[method.name].value) for method in methods)


def _mean_of_largest(votes: NDArray[np.float32]) -> float:
    """Mean of the largest values of an image, of all of them where there are fewer."""
    largest = min(LARGEST, votes.size)
    return float(np.partition(votes.ravel(), -largest)[-largest:].mean(dtype=np.float64))
