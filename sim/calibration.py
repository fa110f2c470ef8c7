"""Rigs from calibration files, under the names by which the simulator asks for them."""

from emvs.io.calibration import read_imu_cam, read_rig
from emvs.io.calibration_values import matrix, parsed, pose_of

__all__ = ["matrix", "parsed", "pose_of", "read_imu_cam", "read_rig"]
