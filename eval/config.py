"""A run's whole configuration: flag beats file beats default; imports no numpy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.parameters import FrozenModel, ParameterGroup, fault, refuse_code
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, parse_toml, read_text
from eventsweep.sim.config import SimConfig

RankingMetric = Literal[
    "mean_error", "median_error", "rmse", "abs_rel", "aerr_r", "silog", "bad_published"
]
Alignment = Literal["se3", "sim3", "none"]
Association = Literal["one-to-one", "nearest", "interpolate"]
TimeUnit = Literal["s", "ms", "us", "ns"]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_MOST_NAMED = 3
Group = TypeVar("Group", bound=BaseModel)


class EvalConfig(ParameterGroup):
    """Which ground truth counts, and which number ranks the methods."""

    min_truth_depth_m: float | None = Field(
        default=None,
        gt=0,
        description="Ground truth nearer than this is left out, m; by default no limit.",
    )
    max_truth_depth_m: float | None = Field(
        default=None,
        gt=0,
        description="Ground truth farther than this is left out, m; by default no limit.",
    )
    truth_tolerance_s: float = Field(
        default=0,
        ge=0,
        description="A data set's ground truth this close in time to a reference view, s, is "
        "reprojected into it by the poses; 0: only ground truth of the same time.",
    )
    border_px: int = Field(
        default=0, ge=0, description="Pixels this close to the image border are left out, px."
    )
    boundary_px: int = Field(
        default=2, ge=1, le=100, description="Width of a depth boundary to each side, px."
    )
    edge_contrast: float = Field(
        default=0.1, gt=0, description="Least gradient of log intensity at an edge, 1/px."
    )
    ranking_metric: RankingMetric = Field(
        default="mean_error", description="The metric that orders the methods; lower is better."
    )

    @model_validator(mode="after")
    def _limits_in_order(self) -> EvalConfig:
        near_m, far_m = self.truth_limits_m
        if near_m >= far_m:
            raise ValueError(
                f"min_truth_depth_m {near_m:g} must lie below max_truth_depth_m {far_m:g}"
            )
        return self

    @property
    def truth_tolerance_us(self) -> int:
        """How far a data set's ground truth may lie from a reference view, µs."""
        return round(self.truth_tolerance_s * 1e6)

    @property
    def truth_limits_m(self) -> tuple[float, float]:
        """The closed range of ground-truth depths that are scored, m."""
        near_m = 0.0 if self.min_truth_depth_m is None else self.min_truth_depth_m
        far_m = float("inf") if self.max_truth_depth_m is None else self.max_truth_depth_m
        return near_m, far_m


class TrajectoryConfig(ParameterGroup):
    """How estimated poses are paired with true ones, aligned and compared."""

    align: Alignment = Field(
        default="se3",
        description="How the estimate is aligned with the truth: rigidly, also in scale, or not.",
    )
    associate: Association = Field(
        default="one-to-one",
        description="Which true pose an estimated one is compared with: the closest pairs first; "
        "the nearest; the truth interpolated.",
    )
    max_difference_s: float = Field(
        default=0.02, ge=0, le=1e6, description="Largest time difference of a pair, s."
    )
    offset_s: float = Field(
        default=0, ge=-1e12, le=1e12, description="Added to the estimate's times, s."
    )
    unit: TimeUnit = Field(
        default="s",
        description="Unit of the times in the estimate's file, unless its header says it.",
    )
    truth_unit: TimeUnit = Field(
        default="s", description="Unit of the times in the truth's file, unless its header says it."
    )
    rpe_distances_m: tuple[_Positive, ...] = Field(
        default=(),
        description="Path lengths for relative errors, m; by default 10, 20, ... 50 % of the path.",
    )
    rpe_times_s: tuple[_Positive, ...] = Field(
        default=(0.1, 1.0), description="Durations for relative errors, s."
    )
    rpe_angles_deg: tuple[_Positive, ...] = Field(
        default=(10.0, 30.0), description="Rotations for relative errors, °."
    )

    @property
    def max_difference_us(self) -> int:
        """How far the times of a pair may lie apart, µs."""
        return round(self.max_difference_s * 1e6)

    @property
    def offset_us(self) -> int:
        """What is added to the estimate's times, µs."""
        return round(self.offset_s * 1e6)


class Settings(FrozenModel):
    """One group per stage; the tables of a configuration file have the same names."""

    sim: SimConfig = SimConfig()
    map: MapperConfig = MapperConfig()
    score: EvalConfig = EvalConfig()

    def to_toml(self) -> str:
        """The configuration as a file that `--config` takes; unset values are left out."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))


def load(file: Path | None, **flags: BaseModel) -> Settings:
    """Joins a configuration file, with tables named as the fields of `Settings`, and flags.

    In a group of flags exactly the values that were given are set; a file names no code to run.
    """
    values = _read(file)
    refuse_code(Settings, values, f"{file}: ")
    for name, group in flags.items():
        values[name] = _joined(_table(file, values, name), group.model_dump(exclude_unset=True))
    try:
        return Settings.model_validate(values)
    except ValidationError as error:
        raise fault(error, Settings, f"{file}: " if file else "") from error


def unread(file: Path | None, groups: Sequence[str]) -> list[str]:
    """What a file sets outside the tables `groups`, which a command reads; a line each."""
    reads = ", ".join(f"[{name}]" for name in groups)
    return [
        f"{file}: [{name}] ({_names(table)}) has no effect here: this command reads {reads}"
        for name, table in _read(file).items()
        if name not in groups and table
    ]


def _names(table: Mapping[str, Any]) -> str:
    names = list(table)
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _read(file: Path | None) -> dict[str, Any]:
    return {} if file is None else read_toml(file)


def read_toml(file: Path) -> dict[str, Any]:
    """Reads a TOML file of settings."""
    try:
        return parse_toml(read_text(file, SETTINGS_BYTES))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); needs a TOML file") from error
    except ValueError as error:
        raise InputError(f"{file}: not TOML: {error}") from error


def _table(file: Path | None, values: dict[str, Any], name: str) -> dict[str, Any]:
    table = values.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"{file}: {name} is {table!r}: must be a table, [{name}]")
    return table


def _joined(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Values of both, groups within groups too; `above` wins."""
    both = {**below, **above}
    for name, value in above.items():
        if isinstance(value, dict) and isinstance(below.get(name), dict):
            both[name] = _joined(below[name], value)
    return both
