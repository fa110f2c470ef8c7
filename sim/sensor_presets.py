"""What is imperfect about a sensor, and named sensors; the page `sensor` gives sources."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from eventsweep.emvs.errors import InputError, said
from eventsweep.emvs.parameters import ParameterGroup

PresetName = Literal["ideal", "davis240", "davis346", "gen4", "low-light"]

_Level = Annotated[float, Field(ge=0)] | None
_Share = Annotated[float, Field(ge=0, le=1)] | None


class FiniteGroup(ParameterGroup):
    """A group of parameters in which no number is infinite, or none."""

    model_config = ConfigDict(allow_inf_nan=False)


class SensorConfig(FiniteGroup):
    """Imperfections of the sensor; what is None is taken from the preset, 0 switches it off."""

    preset: PresetName | Path = "ideal"
    """Named sensor, or a file sensor.toml that `eventsweep fit` wrote; other settings override its
    values, and it also sets thresholds not given."""

    lens_blur_px: _Level = None
    """Standard deviation of the lens's Gaussian point spread function, px; acts on light."""

    threshold_sigma: _Level = None
    """Standard deviation of every pixel's own C+ and C-, natural logarithm; drawn once."""

    bandwidth_hz: _Level = None
    """Photoreceptor's cut-off at full-scale intensity, falls with intensity, Hz; 0: unlimited."""

    bandwidth_order: Literal[1, 2] | None = None
    """Poles of the photoreceptor, all at its cut-off."""

    dark_level: Annotated[float, Field(gt=0)] | None = None
    """Intensity below which the dark current keeps cut-off and latency constant."""

    leak_rate_hz: _Level = None
    """Leak events of a pixel in the dark, Hz."""

    leak_light_hz: _Level = None
    """Additional leak events at full-scale intensity, Hz; in proportion to intensity."""

    leak_jitter: Annotated[float, Field(ge=0, le=0.5)] | None = None
    """Standard deviation of the time between leak events, relative to its mean."""

    shot_rate_dark_hz: _Level = None
    """Shot noise events of a pixel in the dark, both polarities together, Hz."""

    shot_rate_bright_hz: _Level = None
    """Shot noise events of a pixel at full-scale intensity and above, Hz; linear in between."""

    shot_pair_rate_hz: _Level = None
    """Inverse of the mean time after which a shot noise event is followed by its opposite, Hz; 0:
    single events."""

    noise_spread_decades: _Level = None
    """Standard deviation over the pixels of the decimal logarithm of leak and shot rates; the rates
    above are the median pixel's. Drawn once."""

    hot_pixel_fraction: _Share = None
    """Share of the pixels that are hot; drawn once."""

    hot_pixel_rate_hz: _Level = None
    """Additional events of a hot pixel, Hz."""

    latency_us: _Level = None
    """Mean time from crossing to read-out request at full-scale intensity, µs; more in the dark."""

    latency_jitter: _Share = None
    """Standard deviation of the latency, relative to its mean."""

    readout_events_per_s: _Level = None
    """Events that the read-out passes on, 1/s; 0: unlimited."""

    readout_rows_per_s: _Level = None
    """Rows that the arbiter selects, 1/s, besides the time for their events; 0: unlimited."""

    readout_queue_events: Annotated[int, Field(ge=1)] | None = None
    """Requests that may wait for the read-out; more are dropped."""

    timestamp_resolution_us: Annotated[int, Field(ge=1)] | None = None
    """Time stamps are multiples of this, rounded down, µs."""

    def resolved(self) -> SensorParameters:
        """The preset's parameters with the given ones in their place.

        Raises:
            InputError: a preset's file that cannot be read.
        """
        given = {f.name: getattr(self, f.name) for f in fields(SensorParameters)}
        given = {name: value for name, value in given.items() if value is not None}
        return replace(find_preset(self.preset).parameters, **given)

    def expanded(self) -> SensorConfig:
        """The same without a file: its values stand here, so that a result says all of them."""
        return SensorConfig(**asdict(self.resolved()))


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """All values of a sensor; names, units and meaning as in `SensorConfig`. Defaults: ideal."""

    lens_blur_px: float = 0.0
    threshold_sigma: float = 0.0
    bandwidth_hz: float = 0.0
    bandwidth_order: int = 1
    # v2e adds 20 of 255 grey levels.
    dark_level: float = 20 / 255
    leak_rate_hz: float = 0.0
    leak_light_hz: float = 0.0
    leak_jitter: float = 0.1
    shot_rate_dark_hz: float = 0.0
    shot_rate_bright_hz: float = 0.0
    shot_pair_rate_hz: float = 0.0
    noise_spread_decades: float = 0.0
    hot_pixel_fraction: float = 0.0
    hot_pixel_rate_hz: float = 0.0
    latency_us: float = 0.0
    latency_jitter: float = 0.0
    readout_events_per_s: float = 0.0
    readout_rows_per_s: float = 0.0
    readout_queue_events: int = 4096
    timestamp_resolution_us: int = 1

    @property
    def ideal_pixels(self) -> bool:
        """Whether the pixels are ESIM's: no blur, mismatch or noise, no limit of bandwidth."""
        return not (
            self.lens_blur_px
            or self.threshold_sigma
            or self.bandwidth_hz
            or self.leaks
            or max(self.shot_rate_dark_hz, self.shot_rate_bright_hz)
            or self.hot_pixel_fraction * self.hot_pixel_rate_hz
        )

    @property
    def leaks(self) -> bool:
        """Whether references fall by themselves, in the dark or in light."""
        return bool(self.leak_rate_hz or self.leak_light_hz)

    @property
    def ideal_readout(self) -> bool:
        """Whether every event comes out at once, at its own microsecond."""
        return not (self.latency_us or self.limited_readout) and self.timestamp_resolution_us == 1

    @property
    def limited_readout(self) -> bool:
        """Whether events wait for each other."""
        return bool(self.readout_events_per_s or self.readout_rows_per_s)


@dataclass(frozen=True, slots=True)
class Preset:
    """A named sensor; `thresholds` are values for fields of `SimConfig` of the same names."""

    summary: str
    parameters: SensorParameters
    thresholds: dict[str, float | int]


def _thresholds(pos: float, neg: float, refractory_us: int) -> dict[str, float | int]:
    return {
        "contrast_threshold_pos": pos,
        "contrast_threshold_neg": neg,
        "refractory_period_us": refractory_us,
    }


_DAVIS240 = SensorParameters(
    threshold_sigma=0.03, bandwidth_hz=300.0, leak_rate_hz=0.1,
    shot_rate_dark_hz=0.4, shot_rate_bright_hz=0.1, hot_pixel_fraction=1e-4, hot_pixel_rate_hz=50.0,
    latency_us=12.0, latency_jitter=0.3, readout_events_per_s=12e6,
)  # fmt: skip
_GEN4 = SensorParameters(
    threshold_sigma=0.02, bandwidth_hz=1000.0, leak_rate_hz=0.02,
    shot_rate_dark_hz=0.2, shot_rate_bright_hz=0.05, hot_pixel_fraction=2e-5,
    hot_pixel_rate_hz=50.0, latency_us=20.0, latency_jitter=0.3,
    readout_events_per_s=1.066e9, readout_queue_events=65536,
)  # fmt: skip
_LOW_LIGHT = SensorParameters(
    threshold_sigma=0.05, bandwidth_hz=30.0, leak_rate_hz=0.1, leak_jitter=0.1,
    shot_rate_dark_hz=5.0, shot_rate_bright_hz=1.25, noise_spread_decades=0.1,
)  # fmt: skip

PRESETS: dict[PresetName, Preset] = {
    "ideal": Preset("ESIM's pixels: no noise, no mismatch, no latency", SensorParameters(), {}),
    "davis240": Preset(
        "DAVIS240C: thresholds of 0.18, noise, mismatch and a latency of 12 µs",
        _DAVIS240,
        _thresholds(0.18, 0.18, 500),
    ),
    "davis346": Preset(
        "DAVIS346: unequal thresholds of 0.143 and 0.225, a latency of 20 µs",
        replace(_DAVIS240, latency_us=20.0),
        _thresholds(0.143, 0.225, 500),
    ),
    "gen4": Preset(
        "Prophesee Gen 4: less noise, more bandwidth, 1.066e9 events/s",
        _GEN4,
        _thresholds(0.2, 0.2, 100),
    ),
    "low-light": Preset(
        "a DAVIS in dim light: 30 Hz of bandwidth, 5 Hz of noise (v2e's `noisy`)",
        _LOW_LIGHT,
        _thresholds(0.2, 0.2, 10_000),
    ),
}


class SensorFile(FiniteGroup):
    """What a file sensor.toml may hold: thresholds, and a table of imperfections."""

    contrast_threshold_pos: Annotated[float, Field(ge=1e-6)] | None = None
    contrast_threshold_neg: Annotated[float, Field(ge=1e-6)] | None = None
    refractory_period_us: Annotated[int, Field(ge=0)] | None = None
    sensor: SensorConfig = SensorConfig()


def find_preset(name: PresetName | Path) -> Preset:
    """A preset by its name, or from a file.

    Raises:
        InputError: a file that is missing, too large, no TOML, or holds something else.
    """
    return read_preset(name) if isinstance(name, Path) else PRESETS[name]


def read_preset(path: Path) -> Preset:
    """The sensor of a file sensor.toml.

    Raises:
        InputError: as `find_preset`.
    """
    from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, also_read, parse_toml, read_text

    also_read(path)  # settings keep its values, not its name
    try:
        table = parse_toml(read_text(path, SETTINGS_BYTES))
    except (OSError, ValueError) as error:
        names = ", ".join(PRESETS)
        raise InputError(
            f"sensor preset {path}: neither one of {names} nor a readable TOML file ({said(error)})"
        ) from error
    try:
        file = SensorFile.model_validate(table)
        if isinstance(file.sensor.preset, Path):
            raise InputError("names another file as its preset; write the values themselves")
    except InputError as error:
        raise InputError(f"sensor preset {path}: {error}") from error
    thresholds = PRESETS[file.sensor.preset].thresholds | {
        name: value for name in SensorFile.model_fields
        if name != "sensor" and (value := getattr(file, name)) is not None
    }  # fmt: skip
    return Preset(f"from {path.name}", file.sensor.resolved(), thresholds)
