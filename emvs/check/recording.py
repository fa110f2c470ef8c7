"""Checks a recording: what it says of itself, then by mapping it otherwise.

`doubts` reads a second of events, and is what `map` runs by itself; `check` reads all of them and
maps alternatives.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from eventsweep.emvs.check.by_mapping import check_by_mapping
from eventsweep.emvs.check.cameras import check_cameras, check_rectification
from eventsweep.emvs.check.events import check_events
from eventsweep.emvs.check.findings import Finding, Report
from eventsweep.emvs.check.parallax import check_parallax
from eventsweep.emvs.check.poses import check_poses
from eventsweep.emvs.check.streams import pieces, read_streams
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import NoRecordingError, open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import Progress, silent

_RECTIFIED_US = 400_000
Unchecked = list[tuple[str, str]]


def check(
    recording: Recording,
    config: MapperConfig | None = None,
    *,
    mapping: bool = True,
    progress: Progress = silent,
) -> Report:
    """Looks at everything, and by mapping at what only mapping tells.

    Args:
        recording: any; one without poses is checked as far as it goes.
        config: depth range and windows, as for mapping.
        mapping: whether to try alternatives by mapping.
        progress: told the stages `events` and `alternatives`, done and all.

    Returns:
        The findings. What the recording refuses to read is a finding, not an error.
    """
    return _checked(recording, config or MapperConfig(), True, mapping, progress)


def doubts(recording: Recording, config: MapperConfig) -> list[Finding]:
    """What a second of events, poses and calibration cast doubt on, in a fraction of a second.

    What the recording refuses to read is left out: mapping refuses it as well, and says so.
    """
    report = _checked(recording, config, False, False, silent)
    return [one for one in report.findings if one.verdict != "good" and one.name != "reading"]


def check_path(
    path: str | Path,
    config: MapperConfig | None = None,
    *,
    mapping: bool = True,
    progress: Progress = silent,
) -> Report:
    """Opens and checks a recording; where opening refuses it, that is the finding.

    Raises:
        NoRecordingError: nothing there, or nothing known.
    """
    try:
        recording = open_recording(path)
    except NoRecordingError:
        raise
    except InputError as error:
        return Report(Path(path).resolve().name, (_refused("opening", error),))
    return check(recording, config, mapping=mapping, progress=progress)


def _checked(
    recording: Recording, config: MapperConfig, thorough: bool, mapping: bool, progress: Progress
) -> Report:
    found: list[Finding] = []
    unchecked: Unchecked = []
    found += _events(recording, thorough, progress)
    found += check_cameras(recording.rig)
    blocking = {(one.name, one.verdict) for one in found}
    readable = not blocking & {
        ("reading", "wrong"),
        ("events", "wrong"),
        ("events-sensor", "wrong"),
    }
    if not has_poses(recording):
        unchecked += [(name, "there are no poses") for name in ("poses", "parallax", "mapping")]
    else:
        found += _try("poses", lambda: check_poses(recording, _span_us(recording)), unchecked)
        found += _try("parallax", lambda: check_parallax(recording, config), unchecked)
    if mapping and has_poses(recording) and readable:
        found += _by_mapping(recording, config, found, unchecked, progress)
    if readable and len(recording.rig) > 1:
        found += _try("rectification", lambda: [_rectification(recording)], unchecked)
    return Report(recording.name, tuple(found), tuple(unchecked))


def has_poses(recording: Recording) -> bool:
    """Whether a recording says where its cameras were."""
    try:
        return len(recording.trajectory) > 0
    except InputError:
        return False


def _events(recording: Recording, thorough: bool, progress: Progress) -> list[Finding]:
    try:
        streams = read_streams(recording, pieces(recording, thorough=thorough), progress)
        return check_events(recording, streams)
    except InputError as error:
        return [_refused("reading", error)]


def _refused(name: str, error: InputError) -> Finding:
    """What a reader refuses, as a finding."""
    return Finding(
        name, "wrong", None, "", str(error), "it cannot be mapped as it is",
        "do what the line says", "refused by the reader",
    )  # fmt: skip


def _try(what: str, look: Callable[[], list[Finding]], unchecked: Unchecked) -> list[Finding]:
    """Findings, or why there are none."""
    try:
        return look()
    except InputError as error:
        unchecked.append((what, str(error)))
        return []


def _span_us(recording: Recording) -> tuple[int, int]:
    spans = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    return min(first for first, _ in spans), max(last for _, last in spans)


def _rectification(recording: Recording) -> Finding:
    first_us, last_us = _span_us(recording)
    middle_us = (first_us + last_us) // 2
    t0_us = max(middle_us - _RECTIFIED_US // 2, first_us)
    return check_rectification(recording, t0_us, min(t0_us + _RECTIFIED_US, last_us + 1))


# Where one of these is wrong, alternatives would be compared on nonsense.
_BEFORE_MAPPING = (
    "baseline", "distortion", "events-rate", "events-sensor", "field-of-view", "focal-ratio",
    "hot-pixels", "parallax", "poses-acceleration", "poses-coverage", "poses-frozen",
    "poses-jumps", "poses-speed", "principal-point",
)  # fmt: skip


def _by_mapping(
    recording: Recording, config: MapperConfig, found: list[Finding], unchecked: Unchecked,
    progress: Progress,
) -> list[Finding]:  # fmt: skip
    first = [one.name for one in found if one.verdict == "wrong" and one.name in _BEFORE_MAPPING]
    if first:
        unchecked.append(("mapping", f"cure {', '.join(first)} first"))
        return []
    return _try("mapping", lambda: check_by_mapping(recording, config, progress), unchecked)
