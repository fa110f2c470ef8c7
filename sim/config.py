"""Every parameter of the simulator, in one place; imports no numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import ConfigDict, Field, field_validator, model_validator

from emvs.parameters import ParameterGroup
from sim.sensor_presets import PRESETS, SensorConfig

TruthName = Literal["flow", "segmentation", "boundary", "twist", "event_depth"]
"""Ground truth on request, see the page `truth`."""
Density = Annotated[float, Field(ge=0)]
Vector3 = tuple[float, float, float]
LightRenderer = Literal["auto", "classic", "float"]
SamplingName = Literal["accurate", "fast", "linear"]


class Sampling(NamedTuple):
    """What a name of `sampling` stands for, unless single settings override it.

    Attributes:
        spacing_px: furthest motion of any pixel between two frames, px.
        longest_interval_us: longest time between them, µs.
        samples_per_rad: samples per angle; 0 leaves it at the fewest.
        fewest: least number of samples per pixel and axis.
    """

    spacing_px: float
    longest_interval_us: int
    samples_per_rad: float
    fewest: int


SAMPLINGS: dict[SamplingName, Sampling] = {
    "accurate": Sampling(8.0, 50_000, 1300.0, 3),
    "fast": Sampling(8.0, 50_000, 850.0, 2),
    "linear": Sampling(0.5, 10_000, 0.0, 2),
}
Positive = Annotated[float, Field(gt=0)]
# Far above what counts as a tie (sim.sensor.esim_kernels), mismatched pixels included.
Threshold = Annotated[float, Field(ge=1e-6)]


class ShutterConfig(ParameterGroup):
    """How a frame camera turns light into a picture."""

    model_config = ConfigDict(allow_inf_nan=False)

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] = 1.0
    """Pixel value per mean light: 1 saturates at intensity 1."""

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Resolution of the converter."""


class FramesConfig(ParameterGroup):
    """The pictures that an ordinary camera takes in the place of each event camera."""

    model_config = ConfigDict(allow_inf_nan=False)

    rate_hz: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Pictures per second, Hz; 0 for none; by default the scene's own, which is 0 for most."""

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] | None = None
    """Pixel value per mean light: 1 saturates at intensity 1; by default each is exposed by itself.
    """

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Resolution of the converter."""

    auto_percentile: Annotated[float, Field(ge=0, le=100)] = 50.0
    """Automatic gain looks at this percentile of a picture's light ..."""

    auto_level: Annotated[float, Field(gt=0, le=1)] = 0.18
    """... and puts it at this share of full scale (a grey card has 0.18) ..."""

    auto_max_gain: Annotated[float, Field(gt=0)] = 256.0
    """... unless that takes a gain beyond this one: dark scenes stay dark."""


class ImuConfig(ParameterGroup):
    """An IMU on the body, of the order of Bosch's BMI160; the page `motion` says what is known."""

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


class LightConfig(ParameterGroup):
    """The picture's light."""

    model_config = ConfigDict(allow_inf_nan=False)

    renderer: LightRenderer = "auto"
    """`classic` draws 8 bits per channel and sample, cut at 1; `float` draws 32-bit linear light
    without end; `auto` takes `float` for scenes that say `hdr`, else `classic`."""

    def floats(self, hdr: bool) -> bool:
        """Whether a scene is drawn in floating point; `hdr` is what the scene asks for."""
        return self.renderer == "float" or (self.renderer == "auto" and hdr)


class ReplayConfig(ParameterGroup):
    """A recorded trajectory instead of the scene's own motion."""

    model_config = ConfigDict(allow_inf_nan=False)

    trajectory: Path | None = None
    """Poses in TUM format, `t_s x y z qx qy qz qw`; by default the head moves as the scene says."""

    sha256: str = ""
    """Hash of the file: written by the simulation, and checked where it is given."""

    place: Literal["start", "level", "world"] = "start"
    """Where it goes: `start` puts its first pose onto the scene's; `level` as well, but keeps the
    recording's tilt (its world's z must be up); `world` takes the recorded world for the scene's.
    """

    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Added to the positions afterwards, in the scene's axes, m."""

    heading_deg: float = 0.0
    """Turns the whole way about the vertical through its start, counter-clockwise from above."""

    scale: Positive = 1.0
    """Factor on the recorded positions."""

    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Where to begin, s after the first pose."""

    position_hz: Positive = 10.0
    """Smoothing of positions: -3 dB at this frequency, Hz."""

    rotation_hz: Positive = 10.0
    """Smoothing of rotations: -3 dB at this frequency, Hz."""

    max_gap_s: Positive = 0.05
    """Refuse a longer time without a pose; what lies within a gap is interpolated, not recorded."""

    max_speed_m_s: Positive = 12.0
    """Refuse a faster step between two poses, before scaling."""

    max_rate_rad_s: Positive = 20.0
    """Refuse a faster turn between two poses."""

    hand_eye: Path | None = None
    """What turns the recorded body's poses into camera 0's: JSON or YAML with `T_body_cam`, or
    TUM-VIE's mocap-imu calibration, together with `imu_cam`. By default the poses are camera 0's.
    """

    imu_cam: Path | None = None
    """TUM-VIE's camera calibration, with `T_imu_cam`, see `hand_eye`."""


class ModelConfig(ParameterGroup):
    """A model's file in the place of a scene's name; see the page `Your own scene`."""

    mount: str = ""
    """What carries the rig, or where its motion begins: a body, site or camera of the model, such
    as `head` or `site:head`; by default its first camera, where there is one."""

    motion: str = ""
    """What moves: `dynamics` for the model's own, a table (.csv) with columns `t_s` and names of
    joints, or a head style such as `walk` from the mount on."""

    controller: str = ""
    """`MODULE:FUNCTION` called with model and data before each step of `dynamics`."""

    key: str = ""
    """Key frame of the model to begin with."""

    headlight: Literal["fixed", "carried"] = "fixed"
    """MuJoCo's headlight stays where the rig begins, or is a lamp that the rig carries."""

    sha256: str = ""
    """Hash of the file: written by the simulation."""


class SimConfig(ParameterGroup):
    """How frames are sampled and turned into events; defaults are the benchmark's."""

    model_config = ConfigDict(allow_inf_nan=False)

    contrast_threshold_pos: Threshold = 0.2
    """C+: rise of log intensity per positive event, natural logarithm."""

    contrast_threshold_neg: Threshold = 0.2
    """C-: fall of log intensity per negative event, natural logarithm."""

    refractory_period_us: Annotated[int, Field(ge=0)] = 0
    """A pixel stays silent this long after an event that it emitted, µs."""

    log_eps: Annotated[float, Field(gt=0)] = 0.02
    """Added to linear intensity (full scale 1) before the logarithm: bounds contrast in the dark.

    At 0.02 one of the renderer's 255 grey levels stays below the default thresholds even in black.
    """

    sensor: SensorConfig = SensorConfig()
    """Noise, mismatch, bandwidth, latency and read-out; a preset sets thresholds not given."""

    sampling: SamplingName = "accurate"
    """What pixels see between two frames: `accurate` and `fast` carry the light of fine frames
    along the image motion, `linear` blends frames that are close together.
    """

    max_displacement_px: Annotated[float, Field(gt=0, le=64)] | None = None
    """No pixel of any camera moves further than this between two frames, px; by default 8,
    and 0.5 where `sampling` is `linear`."""

    supersample: Annotated[int, Field(ge=1, le=8)] | None = None
    """Each pixel is the mean of this many squared render samples; by default as many as `sampling`
    needs at the rig's focal lengths, and 2 where it is `linear`."""

    light: LightConfig = LightConfig()
    """How the pictures' light is measured, see the page `light`."""

    frames: FramesConfig = FramesConfig()
    """Pictures of an ordinary camera in each event camera's place, see the page `light`."""

    imu: ImuConfig = ImuConfig()
    """Inertial samples, see the page `motion`."""

    replay: ReplayConfig = ReplayConfig()
    """A recorded trajectory instead of the scene's own motion, see the page `motion`."""

    model: ModelConfig = ModelConfig()
    """Where the rig sits on a model of your own, and what moves it."""

    frame_period_us: Annotated[int, Field(ge=1)] | None = None
    """There is a frame at every multiple of this time as well, µs: as many as an event camera in a
    running simulation takes that is asked so often."""

    pose_rate_hz: Annotated[float, Field(gt=0)] = 1000.0
    """Stored poses per second, Hz."""

    truth_interval_s: Annotated[float, Field(gt=0)] = 0.05
    """Depth and a frame are stored this often, and at the start, middle and end, s."""

    truth_times_s: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """More times at which ground truth is stored, s."""

    truth: tuple[TruthName, ...] = ()
    """Ground truth beside depth: at the stored times, and `event_depth` for every event."""

    duration_s: Annotated[float, Field(gt=0)] | None = None
    """Length of the sequence, s; by default the scene's own."""

    min_frame_interval_us: Annotated[int, Field(ge=1)] = 20
    """Frames are never closer than this, µs, but for truth times; faster motion is refused."""

    max_frame_interval_us: Annotated[int, Field(ge=1)] | None = None
    """Frames are never further apart than this, µs, however slow the motion; by default 50 000,
    and 10 000 where `sampling` is `linear`."""

    @model_validator(mode="after")
    def _thresholds_of_preset(self) -> SimConfig:
        for name, value in PRESETS[self.sensor.preset].thresholds.items():
            if name not in self.model_fields_set:
                # Not marked as set: a file's own value still beats a flag's preset.
                self.__dict__[name] = value
        return self

    @property
    def spacing_px(self) -> float:
        """Furthest motion of any pixel between two frames, px."""
        return self.max_displacement_px or SAMPLINGS[self.sampling].spacing_px

    @property
    def longest_interval_us(self) -> int:
        """Longest time between two frames, µs."""
        return self.max_frame_interval_us or SAMPLINGS[self.sampling].longest_interval_us

    @model_validator(mode="after")
    def _ordered_intervals(self) -> SimConfig:
        if self.min_frame_interval_us > self.longest_interval_us:
            raise ValueError(
                f"min_frame_interval_us={self.min_frame_interval_us} exceeds "
                f"max_frame_interval_us={self.longest_interval_us}: lower the first"
            )
        return self
