"""What refinement writes: a calibration in the recording's format, and a recording that uses it.

Formats of calibration hold cameras and their poses, but no clock and rarely a hand-eye. So beside
the file in the recording's own format there are `rig.json`, `poses.txt` and a `recording.toml` that
names the recording's event files with their clocks; it opens like any recording. The recording
itself is not touched.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import dsec, opened
from eventsweep.emvs.datasets.custom import FILE_NAME, read_descriptor
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording
from eventsweep.emvs.errors import InputError, check_path
from eventsweep.emvs.formats.calibration_single import is_opencv
from eventsweep.emvs.formats.calibration_values import parsed
from eventsweep.emvs.formats.calibration_writers import (
    write_basalt,
    write_kalibr,
    write_opencv,
    write_rig_json,
)
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.emvs.utils.runtime import Progress, silent, versions
from eventsweep.plugins.diagnose.calibrate.refine import RefineConfig, Refinement, refine

RIG_FILE, POSES_FILE, INFO_FILE = "rig.json", "poses.txt", "refinement.json"
SCHEMA_VERSION = 1
_HASHED_BYTES = 1 << 20


def calibrate(
    recording: Recording | str | Path,
    config: RefineConfig | None = None,
    *,
    out: str | Path | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Refinement:
    """Refines a recording's calibration from its events and poses.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one.
        config: what to refine, and from how many windows; by default stereo rotation and clock.
        out: a folder for the calibration and a `recording.toml` that uses it; by default none.
        force: whether to replace what an earlier call wrote there.
        progress: called with the name of the stage, how much is done and how much there is.

    Returns:
        Corrections with their uncertainties; `applied(recording)` is the refined recording.

    Raises:
        InputError: no poses, nothing to refine, a rig of one camera where two are needed, too short
            a recording, or an output that exists.
    """
    readable = opened(recording)
    inputs = (Path(recording),) if isinstance(recording, str | Path) else ()
    if out is not None:
        check_path("out", out)
        check_output(Path(out), force=force)
    refinement = refine(readable, config, progress)
    if out is not None:
        with atomic_dir(Path(out), force=force, inputs=inputs) as folder:
            write_refined(folder, Path(out), readable, refinement)
    return refinement


def write_refined(
    folder: Path, out: Path, recording: Recording, refinement: Refinement, command: str = ""
) -> tuple[str, ...]:
    """Writes everything but the page into a folder that exists, and returns notes, one line each.

    Paths to the recording's files are relative to `out`, where the folder will be; `command` is for
    the provenance.
    """
    refined = refinement.applied(recording)
    write_rig_json(folder / RIG_FILE, refined.rig)
    write_tum(folder / POSES_FILE, refined.trajectory)
    notes = [*_own_format(folder, recording, refined.rig), *_lost(refinement)]
    notes += _descriptor(folder, out, recording, refinement)
    path = getattr(recording, "path", None)
    place = "" if path is None else str(Path(path).resolve())
    facts = {
        "schema_version": SCHEMA_VERSION,
        "recording": {"name": recording.name, "path": place, **_digest(recording)},
        "command": command,
        "versions": versions(),
        "refine": list(refinement.config.refine),
        "windows_us": [list(span_us) for span_us in refinement.windows],
        "sharpness": refinement.sharpness.tolist(),
        "estimates": [estimate.facts() for estimate in refinement.estimates],
        "notes": notes,
    }
    text = json.dumps(facts, indent=2, allow_nan=False) + "\n"
    (folder / INFO_FILE).write_text(text, encoding="utf-8")
    return tuple(notes)


def _digest(recording: Recording) -> dict[str, str]:
    """A hash of the recording: of its manifest, else of calibration, poses and event files."""
    if isinstance(recording, Sequence):
        return {"manifest_sha256": recording.manifest.digest()}
    hasher = hashlib.sha256(json.dumps(recording.rig.to_json(), sort_keys=True).encode())
    poses = recording.trajectory
    for column in (poses.t_us, poses.positions_m, poses.quats_xyzw):
        hasher.update(column.tobytes())
    for path in sorted({str(source.path) for source in _sources(recording)}):
        hasher.update(_ends(Path(path)))
    return {"sha256": hasher.hexdigest()}


def _ends(path: Path) -> bytes:
    """Length, first and last megabyte of a file, which may hold hours; a folder's is its name."""
    if not path.is_file():
        return path.name.encode()
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        first = file.read(_HASHED_BYTES)
        file.seek(max(0, size - _HASHED_BYTES))
        return str(size).encode() + first + file.read(_HASHED_BYTES)


def _sources(recording: Recording) -> tuple[EventSource, ...]:
    """The recording's event files; none if unknown."""
    if isinstance(recording, PosedRecording):
        return recording.sources
    if isinstance(recording, EventCameraDataset):
        return (EventSource(recording.path / "events.txt"),)
    if isinstance(recording, Sequence):
        folder = recording.path
        return tuple(
            EventSource(folder / f"cam{k}" / "events.h5") for k in range(len(recording.rig))
        )
    return ()


def _descriptor(folder: Path, out: Path, recording: Recording, refinement: Refinement) -> list[str]:
    """Writes `recording.toml` if the recording's event files are known."""
    sources = _sources(recording)
    if not sources:
        return [f"{recording.name} does not name its event files: no {FILE_NAME} was written"]
    clock_us = refinement.correction.clock_us(len(recording.rig))
    what: dict[str, Any] = {
        "name": f"{recording.name}, refined",
        "calibration": {"file": RIG_FILE},
        "poses": {"file": POSES_FILE},
        "events": [_events(*each, out) for each in zip(sources, clock_us, strict=True)],
    }
    if recording.depth_range_m is not None:
        what["depth_range_m"] = [float(depth_m) for depth_m in recording.depth_range_m]
    (folder / FILE_NAME).write_text(tomli_w.dumps(what), encoding="utf-8")
    return []


def _events(source: EventSource, late_us: int, out: Path) -> dict[str, Any]:
    path = os.path.relpath(source.path.resolve(), out.resolve())
    table: dict[str, Any] = {"file": path, "time_offset_us": source.shift_us + late_us}
    if source.stream:
        table["stream"] = source.stream
    if source.columns is not None:
        named = {k: getattr(source.columns, k) for k in ("x", "y", "t", "p")}
        table |= {"columns": named} if all(named.values()) else {}
        table |= {"time_unit": source.columns.time_unit} if source.columns.time_unit else {}
    return table


def _own_format(folder: Path, recording: Recording, rig: Rig) -> list[str]:
    """Writes the calibration in the recording's own format; a note where that is impossible."""
    if isinstance(recording, Sequence):
        return []
    try:
        written = _written_as(folder, recording, rig)
    except InputError as error:
        return [f"the calibration was not written in the recording's own format: {error}"]
    return [] if written else [f"the calibration is written as {RIG_FILE}, without loss"]


def _written_as(folder: Path, recording: Recording, rig: Rig) -> bool:
    if isinstance(recording, EventCameraDataset):
        _write_ecd(folder / "calib.txt", rig)
        return True
    if not isinstance(recording, PosedRecording):
        return False
    writers: dict[str, Callable[[], None]] = {
        "DSEC": lambda: _write_dsec(folder, rig),
        # Four cameras, of which the last two are the event cameras.
        "TUM-VIE": lambda: write_basalt(
            folder / "camera-calibrationA.json",
            Rig(rig.name, rig.cameras * 2, rig.T_body_cam * 2),
        ),
        "MVSEC": lambda: write_kalibr(folder / f"camchain-imucam-{recording.name}.yaml", rig),
        FILE_NAME: lambda: _write_described(folder, recording, rig),
    }
    if recording.layout not in writers:
        return False
    writers[recording.layout]()
    return True


def _write_dsec(folder: Path, rig: Rig) -> None:
    for side in ("left", "right"):
        (folder / "events" / side).mkdir(parents=True)
    dsec.write_calibration(folder, rig)


def _write_ecd(path: Path, rig: Rig) -> None:
    """`fx fy cx cy k1 k2 p1 p2 k3` in one line."""
    camera = rig.cameras[0]
    terms = (*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    values = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *terms)
    path.write_text(" ".join(f"{value:.9g}" for value in values) + "\n", encoding="ascii")


def _write_described(folder: Path, recording: PosedRecording, rig: Rig) -> None:
    """In the format of the file that the `recording.toml` names, under its name."""
    named = read_descriptor(recording.path / FILE_NAME).calibration.file
    if len(named) > 1 or not named[0].endswith((".json", ".yaml", ".yml")):
        return
    values = parsed(path := recording.path / named[0])
    if "value0" in values:
        write_basalt(folder / path.name, rig)
    elif is_opencv(values):
        write_opencv(folder / path.name, rig)
    elif "cam0" in values:
        write_kalibr(folder / path.name, rig)


def _lost(refinement: Refinement) -> list[str]:
    """Notes on what a calibration file cannot hold, and where it is instead."""
    kinds = {e.parameter.kind for e in refinement.estimates if not e.refused}
    no_clock = "calibration files cannot store clock offsets"
    lost = (
        ({"clock"}, f"{no_clock}: {FILE_NAME} does (time_offset_us)"),
        ({"pose clock"}, f"{no_clock}: {POSES_FILE} has the corrected times"),
        ({"hand-eye", "lever"},
         f"the hand-eye is in {RIG_FILE} (T_body_cam), which {FILE_NAME} reads"),
    )  # fmt: skip
    return [note for of, note in lost if kinds & of]
