"""Results as they are compared: per case and seed its numbers, its data and all its settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from pydantic import BaseModel

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data import manifest as manifests
from eventsweep.emvs.data.manifest import Manifest
from eventsweep.emvs.errors import InputError, refused
from eventsweep.emvs.maps.folder import StoredMap
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.report.ranking import RANKING_COLUMNS
from eventsweep.eval.results.direction import Direction
from eventsweep.eval.results.results import DEFAULT_MAPPER, Results, Sample, read_results
from eventsweep.eval.results.table import MEAN, POOLED, each
from eventsweep.eval.scoring.run_folder import find_maps, recording_path
from eventsweep.eval.suite.definition import FROZEN, WindowSpec

WHOLE = ""
"""What stands in a window's place where only numbers of all windows together are stored."""
_EVENTS, _TRUTH = "cam0/events.h5", "cam0/truth.h5"
_MOST_WINDOWS = 3


class Number(NamedTuple):
    """What a number is about."""

    method: str
    metric: str


class WindowTime(NamedTuple):
    """Where a window lies in its sequence, s."""

    start_s: float
    end_s: float
    reference_s: float


@dataclass(frozen=True)
class CaseResult:
    """One case with one seed.

    Attributes:
        values: per number and window, its value; NaN where it is undefined.
        units: per number, its unit and direction.
        sequence: hash of the sequence that the maps were made from; empty where none is known.
        events: hash of camera 0's events, likewise.
        truth: hash of camera 0's ground truth, likewise.
        metrics: per metric, the hash of what it makes of fixed maps.
        settings: groups of settings, as plain JSON values.
        times: per window, where it lies; empty where it is not known.
    """

    values: Mapping[Number, Mapping[str, float]]
    units: Mapping[Number, tuple[str, Direction]]
    sequence: str = ""
    events: str = ""
    truth: str = ""
    metrics: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    times: Mapping[str, WindowTime] = field(default_factory=dict)

    @property
    def methods(self) -> tuple[str, ...]:
        """Everything that has a number by which methods are ranked."""
        ranked = (number for number in self.values if number.metric in RANKING_COLUMNS)
        return tuple(dict.fromkeys(number.method for number in ranked))


@dataclass(frozen=True)
class ComparedResult:
    """A result, and what pages call it.

    Attributes:
        is_suite: whether it is that of a suite, of which no depth maps are kept.
        cases: per case and seed, what it says; the seed is None where nothing was simulated.
        failures: jobs that failed, with the reason.
        archive: version of the archive whose sequences were used; empty where they were simulated.
    """

    name: str
    folder: Path
    is_suite: bool
    cases: Mapping[tuple[str, int | None], CaseResult]
    versions: Mapping[str, str]
    platform: str = ""
    failures: Mapping[str, str] = field(default_factory=dict)
    archive: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The cases."""
        return tuple(dict.fromkeys(case for case, _ in self.cases))

    def seeds(self, case: str) -> tuple[int | None, ...]:
        """The seeds of a case."""
        return tuple(seed for name, seed in self.cases if name == case)

    def first(self, case: str) -> CaseResult:
        """A case with its first seed: settings and methods are the same for all."""
        return self.cases[case, self.seeds(case)[0]]


def read_compared(paths: Sequence[Path]) -> tuple[ComparedResult, ...]:
    """Reads results of runs or suites, given as files or folders, and names them after folders."""
    if len(paths) < 2:
        raise InputError(f"{len(paths)} result given, needs two or more to compare")
    return tuple(
        read_results(
            path, partial(compared, name=name, folder=path if path.is_dir() else path.parent)
        )
        for path, name in zip(paths, names_of(paths), strict=True)
    )


def names_of(paths: Sequence[Path]) -> list[str]:
    """Names for pages and tables: the folders' own, or longer ones where two are equal."""
    folders = [path.resolve() if path.is_dir() else path.resolve().parent for path in paths]
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [f"{k + 1}: {'/'.join(folder.parts[-2:])}" for k, folder in enumerate(folders)]
    return names


def compared(results: Results, name: str, folder: Path) -> ComparedResult:
    """The numbers of a run or suite, of all its seeds, with settings and windows."""
    maps = {} if results.suite else _maps(folder)
    cases: dict[tuple[str, int | None], CaseResult] = {}
    made: list[tuple[str, Mapping[str, str]]] = []
    for sample in results.samples:
        stored = maps.get(sample.case)
        sample = sample if stored is None else _completed(sample, stored)
        made += [] if stored is None else [("mapping", stored.info.versions)]
        made += [("simulation", sample.versions)]
        rows = results.rows[results.rows["case"] == sample.case]
        if results.suite:
            rows = rows[rows["seed"] == sample.seed]
        cases[sample.case, sample.seed] = CaseResult(
            *_numbers(rows), sample.sequence, sample.events, sample.truth, sample.metrics,
            _settings(results, sample, folder), _times(results, sample),
        )  # fmt: skip
    versions = _with_stages(results.versions, made)
    versions |= {f"code of {stage}": code for stage, code in results.code.items()}
    failures = {job.name: job.failure for job in results.failures}
    archive = results.archive.version if results.archive else ""
    is_suite = bool(results.suite)
    return ComparedResult(
        name, folder, is_suite, cases, versions, results.platform, failures, archive
    )


def _completed(sample: Sample, stored: StoredMap) -> Sample:
    """A sample of a file that said less, with what its map and sequence say."""
    windows = {w.name: (w.t0_us, w.t1_us, w.t_ref_us) for w in stored.info.windows}
    manifest = _manifest(stored, sample.sequence)
    if manifest is None:
        return replace(sample, windows=windows)
    hashes = {name: file.sha256 for name, file in manifest.files.items()}
    events, truth = (hashes.get(name, "") for name in (_EVENTS, _TRUTH))
    return replace(
        sample, windows=windows, events=events, truth=truth, renderer=manifest.renderer,
        versions=manifest.versions,
    )  # fmt: skip


def _settings(results: Results, sample: Sample, folder: Path) -> dict[str, Any]:
    if results.suite:
        what = f"{folder}: the suite's definition is damaged"
        with refused(what, KeyError, TypeError, cure="; run it again"):
            return _suite_settings(results.definition, sample)
    names = results.case_names
    shared = {key: value for key, value in results.configuration.items() if key not in names}
    own = results.configuration.get(sample.case)
    settings = {**shared, **(own if isinstance(own, dict) else {})}
    return settings | ({"renderer": sample.renderer} if sample.renderer else {})


def _times(results: Results, sample: Sample) -> dict[str, WindowTime]:
    """Where the windows lie; an older suite says it in its definition alone."""
    windows: Mapping[str, Sequence[int]] = sample.windows
    if results.suite and not windows:
        spec = results.definition["cases"][sample.case]
        times = (WindowSpec.model_validate(window).times_us({}) for window in spec["windows"])
        windows = {f"w{number:03d}": time for number, time in enumerate(times)}
    return {name: WindowTime(*(t / 1e6 for t in times)) for name, times in windows.items()}


def _numbers(
    rows: pd.DataFrame,
) -> tuple[dict[Number, dict[str, float]], dict[Number, tuple[str, Direction]]]:
    found: dict[Number, dict[str, float]] = {}
    units: dict[Number, tuple[str, Direction]] = {}
    for row in each(rows):
        number = Number(row.method, row.metric)
        found.setdefault(number, {})[row.window] = row.value
        units[number] = row.unit, row.direction
    return {number: _by_window(windows) for number, windows in found.items()}, units


def _by_window(values: Mapping[str, float]) -> dict[str, float]:
    """One value per window; of results without windows, that of all together."""
    single = {name: value for name, value in values.items() if name not in (POOLED, MEAN)}
    return single or {WHOLE: values[MEAN] if MEAN in values else values[POOLED]}


def _maps(folder: Path) -> dict[str, StoredMap]:
    """The maps beside results, if there are any: numbers stand for themselves."""
    try:
        return find_maps(folder)
    except InputError:
        return {}


def _manifest(stored: StoredMap, sequence: str) -> Manifest | None:
    """The manifest of the sequence that was mapped, where it is still there."""
    try:
        found = manifests.read(recording_path(stored))
    except InputError:
        return None
    return found if found.digest() == sequence else None


def _suite_settings(definition: Mapping[str, Any], sample: Sample) -> dict[str, Any]:
    """All settings of a case of a suite, those that its definition leaves to defaults too."""
    spec = definition["cases"][sample.case]
    known = spec["scene"] in scenes.names()
    own_rig = scenes.load(spec["scene"]).rig if known else "the scene's own"
    settings = {"scene": spec["scene"], "rig": spec["rig"] or own_rig, "sim": sample.sim}
    for mapper in spec["mappers"]:
        group = "map" if mapper == DEFAULT_MAPPER else f"map ({mapper})"
        settings[group] = _filled(MapperConfig, {**FROZEN, **definition["mappers"][mapper]})
    settings["score"] = _filled(EvalConfig, definition["score"])
    settings["renderer"] = sample.renderer
    return settings


def _filled(group: type[BaseModel], stated: Mapping[str, Any]) -> Mapping[str, Any]:
    """What is stated and the defaults of the rest; only what is stated if it is unknown today."""
    try:
        return group.model_validate(stated).model_dump(mode="json")
    except InputError:
        return stated


def _with_stages(
    scored: Mapping[str, str], stages: Iterable[tuple[str, Mapping[str, str]]]
) -> dict[str, str]:
    """Versions that scored, and those that mapped or simulated where they are others."""
    versions = dict(scored)
    for stage, made in stages:
        other = {name: text for name, text in made.items() if scored.get(name) != text}
        versions |= {f"{name}, {stage}": text for name, text in other.items()}
    return versions


def windows_text(times: Mapping[str, WindowTime]) -> str:
    """How many windows there are and where the first ones lie, for people."""
    shown = [
        f"{_short(time.start_s)}–{_short(time.end_s)} s at {_short(time.reference_s)} s"
        for time in list(times.values())[:_MOST_WINDOWS]
    ]
    rest = len(times) - len(shown)
    return "; ".join(shown) + (f"; {rest} more" if rest else "")


def _short(time_s: float) -> str:
    """To a tenth of a millisecond: the end lies 1 µs behind the last event."""
    return f"{round(time_s, 4):g}"
