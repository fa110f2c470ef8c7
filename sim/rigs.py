"""Named rigs, and rigs from calibration files; the body is camera 0.

The numbers of real rigs are rounded facts from the data sets' published calibrations: focal lengths
and principal points to 0.01 px, positions to 10 µm, rotations to 1e-6.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig

_SUFFIXES = (".json", ".yaml", ".yml")


def _at(
    position_m: tuple[float, float, float],
    quat_xyzw: tuple[float, float, float, float] = (0, 0, 0, 1),
) -> NDArray[np.float64]:
    quaternion = np.array(quat_xyzw)
    return se3.from_quat_xyzw(np.array(position_m), quaternion / np.linalg.norm(quaternion))


def _stereo(name: str, left: Camera, right: Camera, T_body_right: NDArray[np.float64]) -> Rig:
    return Rig(name, (left, right), (np.eye(4), T_body_right), ("left", "right"))


# Resolution and baseline of the DAVIS346 pair of MVSEC (RA-L 2018); a lens of 76 degrees.
_DAVIS346 = _stereo(
    "davis346",
    Camera(346, 260, 226.4, 226.2, 173.6, 133.7),
    Camera(346, 260, 226.1, 226.3, 170.9, 128.4),
    _at((0.10, 0.0, 0.0)),
)

# The Prophesee Gen4 pair of TUM-VIE (IROS 2021): principal points far above the middle row.
_TUMVIE = _stereo(
    "tumvie",
    Camera(1280, 720, 1049.6, 1049.6, 634.7, 263.5),
    Camera(1280, 720, 1050.1, 1050.0, 652.9, 260.5),
    _at((0.1184, 0.0, 0.0)),
)

# The same pair as TUM-VIE's calibration A has it: lenses, and a right camera turned by 1.4 degrees.
_TUMVIE_KB4 = _stereo(
    "tumvie-kb4",
    Camera(
        1280, 720, 1049.58, 1049.42, 634.72, 263.47, "kb4",
        (-0.115197, -0.062222, 0.216826, -0.235286),
    ),
    Camera(
        1280, 720, 1047.67, 1047.52, 652.91, 260.54, "kb4",
        (-0.124611, 0.006075, 0.035662, -0.088880),
    ),
    _at((0.11844, -0.00150, -0.00215), (-0.010658, 0.006671, 0.001450, 0.999920)),
)  # fmt: skip

# The DAVIS346 pair of MVSEC (RA-L 2018), as calibrated for indoor_flying.
_MVSEC = _stereo(
    "mvsec",
    Camera(
        346, 260, 226.38, 226.15, 173.65, 133.73, "kb4",
        (-0.048031, 0.011331, -0.055378, 0.021501),
    ),
    Camera(
        346, 260, 226.02, 225.79, 174.54, 124.22, "kb4",
        (-0.048467, 0.010093, -0.042931, 0.005195),
    ),
    _at((0.09987, 0.00150, -0.00044), (0.005002, 0.002262, 0.005533, 0.999970)),
)  # fmt: skip

# The event cameras (cam0 and cam3) of DSEC (RA-L 2021), as calibrated for zurich_city_04.
_DSEC = _stereo(
    "dsec",
    Camera(
        640, 480, 553.47, 553.40, 346.65, 216.52, "radtan",
        (-0.093565, 0.194458, 0.000076, 0.001956),
    ),
    Camera(
        640, 480, 552.18, 551.45, 336.87, 226.33, "radtan",
        (-0.094937, 0.202115, 0.000582, 0.001455),
    ),
    _at((0.59895, -0.00191, 0.00962), (-0.002212, -0.009371, -0.005702, 0.999937)),
)  # fmt: skip

# The DAVIS240C pair of Zhou et al. (ECCV 2018). Known: resolution, and the 14.7 cm baseline.
# Assumed: focal lengths of about 200 px (a lens of 62 degrees), principal points a few pixels off
# the middle, no distortion, and parallel axes.
_RPG = _stereo(
    "rpg",
    Camera(240, 180, 199.6, 199.3, 121.4, 91.8),
    Camera(240, 180, 200.2, 199.9, 117.7, 88.3),
    _at((0.147, 0.0, 0.0)),
)

# Invented: the DAVIS346 pair with a third camera on the forehead between them, 6 cm higher and
# tilted down by 5 degrees, so that no two of the three baselines are parallel.
_TRINOCULAR = Rig(
    "trinocular",
    (*_DAVIS346.cameras, Camera(346, 260, 225.8, 226.0, 172.2, 130.6)),
    (
        np.eye(4),
        _at((0.10, 0.0, 0.0)),
        _at((0.05, -0.06, 0.0), (-np.sin(np.radians(2.5)), 0.0, 0.0, np.cos(np.radians(2.5)))),
    ),
    ("left", "right", "forehead"),
)

# Invented: the DAVIS346 pair, and between them, 4 cm higher, a grey camera of VGA size with a lens
# of 77 degrees that distorts, tilted down by 3 degrees.
_DAVIS346_FRAMES = replace(
    _DAVIS346,
    name="davis346-frames",
    frame_cameras=Rig(
        "davis346-frames, frames",
        (Camera(640, 480, 403.2, 402.7, 324.1, 236.8, "radtan", (-0.17, 0.09, 4e-4, -3e-4)),),
        (_at((0.05, -0.04, 0.01), (-np.sin(np.radians(1.5)), 0.0, 0.0, np.cos(np.radians(1.5)))),),
        ("grey",),
    ),
)

# Invented, for tests: small, and nothing about it is zero, straight or equal. Two kinds of lens,
# and a second camera turned about all axes and moved along all of them.
_OBLIQUE = _stereo(
    "oblique",
    Camera(160, 120, 108.2, 106.9, 82.3, 57.4, "radtan", (-0.18, 0.06, 0.002, -0.0015, -0.01)),
    Camera(168, 116, 104.8, 106.1, 80.9, 60.2, "kb4", (-0.06, 0.012, -0.02, 0.006)),
    _at((0.09, 0.035, -0.025), (0.012, -0.018, 0.025, 0.9995)),
)

RIGS = {
    rig.name: rig
    for rig in (
        _DAVIS346,
        _DAVIS346_FRAMES,
        _TUMVIE,
        _TUMVIE_KB4,
        _MVSEC,
        _DSEC,
        _RPG,
        _TRINOCULAR,
        _OBLIQUE,
    )
}


def rig(name_or_path: str) -> Rig:
    """The rig called so, or that of a calibration file (.json, .yaml, .yml).

    Raises:
        InputError: there is none; says which there are. Or a file that is no calibration.
    """
    if name_or_path in RIGS:
        return RIGS[name_or_path]
    if name_or_path.lower().endswith(_SUFFIXES):
        from eventsweep.emvs.formats.calibration import read_rig

        return read_rig(Path(name_or_path))
    raise InputError(
        f"unknown rig {name_or_path!r}: choose one of {', '.join(sorted(RIGS))}, or name a "
        "calibration file (.json, .yaml)"
    )
