"""The stage that maps a recording: one window of it, or sliding windows over all of it."""

from __future__ import annotations

from pathlib import Path

from emvs.atomic import atomic_dir, refuse_existing
from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.io import open_recording
from emvs.mapper import map_window
from emvs.memory import check_window_fits
from emvs.output import StoredMap, read_map, write_index, write_window
from emvs.sliding import check_settings, described, find_hot, map_windows, without
from emvs.window import choose_window
from eval import folders
from eval.progress import Progress, Silent, mapping
from eval.settings import Settings
from eval.sliding_bar import WindowsBar

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
    the same call takes up an unfinished one (`emvs.sliding`).

    Raises:
        InputError: what `open_recording` or `map_window` refuses, or an existing `out`.
    """
    config, recording = settings.map, open_recording(path)
    if config.slides:
        return _map_sliding(recording, path, out, config, force=force, report=report,
                            progress=progress)  # fmt: skip
    refuse_existing(out, force=force)
    check_settings(recording, config, out)
    chosen = choose_window(recording, config)
    check_window_fits(recording, chosen)
    hot = find_hot(recording, config, chosen.t0_us, chosen.t1_us)
    with atomic_dir(out, force=force) as folder:
        window = folder / "w000"
        with progress.stage(f"map {recording.name}", 1) as update:
            filtered = without(recording, hot)
            show, dsi = mapping(update), window / "dsi"
            result = map_window(filtered, config, show, window=chosen, dsi_dir=dsi)
        with progress.stage("write maps", 1):
            info = write_window(window, result, config, recording.rig.camera_names)
            about = folders.describe(recording, path, out)
            write_index(folder, about, config, [info], described(recording.rig, hot))
        if report:
            write_report_stage(folder, progress)
    return read_map(out)


def _map_sliding(
    recording: Recording, path: Path, out: Path, config: MapperConfig, *,
    force: bool, report: bool, progress: Progress,
) -> StoredMap:  # fmt: skip
    with progress.stage(f"map {recording.name}", 1) as update:
        about, show = folders.describe(recording, path, out), WindowsBar(update)
        map_windows(recording, out, config, about, show, force=force)
    if report:
        write_report_stage(out, progress)
    return read_map(out)


def write_report_stage(folder: Path, progress: Progress) -> None:
    """Writes the report, shown as a stage of its own."""
    # Its figures need matplotlib: 0.3 s before the first event, were it imported at the top.
    from eval.report import write_report

    with progress.stage("report", 1):
        write_report(folder)
