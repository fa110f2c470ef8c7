"""What scenes of your own are made of: motions of a rig, inertial samples, textures."""

from eventsweep.emvs.data.tables import write_imu
from eventsweep.scenes import textures
from eventsweep.sim.config import ImuConfig
from eventsweep.sim.motion.curves import HeadSway, look_at, sampled
from eventsweep.sim.motion.head_motion import along, placed, six_dof, walk
from eventsweep.sim.motion.replay import Replay, hand_eye
from eventsweep.sim.scene import Scene
from eventsweep.sim.sensor.imu import imu_samples

__all__ = [
    "HeadSway",
    "ImuConfig",
    "Replay",
    "Scene",
    "along",
    "hand_eye",
    "imu_samples",
    "look_at",
    "placed",
    "sampled",
    "six_dof",
    "textures",
    "walk",
    "write_imu",
]
