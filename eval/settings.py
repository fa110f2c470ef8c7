"""A run's whole configuration: flag beats file beats default; unknown keys are refused."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from emvs.config import MapperConfig
from emvs.errors import InputError
from emvs.parameters import explain
from eval.config import EvalConfig
from sim.config import SimConfig

Group = TypeVar("Group", bound=BaseModel)


class Settings(BaseModel):
    """One group per stage; the tables of a configuration file have the same names."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sim: SimConfig = SimConfig()
    map: MapperConfig = MapperConfig()
    score: EvalConfig = EvalConfig()

    def to_toml(self) -> str:
        """The configuration as a file that `--config` takes; unset values are left out."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))


def load(file: Path | None, **flags: BaseModel) -> Settings:
    """Joins a configuration file and the groups given by flags.

    Args:
        file: TOML with tables named as the fields of `Settings`; None for none.
        flags: per group, a model in which exactly the values given as flags are set.

    Raises:
        InputError: an unreadable file, an unknown key or an impossible value.
    """
    values = _read(file)
    for name, group in flags.items():
        values[name] = _joined(_table(file, values, name), group.model_dump(exclude_unset=True))
    try:
        return Settings.model_validate(values)
    except ValidationError as error:
        raise InputError(explain(error, Settings, f"{file}: " if file else "")) from error


def _read(file: Path | None) -> dict[str, Any]:
    if file is None:
        return {}
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); needs a TOML file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
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
