"""Geometries as `score` takes them, for the group `eventsweep.scorers`; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.geometry.config import (
    DEPTH_SUFFIXES,
    OTHER_SUFFIXES,
    SUFFIXES,
    GeometryConfig,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eventsweep.eval.cli.console import Console, Part
    from eventsweep.plugins.geometry.page import WrittenGeometries
    from eventsweep.plugins.geometry.score import Align

Config = GeometryConfig


def takes(scored: str) -> bool:
    """Whether `FILE` or `NAME=FILE` is a geometry, or a depth map, by its name."""
    return Path(scored).suffix.lower() in (*SUFFIXES, *OTHER_SUFFIXES, *DEPTH_SUFFIXES)


def check(scored: str) -> None:
    """Refuses a file that cannot be scored, as far as no truth is needed."""
    _refuse_depth((scored,))
    from eventsweep.plugins.geometry.readers import read_geometry

    read_geometry(scored, GeometryConfig())


def score(
    scored: tuple[str, ...], truth: Path, out: Path | None, console: Console, *,
    config: GeometryConfig, align: str | None, case: str | None, force: bool, command: str,
) -> None:  # fmt: skip
    """Scores geometries against a sequence; prints a table, and writes a folder if asked."""
    _refuse_depth(scored)
    from eventsweep.eval.results.results import to_json
    from eventsweep.plugins.geometry.output import score_files

    written = score_files(
        scored, truth, out, config, align=cast("Align", align or "none"), case=case, force=force,
        command=command, progress=console.progress,
    )  # fmt: skip
    console.result(to_json(written.results), _printed(written))
    for note in written.notes:
        console.warn(note)
    if out is not None:
        console.wrote(out / "report.html")


def _refuse_depth(scored: tuple[str, ...]) -> None:
    for one in scored:
        suffix = Path(one).suffix.lower()
        if suffix in DEPTH_SUFFIXES:
            kept = "npz" if suffix == ".pfm" else suffix[1:]
            raise InputError(
                f"{one}: depth is scored in its view: give a map's folder instead, without "
                f"--truth, and --prediction NAME=DIR with the depth as DIR/TIME_US.{kept}"
            )


def _printed(written: WrittenGeometries) -> Iterator[Part]:
    from eventsweep.eval.cli.console import table

    for title, heads, lines in written.tables():
        yield table(title, heads, lines)
    yield written.how
