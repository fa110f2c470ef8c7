"""Which settings of results differ: simulator, mapper, scores, data, methods, versions."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import BaseModel

from eventsweep.eval.config import Settings
from eventsweep.eval.report.compare.results import ComparedResult, windows_text

ABSENT = "–"
_UNIT = re.compile(r"\[([^\]]+)\][.;]")
_HASH, _LONG = 12, 50
_ENDINGS = {
    "events_per_s": "1/s", "rows_per_s": "1/s", "rad_s": "rad/s", "m_s": "m/s", "us": "µs",
    "s": "s", "m": "m", "px": "px", "hz": "Hz", "percent": "%", "percentile": "%", "deg": "°",
}  # fmt: skip
_GROUPS = ("map", "sim", "rig", "scene", "windows", "score")
_KNOWN_TO_SOME = ("scene", "renderer", "windows", "methods scored", "seeds")


@dataclass(frozen=True)
class Setting:
    """One setting of all results.

    Attributes:
        name: dotted, as in a configuration file, such as `map.planes`.
        unit: of its values; empty where it has none.
        cases: that it is of; empty where it is the same for all cases.
        texts: per result its value; `–` where it has none, or not this case.
        default: the value that stands where none is stated; None where there is none.
        chosen: whether somebody sets it. Of what is merely known, such as a hash, it is no
            difference that only one result knows it.
    """

    name: str
    unit: str
    cases: tuple[str, ...]
    texts: tuple[str, ...]
    default: str | None
    chosen: bool = True

    @property
    def differs(self) -> bool:
        """Whether two results have different values."""
        return len({text for text in self.texts if self.chosen or text != ABSENT}) > 1

    @property
    def labelled_texts(self) -> tuple[str, ...]:
        """The values; what is the default is marked as such."""
        return tuple(f"{text} (default)" if text == self.default else text for text in self.texts)

    def change(self) -> str:
        """The setting in a sentence: `map.planes 100 → 20`; of long values only its name."""
        unit = f" {self.unit}" if self.unit else ""
        values = f" {' → '.join(self.texts)}{unit}"
        return self.name + (values if len(values) < _LONG else "")


def settings_of(results: Sequence[ComparedResult]) -> tuple[Setting, ...]:
    """Every setting of every case that all results have, then other differences.

    Values are those in effect, so that it makes no difference whether a default was stated.
    """
    first, *others = results
    names = [case for case in first.names if all(case in other.names for other in others)]
    per_case = {case: [_flat(result, case) for result in results] for case in names}
    return (*_settings(per_case, len(results)), *_circumstances(results, names))


def _settings(per_case: Mapping[str, Sequence[Mapping[str, str]]], count: int) -> Iterator[Setting]:
    keys = dict.fromkeys(
        key for found in per_case.values() for settings in found for key in settings
    )
    for name in sorted(keys, key=_group):
        values: dict[tuple[str, ...], list[str]] = {}
        for case, found in per_case.items():
            texts = tuple(settings.get(name, ABSENT) for settings in found)
            if texts != (ABSENT,) * count:
                values.setdefault(texts, []).append(case)
        # A mapper of a suite has unit and default of all mappers.
        known = re.sub(r"^map \([^.]*\)\.", "map.", name)
        unit, default = _known().get(known, ("", None))
        for texts, cases in values.items():
            where = () if len(values) == 1 else tuple(cases)
            yield Setting(name, unit, where, texts, default, name not in _KNOWN_TO_SOME)


def _group(name: str) -> int:
    """What shapes the maps first: it is what people change."""
    root = name.partition(".")[0].partition(" (")[0]
    return _GROUPS.index(root) if root in _GROUPS else len(_GROUPS)


def _circumstances(results: Sequence[ComparedResult], names: Iterable[str]) -> Iterator[Setting]:
    for case in names:
        firsts = [result.first(case) for result in results]
        for what in ("sequence", "events", "truth"):
            hashes = [getattr(first, what)[:_HASH] or ABSENT for first in firsts]
            yield _plain(f"sha256 of {what}", hashes, case)
    for library in sorted({name for result in results for name in result.versions}):
        yield _plain(library, [_version(result, library) for result in results])
    yield _plain("platform", [result.platform or ABSENT for result in results])


def _version(result: ComparedResult, name: str) -> str:
    """A version; of a stage that had no other one, that of scoring."""
    scoring = name.partition(", ")[0]
    return result.versions.get(name, result.versions.get(scoring, ABSENT))


def _plain(name: str, texts: Sequence[str], *cases: str) -> Setting:
    return Setting(name, "", cases, tuple(texts), None, chosen=False)


def _flat(result: ComparedResult, name: str) -> dict[str, str]:
    case = result.first(name)
    seeds = (ABSENT if seed is None else str(seed) for seed in result.seeds(name))
    return {
        **dict(_leaves("", case.settings)),
        "windows": windows_text(case.times) if case.times else ABSENT,
        "methods scored": ", ".join(case.methods),
        "seeds": ", ".join(seeds),
    }


def _leaves(prefix: str, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _leaves(f"{prefix}{name}.", value)
        else:
            yield f"{prefix}{name}", _text(value)


def _text(value: Any) -> str:
    """A value as a configuration file would have it, without quotes."""
    if value is None:
        return "unset"
    if isinstance(value, str):
        return value
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, list) and not any(isinstance(item, list | dict) for item in value):
        return ", ".join(map(_text, value)) or "none"
    return json.dumps(value, ensure_ascii=False)


@cache
def _known() -> dict[str, tuple[str, str | None]]:
    defaults = dict(_leaves("", Settings().model_dump(mode="json")))
    return {name: (unit, defaults.get(name)) for name, unit in _units("", Settings)}


def _units(prefix: str, group: type[BaseModel]) -> Iterator[tuple[str, str]]:
    for name, field in group.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _units(f"{prefix}{name}.", kind)
            continue
        described = _UNIT.search(field.description or "")
        ending = next((ending for ending in _ENDINGS if name.endswith(f"_{ending}")), "")
        yield f"{prefix}{name}", described[1] if described else _ENDINGS.get(ending, "")
