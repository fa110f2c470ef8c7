"""Every parameter of the simulator, in one place; imports no numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from eventsweep.emvs.errors import InputError, shown
from eventsweep.emvs.parameters import RUNS_CODE, ParameterGroup
from eventsweep.sim.sensor_presets import FiniteGroup, SensorConfig, find_preset

TruthName = Literal["flow", "segmentation", "boundary", "twist", "event_depth"]
"""Ground truth on request, see the page `simulator`."""
Density = Annotated[float, Field(ge=0)]
Vector3 = tuple[float, float, float]
AUTO, EITHER, CLASSIC, FLOAT = "auto", "mujoco", "classic", "float"
OF_MUJOCO = EITHER, CLASSIC, FLOAT
Encoding = Literal["srgb", "gamma", "linear", "log"]
"""How values of an image stand for light."""
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
    "accurate": Sampling(12.0, 50_000, 1300.0, 3),
    "fast": Sampling(12.0, 50_000, 850.0, 2),
    "linear": Sampling(0.5, 10_000, 0.0, 2),
}
Positive = Annotated[float, Field(gt=0)]
# Far above what counts as a tie (sim.sensor.esim_kernels), mismatched pixels included.
Threshold = Annotated[float, Field(ge=1e-6)]


class FramesConfig(FiniteGroup):
    """Frames of an ordinary camera in the place of each event camera."""

    rate_hz: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Pictures per second, Hz; 0 for none; by default the scene's own, which is 0 for most."""

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] | None = None
    """Pixel value per mean light: 1 saturates at intensity 1; by default automatic for each
    picture."""

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Bits per pixel."""

    auto_percentile: Annotated[float, Field(ge=0, le=100)] = 50.0
    """Percentile of a picture's light that automatic gain brings to `auto_level`."""

    auto_level: Annotated[float, Field(gt=0, le=1)] = 0.18
    """Target of automatic gain, as a share of full scale; a grey card has 0.18."""

    auto_max_gain: Annotated[float, Field(gt=0)] = 256.0
    """Largest automatic gain: dark scenes stay dark."""


class ImuConfig(FiniteGroup):
    """An IMU on the body, of the order of Bosch's BMI160; see the page `howto_model`."""

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
    """Bias of the gyroscope at the start, rad/s."""

    accel_bias: Vector3 = (0.0, 0.0, 0.0)
    """Bias of the accelerometer at the start, m/s^2."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the IMU in the body's axes (those of camera 0: right, down, forward), m."""

    quat_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Orientation of the IMU: unit quaternion of R_body_imu."""

    @field_validator("quat_xyzw")
    @classmethod
    def _unit(cls, quat: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        norm = sum(value * value for value in quat) ** 0.5
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"a quaternion of length {norm:.4g}: needs length 1, order x y z w")
        return quat


class LightConfig(FiniteGroup):
    """How light is rendered."""

    renderer: str = AUTO
    """What draws: `mujoco`, or a plug-in such as `raster`; `auto` is `mujoco` on a GPU, else the
    plug-in where there is one. MuJoCo's `classic` renders 8 bits per channel and sample, clipped
    at 1, its `float` unbounded 32-bit linear light; `mujoco` chooses `float` for `hdr` scenes and
    for whatever is too dark or too bright for 8 bits."""

    @property
    def chosen(self) -> bool:
        """Whether the user says how light is drawn; else the scene does."""
        return self.renderer in (CLASSIC, FLOAT)

    def floats(self, hdr: bool) -> bool:
        """Whether a scene is drawn in floating point; `hdr` is what the scene asks for."""
        return self.renderer == FLOAT or (not self.chosen and hdr)


class ReplayConfig(FiniteGroup):
    """A recorded trajectory instead of the scene's own motion."""

    trajectory: Path | None = None
    """Poses in TUM format, `t_s x y z qx qy qz qw`; by default the scene's own motion."""

    sha256: str = ""
    """SHA-256 of the file: recorded by the simulation; if given, any other file is refused."""

    place: Literal["start", "level", "world"] = "start"
    """Placement: `start` puts its first pose onto the scene's; `level` does, too, but keeps the
    recording's tilt (its world's z must be up); `world` uses the recorded world as the scene's."""

    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the placed positions, in the scene's axes, m."""

    heading_deg: float = 0.0
    """Turns the path about the vertical through its start, deg, counter-clockwise from above."""

    scale: Positive = 1.0
    """Factor on the recorded positions."""

    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Where to begin, s after the first pose."""

    position_hz: Positive = 10.0
    """Smoothing of positions: -3 dB at this frequency, Hz."""

    rotation_hz: Positive = 10.0
    """Smoothing of rotations: -3 dB at this frequency, Hz."""

    max_gap_s: Positive = 0.05
    """Refuse longer gaps between poses, s; shorter ones are interpolated."""

    max_speed_m_s: Positive = 12.0
    """Refuse faster motion between two poses, m/s, before scaling."""

    max_rate_rad_s: Positive = 20.0
    """Refuse faster rotation between two poses, rad/s."""

    hand_eye: Path | None = None
    """Hand-eye calibration from the recorded body to camera 0: JSON or YAML with `T_body_cam`, or
    TUM-VIE's mocap-imu calibration together with `imu_cam`; by default the poses are camera 0's.
    """

    imu_cam: Path | None = None
    """TUM-VIE's camera calibration, with `T_imu_cam`, see `hand_eye`."""


class ModelConfig(ParameterGroup):
    """A model file that is used instead of a scene; see the page `howto_model`."""

    mount: str = ""
    """What carries the rig, or where its motion begins: a body, site or camera of the model, such
    as `head` or `site:head`; by default its first camera, where there is one."""

    motion: str = ""
    """What moves: `dynamics` for the model's own, a table (.csv) with columns `t_s` and names of
    joints, or a head style such as `walk` from the mount on."""

    controller: Annotated[str, RUNS_CODE] = ""
    """`MODULE:FUNCTION` called with model and data before each step of `dynamics`."""

    key: str = ""
    """Key frame of the model to begin with."""

    headlight: Literal["fixed", "carried"] = "fixed"
    """MuJoCo's headlight stays where the rig begins, or is a lamp that the rig carries."""

    files: tuple[str, ...] = ()
    """Hash and name of each file that the model is made of: written by the simulation."""

    sha256: str = ""
    """Hash over these: written by the simulation, and checked where it is given."""


class PixelConfig(FiniteGroup):
    """How light becomes events, wherever the light comes from."""

    contrast_threshold_pos: Threshold = 0.2
    """C+: rise of log intensity per positive event, natural logarithm."""

    contrast_threshold_neg: Threshold = 0.2
    """C-: fall of log intensity per negative event, natural logarithm."""

    refractory_period_us: Annotated[int, Field(ge=0)] = 0
    """A pixel stays silent this long after an emitted event, µs."""

    log_eps: Annotated[float, Field(gt=0)] = 0.02
    """Added to linear intensity (full scale 1) before the logarithm: bounds contrast in the dark.

    At 0.02 one of the renderer's 255 grey levels stays below the default thresholds even in black.
    """

    sensor: SensorConfig = SensorConfig()
    """Noise, mismatch, bandwidth, latency and read-out; a preset sets thresholds not given."""

    @model_validator(mode="after")
    def _thresholds_of_preset(self) -> PixelConfig:
        for name, value in find_preset(self.sensor.preset).thresholds.items():
            if name not in self.model_fields_set:
                # Not marked as set: a file's own value still beats a flag's preset.
                self.__dict__[name] = value
        if isinstance(self.sensor.preset, Path):
            self.__dict__["sensor"] = self.sensor.expanded()
        return self


class SimConfig(PixelConfig):
    """How frames are sampled and turned into events; defaults are the benchmark's."""

    sampling: SamplingName = "accurate"
    """Light between two frames: `accurate` and `fast` move the light of fine frames along the image
    motion, `linear` blends frames that are close together.
    """

    max_displacement_px: Annotated[float, Field(gt=0, le=64)] | None = None
    """Largest motion of any pixel between two frames, px; by default 12, and 0.5 if `sampling` is
    `linear`; at most 8 where bodies move."""

    supersample: Annotated[int, Field(ge=1, le=16)] | None = None
    """Render samples per pixel and axis; by default as many as `sampling` needs at the rig's focal
    lengths, and 2 if it is `linear`."""

    light: LightConfig = LightConfig()
    """How light is rendered, see the page `simulator`."""

    frames: FramesConfig = FramesConfig()
    """Frames of an ordinary camera in each event camera's place, see the page `simulator`."""

    imu: ImuConfig = ImuConfig()
    """Inertial samples, see the page `howto_model`."""

    replay: ReplayConfig = ReplayConfig()
    """A recorded trajectory instead of the scene's own motion, see the page `howto_model`."""

    model: ModelConfig = ModelConfig()
    """Where the rig sits on a model of your own, and what moves it."""

    frame_period_us: Annotated[int, Field(ge=1)] | None = None
    """Also render a frame at every multiple of this time, µs, as an event camera in a running
    simulation does that is stepped so often."""

    pose_rate_hz: Annotated[float, Field(gt=0)] = 1000.0
    """Stored poses per second, Hz."""

    truth_interval_s: Annotated[float, Field(gt=0)] = 0.05
    """Time between stored depth maps and frames, s; also stored at the start, middle and end."""

    truth_times_s: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """Additional times at which ground truth is stored, s."""

    truth: tuple[TruthName, ...] = ()
    """Ground truth other than depth: at the stored times, and `event_depth` for every event."""

    duration_s: Annotated[float, Field(gt=0)] | None = None
    """Length of the sequence, s; by default the scene's own."""

    min_frame_interval_us: Annotated[int, Field(ge=1)] = 20
    """Least time between frames, µs, except at truth times; faster motion is refused."""

    max_frame_interval_us: Annotated[int, Field(ge=1)] | None = None
    """Longest time between frames, µs, however slow the motion; by default 50 000, and 10 000 if
    `sampling` is `linear`."""

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

    def check_heeded(self) -> None:
        """Refuses settings of pictures, inertial samples or replay that have no effect.

        Not a validator: a scene has a frame rate of its own, and a file and flags come in parts.

        Raises:
            InputError: names the first of them.
        """
        for group, switch in (("frames", "rate_hz"), ("imu", "rate_hz"), ("replay", "trajectory")):
            settings: ParameterGroup = getattr(self, group)
            if getattr(settings, switch):
                continue
            for name, value in settings.__repr_args__():
                if name != switch:
                    raise InputError(
                        f"{group}.{name} {shown(value)} has no effect without {group}.{switch}: "
                        "set that one too, or leave this one out"
                    )


class VideoConfig(FiniteGroup):
    """When the frames of a video were taken, and what light their values stand for."""

    rate_hz: Positive | None = None
    """Frames per second, Hz, instead of the times that the video or the folder states."""

    slow_motion: Positive = 1.0
    """How many times slower than life the video file plays: its times are divided by this."""

    stamps: Path | None = None
    """File of the images' times, lines `t` or `t name`, instead of the folder's own."""

    unit: Literal["s", "ms", "us", "ns"] | None = None
    """Unit of these times; without it, a decimal point or a header must show it."""

    encoding: Encoding | None = None
    """What light values stand for: `srgb`, `gamma`, `linear`, or `log`, its natural logarithm; by
    default `srgb` where they are whole numbers, and `linear` where they are floats."""

    gamma: Positive | None = None
    """Exponent of the encoding `gamma`: light is value ** gamma; by default 2.2."""

    full_scale: Positive | None = None
    """Value of intensity 1; by default 255, 65535, or 1 of floats. 12 bits in 16 need 4095."""

    upsample: Annotated[str | None, RUNS_CODE] = None
    """Function that interpolates frames: MODULE:FUNCTION, FILE.py:FUNCTION, or the name under which
    a package registered one."""

    @model_validator(mode="after")
    def _of_use(self) -> VideoConfig:
        if self.gamma is not None and self.encoding != "gamma":
            raise ValueError(f"gamma={self.gamma:g} has no effect unless encoding is gamma")
        if self.encoding == "log" and self.full_scale is not None:
            raise ValueError("full_scale has no effect on logarithms: leave it out")
        if self.rate_hz is not None and (self.stamps is not None or self.unit is not None):
            raise ValueError("rate_hz, and stamps or unit, both set the times: leave one out")
        return self
