"""A suite: which cases, seeds, windows and methods make one comparable set of numbers.

A suite is data, a TOML file under a name with a version. Its digest is in every result: numbers
of different suites are not comparable, neither better nor worse.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from eventsweep.emvs.config import PLANES
from eventsweep.emvs.data.manifest import FILE_NAME as SEQUENCE_FILE
from eventsweep.emvs.errors import InputError, quoted, shown
from eventsweep.emvs.parameters import FrozenModel, fault, refuse_code
from eventsweep.eval.config import Settings, read_toml
from eventsweep.eval.found_poses import TRACK
from eventsweep.eval.perturbations import amounts
from eventsweep.eval.suite.given import is_given
from eventsweep.sim.mjcf import is_model_file

FOLDER = Path(__file__).parent / "definitions"
GATED = "suite-v5"
"""The suite whose part `quick` gates changes; what is frozen later is named in full."""
ALL = "all"
FROZEN: Mapping[str, Any] = {"planes": PLANES}
"""What mappers of suites set where a definition does not: its meaning stays what it was."""

Condition = Literal["noise", "light", "motion", "occlusion", "geometry"]
"""What is hard about a case: noise of the sensor, light, moving things or fast motion, things in
front of each other, and imperfect geometry."""
_MOST_CHARS = 4096
_LATER = ("imperfection", "conditions", "track", "change", "seeds")
_Name = Annotated[str, Field(pattern=r"^[\w.-]+$")]
_Seeds = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]


class WindowSpec(FrozenModel):
    """A stretch of a sequence, s."""

    start_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(gt=0)]

    def times_us(self, mapper: Mapping[str, Any]) -> tuple[int, int, int]:
        """Begin, end and a mapper's reference view, where truth is rendered, µs."""
        t0_us = round(self.start_s * 1e6)
        t1_us = t0_us + round(self.duration_s * 1e6)
        return t0_us, t1_us, t1_us if mapper.get("reference") == "end" else (t0_us + t1_us) // 2


class CaseSpec(FrozenModel):
    """One scene, rig and length, and how it is mapped.

    `scene` is a name, the file of a model, or the folder of a sequence with truth, which then is
    not simulated, see `eval.suite.given`; `rig` likewise, or the model's own cameras,
    `model:NAME,NAME`; settings of a model's mount and motion are in `sim.model`.
    `imperfection` is what is wrong with the calibration, the poses and the clocks that the mapper
    is given: the name of a preset, kept as what that stands for, or amounts of a `Perturbation`.
    `conditions` say what is hard about it, for tables; they decide no number. With `track`, a
    tracker's name or true for `track`, its poses are found from its events, too, and scored, as are
    maps on them, see `eval.own_poses`. `change` is what a study makes of the scene, see
    `eval.stages.changes`. `seeds` are those of the suite's that it is run with, where fewer do.
    """

    scene: str
    rig: str | None = None
    seconds: Annotated[float, Field(gt=0)]
    windows: Annotated[tuple[WindowSpec, ...], Field(min_length=1)]
    mappers: Annotated[tuple[_Name, ...], Field(min_length=1)] = ("default",)
    sim: dict[str, Any] = Field(default_factory=dict)
    imperfection: Annotated[dict[str, float] | None, BeforeValidator(amounts)] = None
    conditions: tuple[Condition, ...] = ()
    track: bool | str = False
    change: dict[str, float] = Field(default_factory=dict)
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = ()

    @model_serializer(mode="wrap")
    def _without_nothing(self, given: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leaves out what older suites do not say, so that their digests stay."""
        values: dict[str, Any] = given(self)
        return {k: v for k, v in values.items() if k not in _LATER or v}

    @model_validator(mode="after")
    def _windows_inside(self) -> CaseSpec:
        for window in self.windows:
            if window.start_s + window.duration_s > self.seconds + 1e-9:
                raise ValueError(
                    f"window of {window.duration_s:g} s from {window.start_s:g} s: the case has "
                    f"{self.seconds:g} s"
                )
        return self


class Subset(FrozenModel):
    """Some of the cases, with fewer seeds."""

    cases: Annotated[tuple[str, ...], Field(min_length=1)]
    seeds: _Seeds


class Suite(FrozenModel):
    """The whole definition.

    Attributes:
        name: with its version; a changed definition gets another one.
        seeds: of every case.
        spread_seeds: seeds that a baseline measures the spread with; the first ones are `seeds`.
        metrics: what a gate compares.
        speed_case: case whose mapping is timed.
        predictions: per name of a method of others, the folder of its depth maps.
    """

    name: _Name
    summary: str
    seeds: _Seeds
    spread_seeds: _Seeds
    metrics: tuple[str, ...]
    speed_case: str | None = None
    sim: dict[str, Any] = Field(default_factory=dict)
    score: dict[str, Any] = Field(default_factory=dict)
    mappers: dict[str, dict[str, Any]] = Field({"default": {}})
    cases: dict[_Name, CaseSpec]
    subsets: dict[_Name, Subset] = Field(default_factory=dict)
    predictions: dict[_Name, str] = Field(default_factory=dict)

    @model_serializer(mode="wrap")
    def _without_predictions(self, given: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leaves out what older suites do not say, so that their digests stay."""
        values: dict[str, Any] = given(self)
        return {k: v for k, v in values.items() if k != "predictions" or v}

    @model_validator(mode="after")
    def _known(self) -> Suite:
        if self.speed_case is not None:
            _refuse_unknown("speed_case", (self.speed_case,), self.cases)
        for name, subset in self.subsets.items():
            _refuse_unknown(f"subsets.{name}.cases", subset.cases, self.cases)
        for name, case in self.cases.items():
            _refuse_unknown(f"cases.{name}.mappers", case.mappers, self.mappers)
            if case.track and TRACK in case.mappers:
                raise ValueError(
                    f"cases.{name}.mappers: no mapper may be called {TRACK!r} with track = true"
                )
        for name, mapper in self.mappers.items():
            if mapper.get("device") == "auto":
                raise ValueError(
                    f"mappers.{quoted(name)}.device is 'auto', which differs between machines: "
                    "choose cpu or cuda"
                )
        for settings in self._settings():
            refuse_code(Settings, settings)
            Settings.model_validate(settings)
        return self

    def _settings(self) -> Iterator[dict[str, Any]]:
        for settings in self.mappers.values():
            yield {"map": settings, "score": self.score}
        for case in self.cases.values():
            yield {"sim": self.sim_of(case)}

    def subset(self, name: str) -> Subset:
        """Cases and seeds of a subset, or of the whole suite, `all`."""
        if name == ALL:
            return Subset(cases=tuple(self.cases), seeds=self.seeds)
        if name not in self.subsets:
            known = ", ".join([ALL, *self.subsets])
            raise InputError(f"{self.name} has no subset {name!r}: choose one of {known}")
        return self.subsets[name]

    def sim_of(self, case: CaseSpec) -> dict[str, Any]:
        """Simulator settings of a case; truth is rendered at every mapper's reference times."""
        mappers = [self.mappers[name] for name in case.mappers]
        views = product(case.windows, mappers)
        times_s = sorted({window.times_us(mapper)[2] / 1e6 for window, mapper in views})
        length = {"duration_s": case.seconds, "truth_times_s": times_s}
        return {**self.sim, **case.sim, **length}

    def leaves_out(self, case: str, seed: int) -> bool:
        """Whether one of the suite's own seeds is none of the case's.

        A given sequence is the same with every seed: it has the first one alone.
        """
        spec = self.cases[case]
        own = spec.seeds or (self.seeds[:1] if is_given(spec.scene) else ())
        return bool(own) and seed in self.seeds and seed not in own

    def digest_of(self, case: str) -> str:
        """A hash over all that the definition says of a case, its seeds left out."""
        spec = self.cases[case]
        facts = {
            "case": spec.model_dump(mode="json", exclude={"conditions", "seeds"}),
            "sim": self.sim,
            "score": self.score,
            "mappers": {name: self.mappers[name] for name in spec.mappers},
        }
        return _digest(json.dumps(_by_content(facts), sort_keys=True))

    @property
    def digest(self) -> str:
        """A hash over the whole definition, but for where predictions lie."""
        text = self.model_dump_json(exclude={"predictions"})
        content = json.loads(text)
        portable = _by_content(content)
        return _digest(text if portable == content else json.dumps(portable))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _by_content(value: Any) -> Any:
    """The value with files named by what they hold: wherever they lie, they are the same."""
    if isinstance(value, Mapping):
        return {key: _by_content(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_by_content(part) for part in value]
    if isinstance(value, str) and Path(value).is_absolute():
        path = Path(value)
        manifest = path / SEQUENCE_FILE
        held = manifest if manifest.is_file() else path
        if held.is_file():
            return [path.name, hashlib.sha256(held.read_bytes()).hexdigest()]
    return value


def load(name: str) -> tuple[Suite, str]:
    """Finds a suite and one of its subsets.

    The name is `quick` for the gate's subset of that name, `suite-v5` for all of a suite,
    `suite-v5:quick`, or a TOML file, `FILE.toml` or `FILE.toml:quick`.
    """
    place, _, subset = name.partition(":")
    path = Path(place) if place.endswith(".toml") else FOLDER / f"{place}.toml"
    of_gated = (ALL, *read(FOLDER / f"{GATED}.toml").subsets)
    if name in of_gated:
        place, subset, path = GATED, name, FOLDER / f"{GATED}.toml"
    if not path.is_file():
        known = ", ".join([*(() if subset else of_gated[1:]), *installed()])
        raise InputError(f"unknown suite {place!r}: choose one of {known}, or name a TOML file")
    suite = read(path)
    suite.subset(subset or ALL)
    return suite, subset or ALL


def installed() -> list[str]:
    """The names of the suites that come with the program."""
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def check_name(suite: Suite) -> None:
    """Refuses another definition under the name of a suite that comes with the program.

    Whoever reads the name would take its scores for those of that suite.
    """
    if suite.name in installed() and suite.digest != read(FOLDER / f"{suite.name}.toml").digest:
        raise InputError(
            f"a suite of your own is named {suite.name}, but is not the one that comes with the "
            "program: give it another name"
        )


def overview() -> dict[str, str]:
    """Every suite and subset as `load` takes it, and one line on each."""
    found = {}
    for suite in map(read, sorted(FOLDER.glob("*.toml"))):
        found[suite.name] = f"{suite.summary.partition(':')[0]} ({_extent(suite.subset(ALL))})"
        for name, subset in suite.subsets.items():
            short = name if suite.name == GATED else f"{suite.name}:{name}"
            found[short] = f"part of {suite.name} ({_extent(subset)})"
    return found


def _extent(subset: Subset) -> str:
    return f"{len(subset.cases)} cases, {len(subset.seeds)} seeds"


def read(path: Path) -> Suite:
    """Reads a suite's definition; files that it names lie beside it."""
    try:
        return Suite.model_validate(_beside(read_toml(path), path.resolve().parent))
    except ValidationError as error:
        raise fault(error, Settings, f"{path}: ") from error


_NAMING = ("scene", "rig", "sim", "mappers")
"""Keys of a suite, or of its cases, whose texts may name files."""


def _beside(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The values with absolute paths where a text names what lies in the suite's folder."""
    placed = {
        key: _placed(part, folder) if key in _NAMING else part for key, part in values.items()
    }
    cases, predictions = placed.get("cases"), placed.get("predictions")
    if isinstance(predictions, Mapping):
        placed["predictions"] = {
            name: str(folder / place) if isinstance(place, str) else place
            for name, place in predictions.items()
        }
    if isinstance(cases, Mapping):
        placed["cases"] = {
            name: _beside(case, folder) if isinstance(case, Mapping) else case
            for name, case in cases.items()
        }
    return placed


def _placed(value: Any, folder: Path) -> Any:
    if isinstance(value, Mapping):
        return {key: _placed(part, folder) for key, part in value.items()}
    if isinstance(value, list):
        return [_placed(part, folder) for part in value]
    # A name has no suffix and no slash: a file called like a scene is not taken for it.
    if isinstance(value, str) and (Path(value).suffix or "/" in value) and len(value) < _MOST_CHARS:
        place = folder / value
        return str(place) if place.exists() or is_model_file(value) else value
    return value


def _refuse_unknown(where: str, names: tuple[str, ...], known: Mapping[str, Any]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"{where}: no {shown(name)}, choose from {quoted(*known)}")
