"""What lies at a path: cameras, time span, events and their faults, poses that cover them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from emvs.data.recording import Recording
from emvs.datasets.posed import PosedRecording
from emvs.datasets.raw_streams import Readable, open_readable
from eval.info_stream import StreamCount, count
from eval.progress import Progress

_POSE_GAP_FACTOR = 5


def inspect(path: Path, progress: Progress) -> tuple[Readable, list[StreamCount]]:
    """Opens anything readable and counts its events, one pass per stream.

    Raises:
        InputError: nothing readable, or a damaged file.
    """
    readable = open_readable(path)
    counts = []
    for (name, source), size_px in zip(readable.streams, readable.sizes_px, strict=True):
        with progress.stage(f"read {name.strip('/')}", 1.0) as update:
            counts.append(
                count(
                    source.chunks(),
                    size_px,
                    lambda c, source=source, update=update: update(  # type: ignore[misc]
                        source.share, f"{c.events:,} events"
                    ),
                )
            )
    return readable, counts


def facts(readable: Readable, counts: Sequence[StreamCount]) -> dict[str, Any]:
    """Everything that is known, as plain values for JSON."""
    return {
        "path": str(readable.path),
        "what": readable.what,
        "streams": [
            {"name": name, **stream_facts(count)}
            for (name, _), count in zip(readable.streams, counts, strict=True)
        ],
        "recording": None
        if readable.recording is None
        else recording_facts(readable.recording, counts),
    }


def stream_facts(count: StreamCount) -> dict[str, Any]:
    """One stream."""
    first, last = count.first_us, count.last_us
    duration_s = 0.0 if first is None or last is None else (last - first) * 1e-6
    return {
        "events": count.events,
        "brighter": count.brighter,
        "darker": count.events - count.brighter,
        "first_us": first,
        "last_us": last,
        "duration_s": duration_s,
        "mean_rate_hz": count.events / duration_s if duration_s else None,
        "peak_rate_hz": count.peak_rate_hz,
        "sensor_px": count.size_px,
        "largest_px": [count.largest_x, count.largest_y],
        "outside_sensor": None if count.size_px is None else count.outside,
        "backward_steps": count.backwards,
        "out_of_order": count.backwards_events,
        "gaps": count.gap_count,
        "longest_gaps_us": [list(gap) for gap in count.gaps],
    }


def recording_facts(recording: Recording, counts: Sequence[StreamCount]) -> dict[str, Any]:
    """Cameras, poses and truth."""
    first, last = recording.trajectory.span_us
    steps_us = np.diff(recording.trajectory.t_us)
    typical_us = float(np.median(steps_us)) if len(steps_us) else 0.0
    return {
        "name": recording.name,
        "cameras": [
            {"name": name, **camera.to_json()}
            for name, camera in zip(recording.rig.camera_names, recording.rig.cameras, strict=True)
        ],
        "baseline_m": recording.rig.baseline_m() if len(recording.rig) > 1 else None,
        "poses": len(recording.trajectory),
        "poses_us": [first, last],
        "pose_rate_hz": 1e6 / typical_us if typical_us else None,
        "pose_gaps": int(np.count_nonzero(steps_us > _POSE_GAP_FACTOR * typical_us)),
        "poses_cover_events": all(
            c.first_us is None or c.last_us is None or (first <= c.first_us and c.last_us <= last)
            for c in counts
        ),
        "poses_share_of_events_span": [_covered(c, first, last) for c in counts],
        "truth_times": _truth_times(recording),
        "renderer": getattr(getattr(recording, "manifest", None), "renderer", None),
    }


def _covered(count: StreamCount, first_us: int, last_us: int) -> float:
    """Share of a stream's time span in which there are poses."""
    if count.first_us is None or count.last_us is None:
        return 1.0
    both = min(count.last_us, last_us) - max(count.first_us, first_us)
    whole = count.last_us - count.first_us
    return float(np.clip(both / whole, 0.0, 1.0)) if whole else float(both >= 0)


def _truth_times(recording: Recording) -> int:
    if isinstance(recording, PosedRecording):
        return len(recording.truth_times_us(0))
    times = getattr(recording, "truth_times_us", None)
    return 0 if times is None else len(times(0))


def warnings(description: dict[str, Any]) -> list[str]:
    """What a reader should know before mapping, one sentence each."""
    said = []
    for stream in description["streams"]:
        name = stream["name"]
        if not stream["events"]:
            said.append(f"{name}: no events")
        if stream["out_of_order"]:
            said.append(
                f"{name}: {stream['out_of_order']:,} events come after later ones: sort by time"
            )
        if stream["outside_sensor"]:
            said.append(
                f"{name}: {stream['outside_sensor']:,} events lie off the sensor: check its size"
            )
    recording = description["recording"]
    if recording and not recording["poses_cover_events"]:
        least = min(recording["poses_share_of_events_span"])
        said.append(f"poses cover {least:.1%} of the events' time; the rest cannot be mapped")
    if recording and recording["pose_gaps"]:
        said.append(f"{recording['pose_gaps']} gaps between poses are over 5 times the usual step")
    return said
