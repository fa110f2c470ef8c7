"""Checks a recording: events, poses and calibration first, then by mapping alternatives.

`quick_check` reads a second of events, and is part of every `map`; `check` reads all of them and
maps alternatives.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording, has_poses
from eventsweep.emvs.datasets import NoRecordingError, opened
from eventsweep.emvs.datasets.posed import EventSource, PosedRecording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.by_mapping import check_by_mapping
from eventsweep.plugins.diagnose.check.cameras import check_cameras, check_rectification
from eventsweep.plugins.diagnose.check.events import check_events, occupied, pieces, read_streams
from eventsweep.plugins.diagnose.check.findings import Finding, Report
from eventsweep.plugins.diagnose.check.poses import check_parallax, check_poses
from eventsweep.plugins.diagnose.windows import with_range

Unchecked = list[tuple[str, str]]
_CALIBRATED = ("cameras", "poses", "parallax", "mapping", "rectification")


def check(
    recording: Recording | str | Path,
    config: MapperConfig | None = None,
    *,
    mapping: bool = True,
    progress: Progress = silent,
) -> Report:
    """Finds faults in a recording's events, poses, calibration and conventions.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one; without
            poses, or a bag without calibration, is checked as far as possible.
        config: depth range, window and threads count; by default as for mapping.
        mapping: whether to map it with other settings, too: cameras swapped, poses inverted, clocks
            shifted, other axes, and so on.
        progress: called with the stages `events` and `alternatives`, how much is done and how much
            there is.

    Returns:
        Findings with verdicts, evidence and cures. What opening or reading a path refuses is a
        finding, too.

    Raises:
        InputError: no recording at the path, or neither a path nor a recording.
    """
    config = MapperConfig.or_default(config)
    try:
        readable = opened(recording)
    except InputError as error:
        if isinstance(error, NoRecordingError) or not isinstance(recording, str | Path):
            raise
        alone = _events_alone(Path(recording))
        if alone is None:
            return Report(Path(recording).resolve().name, (_refused("opening", error),))
        unchecked = [(name, "there is no calibration") for name in _CALIBRATED]
        return Report(alone.name, tuple(_events(alone, True, progress)), tuple(unchecked))
    return _checked(readable, with_range(readable, config), True, mapping, progress)


def quick_check(recording: Recording, config: MapperConfig) -> list[Finding]:
    """Doubtful or wrong findings from a second of events, poses and calibration; takes 0.1 s.

    What the recording refuses to read is left out: mapping refuses it as well, with the reason.
    """
    findings = _checked(recording, config, False, False, silent).findings
    return [f for f in findings if f.verdict != "good" and f.name != "reading"]


def _events_alone(path: Path) -> Recording | None:
    """The events of what lacks a calibration alone, with cameras of which only the size counts.

    A size that nothing says is that of the events.
    """
    try:
        readable = open_readable(path)
    except InputError:
        return None
    if readable.recording is not None:
        return None
    named = zip(readable.streams, readable.sizes_px, strict=True)
    sizes_px = [size_px or _largest_px(source) for (_, source), size_px in named]
    cameras = tuple(Camera(w, h, float(w), float(w), w / 2, h / 2) for w, h in sizes_px)
    names = tuple(name for name, _ in readable.streams)
    rig = Rig(path.name, cameras, (np.eye(4),) * len(names), names)
    sources = tuple(source for _, source in readable.streams)
    return PosedRecording(path, readable.what, path.resolve().name, rig, "no calibration", sources)


def _largest_px(source: EventSource) -> tuple[int, int]:
    width_px = height_px = 1
    for events in source.chunks():
        width_px = max(width_px, int(events.x.max()) + 1)
        height_px = max(height_px, int(events.y.max()) + 1)
    return width_px, height_px


def _checked(
    recording: Recording, config: MapperConfig, thorough: bool, mapping: bool, progress: Progress
) -> Report:
    unchecked: Unchecked = []
    findings = _events(recording, thorough, progress) + check_cameras(recording.rig)
    wrong = {finding.name for finding in findings if finding.verdict == "wrong"}
    readable, posed = not wrong & {"reading", "events", "events-sensor"}, has_poses(recording)
    if posed:
        poses, spans = recording.trajectory, partial(occupied, recording)
        findings += _try("poses", lambda: check_poses(poses, spans()), unchecked)
        findings += _try("parallax", lambda: check_parallax(recording, config), unchecked)
    else:
        unchecked += [(name, "there are no poses") for name in ("poses", "parallax", "mapping")]
    if mapping and posed:
        findings += _by_mapping(recording, config, findings, unchecked, progress)
    elif posed:
        unchecked.append(
            ("mapping", "it was left out: clocks, conventions and extrinsics may be wrong")
        )
    if readable and len(recording.rig) > 1:
        findings += _try("rectification", lambda: [_rectification(recording)], unchecked)
    return Report(recording.name, tuple(findings), tuple(unchecked))


def _events(recording: Recording, thorough: bool, progress: Progress) -> list[Finding]:
    try:
        spans = occupied(recording)
        streams = read_streams(recording, pieces(spans, thorough=thorough), progress)
        return check_events(recording, streams, spans)
    except InputError as error:
        return [_refused("reading", error)]


def _refused(name: str, error: InputError) -> Finding:
    """The reader's refusal as a finding."""
    meaning, suspect = "it cannot be mapped in this state", "refused by the reader"
    return Finding(name, "wrong", None, "", str(error), meaning, suspect=suspect)


def _try(name: str, checks: Callable[[], list[Finding]], unchecked: Unchecked) -> list[Finding]:
    """The findings; where the checks are impossible, none and a note in `unchecked`."""
    try:
        return checks()
    except InputError as error:
        unchecked.append((name, str(error)))
        return []


def _rectification(recording: Recording) -> Finding:
    first_us, end_us = max(occupied(recording), key=lambda span: span[1] - span[0])
    middle_us = (first_us + end_us - 1) // 2
    t0_us = max(middle_us - limits.RECTIFIED_US // 2, first_us)
    t1_us = min(t0_us + limits.RECTIFIED_US, end_us)
    return check_rectification(recording, t0_us, t1_us)


def _by_mapping(
    recording: Recording, config: MapperConfig, findings: list[Finding], unchecked: Unchecked,
    progress: Progress,
) -> list[Finding]:  # fmt: skip
    wrong = [finding for finding in findings if finding.verdict == "wrong"]
    if first := [f.name for f in wrong if {f.name, f.suspect} & limits.BEFORE_MAPPING]:
        unchecked.append(("mapping", f"cure {', '.join(first)} first"))
        return []
    return _try("mapping", lambda: check_by_mapping(recording, config, progress), unchecked)
