"""`eventsweep check`: why is the map of my recording garbage?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.eval.cli.app import CONFIGURED, MAP, Configured, Force, MapFlags

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.diagnose.check.findings import Report

SOUND, WRONG = 0, 1
_STYLES = {"good": "green", "doubtful": "yellow", "wrong": "bold red"}


def check(
    recording: Path,
    /,
    *,
    out: Path | None = None,
    mapping: Annotated[bool, Parameter(negative="--no-mapping")] = True,
    force: Force = False,
    common: Configured = CONFIGURED,
    map: MapFlags = MAP,  # noqa: A002 - the name is the flag's prefix
) -> int:
    """Find faults in a recording's events, poses, calibration and conventions.

    Exit code 1 if something is wrong. Of the mapper's parameters, only depth range, window and
    threads have an effect.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag or a recording.toml.
        out: Folder to write: report.html, with evidence and cures, and check.json.
        mapping: Also map it with other settings: cameras swapped, poses inverted, clocks shifted,
            other axes.
    """
    from eventsweep.emvs.errors import InputError
    from eventsweep.emvs.utils.outputs import atomic_dir, check_output
    from eventsweep.eval.progress import checking
    from eventsweep.plugins.diagnose.check import recording as checks
    from eventsweep.plugins.diagnose.check_page import write_check_page

    if force and out is None:
        raise InputError("--force without --out has no effect: add --out, or leave it out")
    settings = common.settings(map=map)
    if out is not None:
        check_output(out, force=force)
    console = common.console()
    with console.progress.stage("check", 1.0) as update:
        report = checks.check(recording, settings.map, mapping=mapping, progress=checking(update))
    if out is not None:
        with atomic_dir(out, force=force, inputs=(recording,)) as folder:
            write_check_page(folder, report)
    console.result(report.to_json(), _summary(report))
    if out is not None:
        console.wrote(out / "report.html")
    return WRONG if report.verdict == "wrong" else SOUND


def _summary(report: Report) -> Iterator[Part]:
    from rich.text import Text

    from eventsweep.eval.cli.console import dim, table
    from eventsweep.eval.cli.flag_names import with_flags

    rows = (
        (
            finding.name,
            Text(finding.verdict, _STYLES[finding.verdict]),
            with_flags(finding.evidence),
        )
        for finding in report.findings
    )
    yield table(f"check of {report.name}", ("what", "verdict", "evidence"), rows)
    for finding in (*report.of("wrong"), *report.of("doubtful")):
        yield with_flags(finding.line())
    for name, why in report.unchecked:
        yield dim(with_flags(f"not checked: {name}, because {why}"))
