"""Named stereo rigs; the body is camera 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.data.camera import Camera
from emvs.data.rig import Rig
from emvs.errors import InputError


def _beside(baseline_m: float) -> NDArray[np.float64]:
    T_body_cam = np.eye(4)
    T_body_cam[0, 3] = baseline_m
    return T_body_cam


def _stereo(name: str, left: Camera, right: Camera, baseline_m: float) -> Rig:
    return Rig(name, (left, right), (np.eye(4), _beside(baseline_m)), ("left", "right"))


# Resolution and baseline of the DAVIS346 pair of MVSEC (RA-L 2018); a lens of 76 degrees.
_DAVIS346 = _stereo(
    "davis346",
    Camera(346, 260, 226.4, 226.2, 173.6, 133.7),
    Camera(346, 260, 226.1, 226.3, 170.9, 128.4),
    baseline_m=0.10,
)

# The Prophesee Gen4 pair of TUM-VIE (IROS 2021): principal points far above the middle row.
_TUMVIE = _stereo(
    "tumvie",
    Camera(1280, 720, 1049.6, 1049.6, 634.7, 263.5),
    Camera(1280, 720, 1050.1, 1050.0, 652.9, 260.5),
    baseline_m=0.1184,
)

RIGS = {rig.name: rig for rig in (_DAVIS346, _TUMVIE)}


def rig(name: str) -> Rig:
    """Returns the rig called `name`.

    Raises:
        InputError: there is none; says which there are.
    """
    if name not in RIGS:
        raise InputError(f"unknown rig {name!r}: choose one of {', '.join(sorted(RIGS))}")
    return RIGS[name]
