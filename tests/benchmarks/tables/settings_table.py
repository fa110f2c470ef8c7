"""The tables of settings in the documentation, from the code: nobody types a default.

`python tests/benchmarks settings_table` writes them; with `--check` it only says which are
stale.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from eventsweep.emvs.config import FocusParameters, LearnedParameters, MapperConfig
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.config import EvalConfig, TrajectoryConfig
from markdown_blocks import refresh
from table_code import Code

TABLES: dict[str, type[BaseModel]] = {
    "docs/mapper.md#settings": MapperConfig, "docs/methods.md#settings": FocusParameters,
    "plugins/learned/learned.md#settings": LearnedParameters,
    "docs/scores.md#settings": EvalConfig, "docs/scores.md#trajectory-settings": TrajectoryConfig,
}  # fmt: skip
"""Page and mark -> what the table is about."""

_HEAD = "| Setting | Default | Values | Meaning |\n|---|---|---|---|\n"


def is_there(page: Path) -> bool:
    """Whether a page should exist: that of a plug-in may have been taken out with its folder."""
    return page.parent.parent.name != "plugins" or page.parent.is_dir()


def settings_block(model: type[BaseModel]) -> str:
    """The table of every field of a group of settings, as Markdown."""
    fields: dict[str, dict[str, Any]] = model.model_json_schema()["properties"]
    return _HEAD + "".join(_line(name, field) for name, field in fields.items())


def _line(name: str, field: Mapping[str, Any]) -> str:
    default, meaning = field["default"], field["description"].replace("|", "\\|")
    if isinstance(default, dict):  # settings of their own
        names = ", ".join(f"`{key}`" for key in default)
        return f"| `{name}` | – | {names} | {meaning} |\n"
    return f"| `{name}` | {_shown(default)} | {_values(field)} | {meaning} |\n"


def _shown(default: object) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, list):
        return ", ".join(f"`{item}`" for item in default) or "–"
    if isinstance(default, str):
        return f"`{default}`"
    return "–" if default is None else f"{default:g}"


def _values(field: Mapping[str, Any]) -> str:
    """Which values a field may have, in few words."""
    kinds = field.get("anyOf", [field])
    kind = {**field, **next(one for one in kinds if one.get("type") != "null")}
    if "enum" in kind:
        return ", ".join(f"`{value}`" for value in kind["enum"])
    if kind.get("format") == "path":
        return "file"
    if kind.get("items", {}).get("type") == "number":
        return "numbers, > 0"
    words = {
        "string": "name",
        "integer": "whole",
        "number": "number",
        "array": "names",
        "boolean": "true, false",
    }
    limits = {
        "minimum": "≥ {:g}", "exclusiveMinimum": "> {:g}", "maximum": "≤ {:g}",
        "exclusiveMaximum": "< {:g}",
    }  # fmt: skip
    bounds = [limit.format(kind[name]) for name, limit in limits.items() if name in kind]
    return ", ".join([words.get(kind.get("type", ""), "group"), *bounds])


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return dict.fromkeys(TABLES, Code())


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes or checks the tables; 1 where a check finds one stale, 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks settings_table", description=__doc__
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    parser.add_argument("--check", action="store_true", help="write nothing")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        ended.value = max(
            refresh(
                asked.folder / page,
                mark,
                settings_block(model),
                code,
                check=asked.check,
                command="python tests/benchmarks settings_table",
            )
            for (page, _, mark), model in zip(
                (name.partition("#") for name in TABLES), TABLES.values(), strict=True
            )
            if is_there(asked.folder / page)
        )
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
