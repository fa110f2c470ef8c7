"""The stage that maps a recording: one window of it, or sliding windows over all of it."""

from __future__ import annotations

from pathlib import Path

from emvs.datasets import open_recording
from emvs.maps.folder import StoredMap
from emvs.maps.sliding import map_windows
from eval.progress import MapBars, Progress, Silent
from eval.scoring import run_folder
from eval.settings import Settings

_SILENT = Silent()


def map_recording(
    path: Path,
    out: Path,
    settings: Settings,
    *,
    force: bool = False,
    report: bool = False,
    progress: Progress = _SILENT,
) -> StoredMap:
    """Maps one window of a recording and writes the map folder, with its own report on request.

    With `window_s` or `window_events` it maps sliding windows: `out` grows window by window, and
    the same call takes up an unfinished one (`emvs.maps.sliding`).

    Raises:
        InputError: what `open_recording` or `map_windows` refuses.
    """
    recording = open_recording(path)
    about = run_folder.describe(recording, path, out)
    with MapBars(progress, f"map {recording.name}") as bars:

        def finish(folder: Path) -> None:
            bars.close()
            if report:
                write_report_stage(folder, progress)

        info = map_windows(recording, out, settings.map, about, bars, force=force, finish=finish)
    return StoredMap(out, info)


def write_report_stage(folder: Path, progress: Progress) -> None:
    """Writes the report, shown as a stage of its own."""
    # Its figures need matplotlib: 0.3 s before the first event, were it imported at the top.
    from eval.report.run_page import write_report

    with progress.stage("report", 1):
        write_report(folder)
