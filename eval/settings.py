"""A run's whole configuration: flag beats file beats default; unknown keys are refused."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from emvs.config import MapperConfig
from emvs.errors import InputError
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
        raise InputError(explain(error, where=f"{file}: " if file else "")) from error


def explain(error: ValidationError, where: str = "") -> str:
    """The first fault of a pydantic error in one line."""
    fault = error.errors(include_url=False, include_context=False)[0]
    key = ".".join(str(part) for part in fault["loc"])
    if fault["type"] == "extra_forbidden":
        return f"{where}unknown key {key}{_suggestion(fault['loc'])}"
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] == "value_error":
        return f"{where}{message}"
    more = f" ({error.error_count() - 1} more faults)" if error.error_count() > 1 else ""
    return f"{where}{key} is {fault['input']!r}: {message[0].lower()}{message[1:]}{more}"


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


def _suggestion(place: tuple[int | str, ...]) -> str:
    model: Any = Settings
    for group in place[:-1]:
        field = getattr(model, "model_fields", {}).get(str(group))
        model = field.annotation if field else None
    known = list(getattr(model, "model_fields", ()))
    close = difflib.get_close_matches(str(place[-1]), known, n=1)
    return f"; did you mean {close[0]}?" if close else f"; known are {', '.join(sorted(known))}"
