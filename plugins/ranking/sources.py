"""What a ranking is made of: results of suites, scores by case and seed, data of former pages."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.eval.results.results import (
    DEFAULT_MAPPER,
    JSON_NAME,
    SUITE_NAME,
    Results,
    read_results,
    shown_name,
)
from eventsweep.eval.results.table import EVENTS, POOLED, each, together
from eventsweep.plugins.ranking.entries import (
    DATA_NAME,
    RankedCase,
    RankingEntry,
    by_method,
    entry_of,
    is_ranked,
    read_data,
)
from eventsweep.plugins.ranking.tracks import OTHERS, found_in

if TYPE_CHECKING:
    import pandas as pd

_SEED = re.compile(r"seed(\d{1,18})")


class Source(NamedTuple):
    """A result: its entries, and the folder that may hold pictures."""

    folder: Path
    entries: tuple[RankingEntry, ...]


class Scored(NamedTuple):
    """Results, and the seed of what was scored; None where its rows say it."""

    seed: int | None
    results: Results


def read_source(asked: str) -> Source:
    """Reads `LABEL=RESULT` or `RESULT`.

    That is a suite's result; a folder with scores as `CASE/seedN/results.json`, which enter the
    tracks beside the suite's; or a `ranking.json` of several.
    """
    label, equals, place = asked.partition("=")
    path = Path(asked)
    if equals and label and place and "/" not in label and not path.exists():
        path = Path(place)
    else:
        label = ""
    folder = path if path.is_dir() else path.parent
    if path.name == DATA_NAME or (path / DATA_NAME).is_file():
        if label:
            raise InputError(f"{asked}: a {DATA_NAME} has labels of its own; leave {label}= out")
        return Source(folder, read_data(path).entries)
    label = label or folder.resolve().name
    if path.name == SUITE_NAME or (path / SUITE_NAME).is_file():
        entries = read_results(path, lambda result: _of_suite(result, label))
        return Source(folder, entries)
    found = list(_scored(path))
    if not found:
        raise InputError(
            f"{path}: not the result of a suite; needs {SUITE_NAME} or {DATA_NAME} in it, or "
            f"scores of a track as CASE/seedN/{JSON_NAME}"
        )
    if not (entries := tuple(track_entries(found, label))):
        needed = ", ".join(track.ranked_by for track in OTHERS.values())
        raise InputError(f"{path}: its scores enter no track: needs one of {needed}")
    return Source(folder, entries)


def _of_suite(result: Results, label: str) -> tuple[RankingEntry, ...]:
    """The suite's own track, and dense depth if its scores have it."""
    return entry_of(result, label), *track_entries([Scored(None, result)], label)


def _scored(folder: Path) -> Iterator[Scored]:
    for path in sorted(folder.glob(f"*/*/{JSON_NAME}")):
        if seed := _SEED.fullmatch(path.parent.name):
            yield Scored(int(seed[1]), read_results(path))


def track_entries(found: Sequence[Scored], label: str) -> Iterator[RankingEntry]:
    """An entry for each track beside the suite's that these scores enter."""
    rows = together([_rows(one) for one in found])
    for track in found_in(rows["metric"]):
        yield _entry(track, found, rows[rows["metric"].isin(OTHERS[track].metrics)], label)


def _rows(one: Scored) -> pd.DataFrame:
    """Numbers of whole cases, with a seed each."""
    rows = one.results.rows
    rows = rows[(rows["window"] == POOLED) & (rows["method"] != EVENTS)]
    mappers = one.results.definition.get("mappers", {DEFAULT_MAPPER: {}})
    names = {method: shown_name(method, mappers) for method in dict.fromkeys(rows["method"])}
    rows = rows.assign(method=rows["method"].map(names))
    return rows if one.seed is None else rows.assign(seed=one.seed)


def _entry(track: str, found: Sequence[Scored], rows: pd.DataFrame, label: str) -> RankingEntry:
    rows, last = rows.dropna(subset=["seed"]), found[-1].results
    sequences = {
        (sample.case, sample.seed if one.seed is None else one.seed): sample.sequence
        for one in found
        for sample in one.results.samples
    }
    seeds = tuple(sorted({int(seed) for seed in rows["seed"]}))
    cases = {
        case: RankedCase(
            scene=case,
            ranked=is_ranked(last.definition, case),
            sequences=tuple(sequences.get((case, s), "") for s in seeds),
        )
        for case in dict.fromkeys(rows["case"])
    }
    known = {name: text for one in found for name, text in one.results.metrics.items()}
    return RankingEntry(
        label=f"{label}, {track}",
        track=track,
        suite=last.suite,
        digest=last.digest,
        archive=last.archive,
        seeds=seeds,
        cases=cases,
        units={row.metric: (row.unit, row.direction) for row in each(rows)},
        versions_of_metrics={n: known[n] for n in OTHERS[track].metrics if n in known},
        values=by_method(rows, seeds),
        versions=last.versions,
        platform=last.platform,
    )
