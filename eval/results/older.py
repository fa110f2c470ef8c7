"""Files of results that earlier versions wrote, as today's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

_COLUMNS_OF_1 = {"better": "direction", "points": "support"}


def as_version_3(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a file of results; what is wrong with it is left for the reader to say."""
    version = content["schema_version"]
    if version == 3:
        return content
    if "samples" in content:
        return _of_suite(content, version)
    rows = content["rows"] if version > 1 else rows_of_version_1(content["rows"])
    old = {name: content.pop(name, {}) for name in ("sequences", "metrics")}
    seed = content.pop("seed", None)
    samples = [
        {"case": case, "seed": seed, "sequence": old["sequences"].get(case, ""),
         "metrics": old["metrics"]}
        for case in dict.fromkeys(row["case"] for row in rows)
    ]  # fmt: skip
    return {**content, "samples": samples, "rows": _seeded(rows, seed)}


def _of_suite(content: Mapping[str, Any], version: int) -> dict[str, Any]:
    """Of version 1 every sample held its rows; of both, facts in a group of their own."""
    samples, rows = [], content.get("rows", [])
    for sample in content["samples"]:
        about = {**sample, **sample["facts"]}
        samples.append({name: about[name] for name in about if name not in ("facts", "rows")})
        if version == 1:
            rows = [*rows, *_seeded(rows_of_version_1(sample["rows"]), about["seed"])]
    return {**content, "samples": samples, "rows": rows}


def rows_of_version_1(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a file of version 1, with today's names of columns."""
    return [{_COLUMNS_OF_1.get(name, name): cell for name, cell in row.items()} for row in rows]


def _seeded(rows: Iterable[Mapping[str, Any]], seed: int | None) -> list[dict[str, Any]]:
    return [{**row, "seed": seed if row.get("seed") is None else row["seed"]} for row in rows]
