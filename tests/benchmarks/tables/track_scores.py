"""Scores `eventsweep track` on noisy twins: `python tests/benchmarks track_scores --out FOLDER`.

Simulates each twin, tracks it by the verb, and scores its poses against the true ones. A finished
row is kept, so that the command can be interrupted; after a change of the program take another
folder. With `--page docs/odometry.md` the table is written into the page.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np

import eventsweep as es
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.odometry.tracker import Status
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.exit_codes import INTERRUPTED, exit_code
from eventsweep.eval.cli.main import main as eventsweep
from markdown_blocks import show

MARK = "track-scores"
TWINS = (("desk", "davis346"), ("mvsec-flying", "davis346"), ("rpg-boxes", "davis240"))
OPENED = frozenset({0, 1})
"""Seeds that were looked at while the tracker was built."""
_WARM_US = 300_000
_TRACKED, _ENDED_LOST = 0, 1  # exit codes of the verb
_NEVER_BEGAN = "found no place to begin"


@dataclass(frozen=True)
class Twin:
    """One simulated sequence."""

    scene: str
    sensor: str
    seed: int
    seconds: float

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.scene}-{self.sensor}-{self.seed}-{self.seconds:g}s"


@dataclass(frozen=True)
class Row:
    """What tracking a twin gave.

    Attributes:
        twin: which.
        failure: why there are no poses, or nothing.
        ate_m: root mean square of the errors of position after rigid alignment.
        ate_percent: the same, of the true way.
        covered_percent: of the time.
        lost: how often track was lost.
        cpu_s: CPU time of the verb, all threads, kernels compiled.
    """

    twin: Twin
    failure: str
    ate_m: float | None
    ate_percent: float | None
    covered_percent: float
    lost: int
    cpu_s: float


def measured(twins: Sequence[Twin], folder: Path) -> list[Row]:
    """A row per twin; those that the folder holds are not made again.

    Raises:
        InputError: a twin that cannot be simulated, or a damaged row.
    """
    rows, warm = [], False
    for twin in twins:
        kept = folder / f"{twin.name}.json"
        if not kept.exists():
            recording = _simulated(twin, folder)
            if not warm:
                _warm_up(recording)
                warm = True
            row = _tracked(twin, recording, folder / twin.name / "track")
            with atomic_path(kept) as partial:
                partial.write_text(json.dumps(asdict(row), indent=2) + "\n", encoding="utf-8")
        rows.append(_read(kept))
    return rows


def table(rows: Sequence[Row]) -> str:
    """Rows as a table in Markdown, and what those of seeds that were held out come to."""
    lines = [
        "Written by `python tests/benchmarks track_scores`; aligned rigidly; CPU of all threads.",
        "",
        "| Scene | Sensor | s | Seed | Held out | ATE, m | ATE, % of the way | Covered, % | Lost "
        "| CPU s per s |",
        "|---|---|--:|--:|---|--:|--:|--:|--:|--:|",
        *map(_line, rows),
    ]
    held_out = [row for row in rows if row.twin.seed not in OPENED]
    if held_out:
        lines += ["", _summary(held_out)]
    return "\n".join(lines) + "\n"


def _line(row: Row) -> str:
    twin = row.twin
    scores = (
        f"{row.ate_m:.4f} | {row.ate_percent:.2f} | {row.covered_percent:.1f} | {row.lost}"
        if row.ate_m is not None
        else f"– | – | 0 | {row.failure}"
    )
    return (
        f"| `{twin.scene}` | `{twin.sensor}` | {twin.seconds:g} | {twin.seed} "
        f"| {'no' if twin.seed in OPENED else 'yes'} | {scores} | {row.cpu_s / twin.seconds:.1f} |"
    )


def _summary(rows: Sequence[Row]) -> str:
    """Sequences without poses count as worse than any with poses."""
    percent = [np.inf if row.ate_percent is None else row.ate_percent for row in rows]
    median, worst = (
        f"{value:.2f} %" if np.isfinite(value) else "no poses"
        for value in (np.median(percent), np.max(percent))
    )
    kept = sum(not row.failure and not row.lost for row in rows)
    return (
        f"Held-out seeds: ATE {median} of the way in the median, {worst} at worst; track kept "
        f"on {kept} of {len(rows)} sequences."
    )


def _simulated(twin: Twin, folder: Path) -> Path:
    path = folder / twin.name / "recording"
    if not path.exists():
        flags = ("--seconds", f"{twin.seconds:g}", "--seed", str(twin.seed), "--quiet")
        sensor = ("--sim.sensor.preset", twin.sensor)
        code, said = _verb("simulate", twin.scene, "--out", str(path), *sensor, *flags)
        if code:
            raise InputError(f"{twin.name} could not be simulated: {said}")
    return path


def _verb(*arguments: str) -> tuple[int, str]:
    """Exit code of a command, and what it said."""
    said = StringIO()
    with redirect_stderr(said):
        code = eventsweep(arguments)
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code, said.getvalue().strip()


def _warm_up(path: Path) -> None:
    """Loads or compiles the kernels, so that no row's time holds that."""
    recording = es.open_recording(path)
    tracker = es.Tracker(recording.rig, depth_range_m=recording.depth_range_m)
    cameras = range(len(recording.rig))
    first_us = min(recording.event_span_us(k)[0] for k in cameras)
    end_us = first_us + _WARM_US
    tracker.push([recording.events(k, first_us, end_us) for k in cameras], end_us)


def _tracked(twin: Twin, recording: Path, out: Path) -> Row:
    began_s = time.process_time()
    code, said = _verb("track", str(recording), "--out", str(out), "--force", "--quiet")
    cpu_s = time.process_time() - began_s
    if _NEVER_BEGAN in said:
        return Row(twin, "never began", None, None, 0.0, 0, cpu_s)
    if code not in (_TRACKED, _ENDED_LOST):  # a full disk is no result
        raise InputError(f"{twin.name} could not be tracked: {said}")
    values = es.score_trajectory(out, recording).values
    facts = json.loads((out / "track.json").read_text("utf-8"))
    lost = sum(change["status"] == Status.LOST.value for change in facts["changes"])
    ate_m, ate_percent, covered_percent = (
        float(values[metric]) for metric in ("ate_rmse", "ate_share", "time_covered")
    )
    return Row(twin, "", ate_m, ate_percent, covered_percent, lost, cpu_s)


def _read(path: Path) -> Row:
    try:
        stored = json.loads(path.read_text("utf-8"))
        row = Row(**stored)
        return replace(row, twin=Twin(**stored["twin"]))
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: no row of this tool ({error}): remove the file") from error


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences and rows")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--scene", action="append", default=[], help="some of the scenes")
    parser.add_argument("--seeds", default="2-3", help="seeds, such as 0,2-4")
    parser.add_argument("--seconds", type=float, default=1.5, help="length of a sequence, s")
    asked = parser.parse_args(arguments)
    with exit_code() as code:
        seeds = job_flags.seed_numbers(asked.seeds, "--seeds") or ()
        twins = [
            Twin(scene, sensor, seed, asked.seconds)
            for scene, sensor in TWINS
            for seed in seeds
            if not asked.scene or scene in asked.scene
        ]
        show(table(measured(twins, asked.out)), asked.page, MARK)
    return code.value


if __name__ == "__main__":
    raise SystemExit(main())
