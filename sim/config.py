"""Every parameter of the simulator, in one place."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from emvs.parameters import ParameterGroup
from sim.frames_config import FramesConfig
from sim.imu_config import ImuConfig
from sim.light import LightConfig
from sim.presets import PRESETS, SensorConfig
from sim.replay_config import ReplayConfig

TruthName = Literal["flow", "segmentation", "boundary", "twist", "event_depth"]
"""Ground truth on request, see docs/truth.md."""


class SimConfig(ParameterGroup):
    """How frames are sampled and turned into events; defaults are the benchmark's."""

    model_config = ConfigDict(allow_inf_nan=False)

    contrast_threshold_pos: Annotated[float, Field(gt=0)] = 0.2
    """C+: rise of log intensity per positive event, natural logarithm."""

    contrast_threshold_neg: Annotated[float, Field(gt=0)] = 0.2
    """C-: fall of log intensity per negative event, natural logarithm."""

    refractory_period_us: Annotated[int, Field(ge=0)] = 0
    """A pixel stays silent this long after an event that it emitted, µs."""

    log_eps: Annotated[float, Field(gt=0)] = 0.02
    """Added to linear intensity (full scale 1) before the logarithm: bounds contrast in the dark.

    At 0.02 one of the renderer's 255 grey levels stays below the default thresholds even in black.
    """

    sensor: SensorConfig = SensorConfig()
    """Noise, mismatch, bandwidth, latency and read-out; a preset sets thresholds not given."""

    max_displacement_px: Annotated[float, Field(gt=0)] = 0.5
    """No pixel of any camera moves further than this between two frames, px."""

    supersample: Annotated[int, Field(ge=1, le=8)] = 2
    """Each pixel is the mean of this many squared render samples."""

    light: LightConfig = LightConfig()
    """How the pictures' light is measured, see docs/light.md."""

    frames: FramesConfig = FramesConfig()
    """Pictures of an ordinary camera in each event camera's place, see docs/light.md."""

    imu: ImuConfig = ImuConfig()
    """Inertial samples, see docs/motion.md."""

    replay: ReplayConfig = ReplayConfig()
    """A recorded trajectory instead of the scene's own motion, see docs/motion.md."""

    pose_rate_hz: Annotated[float, Field(gt=0)] = 1000.0
    """Stored poses per second, Hz."""

    truth_interval_s: Annotated[float, Field(gt=0)] = 0.05
    """Depth and a frame are stored this often, and at the start, middle and end, s."""

    truth_times_s: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """More times at which ground truth is stored, s."""

    truth: tuple[TruthName, ...] = ()
    """Ground truth beside depth: at the stored times, and `event_depth` for every event."""

    duration_s: Annotated[float, Field(gt=0)] | None = None
    """Length of the sequence, s; None takes the scene's own."""

    min_frame_interval_us: Annotated[int, Field(ge=1)] = 20
    """Frames are never closer than this, µs, but for truth times; faster motion is refused."""

    max_frame_interval_us: Annotated[int, Field(ge=1)] = 10_000
    """Frames are never further apart than this, µs, however slow the motion."""

    @model_validator(mode="after")
    def _thresholds_of_preset(self) -> SimConfig:
        for name, value in PRESETS[self.sensor.preset].thresholds.items():
            if name not in self.model_fields_set:
                # Not marked as set: a file's own value still beats a flag's preset.
                self.__dict__[name] = value
        return self

    @model_validator(mode="after")
    def _ordered_intervals(self) -> SimConfig:
        if self.min_frame_interval_us > self.max_frame_interval_us:
            raise ValueError(
                f"min_frame_interval_us={self.min_frame_interval_us} exceeds "
                f"max_frame_interval_us={self.max_frame_interval_us}: lower the first"
            )
        return self
