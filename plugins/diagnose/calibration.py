"""Refines a recording into a folder: calibration, a window before and after, and the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.eval.progress import Display
from eventsweep.eval.report.html import REPORT_NAME
from eventsweep.plugins.diagnose.calibrate.before_after import before_and_after
from eventsweep.plugins.diagnose.calibrate.folder import write_refined
from eventsweep.plugins.diagnose.calibrate.refine import RefineConfig, Refinement, refine
from eventsweep.plugins.diagnose.calibrate_page import calibration_page, summary


def calibrate_recording(
    recording: Recording, path: Path, out: Path, config: RefineConfig, progress: Display, *,
    force: bool = False, command: str = "",
) -> tuple[Refinement, tuple[str, ...]]:  # fmt: skip
    """Writes a folder with calibration, `recording.toml` and page; notes are on those files."""
    with progress.stage("calibrate", 1.0) as update:
        refinement = refine(recording, config, _moving(update))
        update(1.0, summary(refinement))
    with progress.stage("before and after", 3.0) as update:
        sides = before_and_after(recording, refinement, update)
        with atomic_dir(out, force=force, inputs=(path,)) as folder:
            notes = write_refined(folder, out, recording, refinement, command)
            text = calibration_page(recording, refinement, sides, notes, command, folder)
            (folder / REPORT_NAME).write_text(text, encoding="utf-8")
        update(3.0, "")
    return refinement, notes


def facts_of(refinement: Refinement, notes: Sequence[str]) -> dict[str, Any]:
    """Plain values for `--json`."""
    return {
        "estimates": [estimate.facts() for estimate in refinement.estimates],
        "sharpness": refinement.sharpness.mean(axis=0).tolist(),
        "windows": len(refinement.windows),
        "notes": list(notes),
    }


def _moving(update: Callable[[float, str], None]) -> Callable[[str, int, int], None]:
    """One bar for all stages, whose number is not known: each takes half of what is left."""
    begins: dict[str, float] = {}

    def show(stage: str, done: int, total: int) -> None:
        begin = begins.setdefault(stage, 1 - 0.6 ** len(begins))
        share = min(1.0, done / max(total, 1))
        update(begin + 0.4 * (1 - begin) * share, f"{stage} {done}/{total}")

    return show
