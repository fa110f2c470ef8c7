"""Every parameter of the IMU; imports no numpy."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, field_validator

from emvs.parameters import ParameterGroup

Density = Annotated[float, Field(ge=0)]
Vector3 = tuple[float, float, float]


class ImuConfig(ParameterGroup):
    """An IMU on the body, of the order of Bosch's BMI160; docs/motion.md says what is known."""

    model_config = ConfigDict(allow_inf_nan=False)

    rate_hz: Annotated[float, Field(ge=0, le=1e5)] = 200.0
    """Samples per second, Hz; 0 for no IMU."""

    gyro_noise: Density = 1.2e-4
    """White noise of the gyroscope, rad/s/sqrt(Hz)."""

    accel_noise: Density = 1.8e-3
    """White noise of the accelerometer, m/s^2/sqrt(Hz)."""

    gyro_walk: Density = 2e-6
    """Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz)."""

    accel_walk: Density = 3e-5
    """Random walk of the accelerometer's bias, m/s^3/sqrt(Hz)."""

    gyro_bias: Vector3 = (0.0, 0.0, 0.0)
    """At the start, rad/s."""

    accel_bias: Vector3 = (0.0, 0.0, 0.0)
    """At the start, m/s^2."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Where the IMU sits in the body's axes (those of camera 0: right, down, forward), m."""

    quat_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """How it is turned: unit quaternion of R_body_imu."""

    @field_validator("quat_xyzw")
    @classmethod
    def _unit(cls, quat: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        norm = sum(value * value for value in quat) ** 0.5
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"a quaternion of length {norm:.4g}: needs length 1, order x y z w")
        return quat

    def noiseless(self) -> ImuConfig:
        """The same IMU without noise and bias."""
        none = (0.0, 0.0, 0.0)
        zeros = dict.fromkeys(("gyro_noise", "accel_noise", "gyro_walk", "accel_walk"), 0.0)
        return self.model_copy(update={**zeros, "gyro_bias": none, "accel_bias": none})
