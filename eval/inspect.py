"""What lies at a path, for `eventsweep info`: cameras, time span, events, faults, poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from eventsweep.emvs.data.headers import impossible
from eventsweep.emvs.data.occupied import LONGEST_SILENCE_US
from eventsweep.emvs.data.recording import Recording, has_poses
from eventsweep.emvs.datasets.raw_streams import Readable, open_readable
from eventsweep.emvs.errors import one_line
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.event_statistics import StreamCount
from eventsweep.eval.progress import Display

_POSE_GAP_FACTOR = 5
_FEW_POSES = 3  # a motion between two poses has none in between
_ROWS = {
    "events": "events",
    "brighter": "brighter",
    "darker": "darker",
    "first_us": "first, s",
    "last_us": "last, s",
    "duration_s": "duration, s",
    "mean_rate_hz": "mean rate, kev/s",
    "peak_rate_hz": "peak rate, kev/s",
    "sensor_px": "sensor, px",
    "largest_px": "largest pixel",
    "outside_sensor": "off the sensor",
    "out_of_order": "out of order",
    "gaps": "silences over 0.1 s",
}


def inspect(
    path: Path, progress: Display, columns: ColumnMap | None = None
) -> tuple[Readable, list[StreamCount]]:
    """Opens anything readable and counts its events, one pass per stream."""
    readable = open_readable(path, columns)
    counts = []
    for (name, source), size_px in zip(readable.streams, readable.sizes_px, strict=True):
        count = StreamCount(size_px)
        with progress.stage(f"read {name.strip('/')}", 1.0) as update:
            for events in source.chunks():
                count.add(events)
                update(source.share, f"{count.events:,} events")
        counts.append(count)
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
    return {
        "name": recording.name,
        "cameras": [
            {"name": name, **camera.to_json()}
            for name, camera in zip(recording.rig.camera_names, recording.rig.cameras, strict=True)
        ],
        "baseline_m": recording.rig.baseline_m() if len(recording.rig) > 1 else None,
        **(_pose_facts(recording.trajectory, counts) if has_poses(recording) else {"poses": 0}),
        "truth_times": len(getattr(recording, "truth_times_us", lambda _: ())(0)),
        "renderer": getattr(getattr(recording, "manifest", None), "renderer", None),
    }


def _pose_facts(poses: Trajectory, counts: Sequence[StreamCount]) -> dict[str, Any]:
    """How many, how often, and how much of the events they cover."""
    first, last = poses.span_us
    steps_us = np.diff(poses.t_us)
    typical_us = float(np.median(steps_us)) if len(steps_us) else 0.0
    return {
        "poses": len(poses),
        "poses_us": [first, last],
        "pose_rate_hz": 1e6 / typical_us if typical_us else None,
        "pose_notes": [f"poses: {note}" for note in _pose_notes(poses, counts)],
        "pose_gaps": int(np.count_nonzero(steps_us > _POSE_GAP_FACTOR * typical_us)),
        "poses_cover_events": all(
            c.first_us is None or c.last_us is None or (first <= c.first_us and c.last_us <= last)
            for c in counts
        ),
        "poses_share_of_events_span": [_covered(c, first, last) for c in counts],
    }


def _pose_notes(poses: Trajectory, counts: Sequence[StreamCount]) -> Iterator[str]:
    """What their file says wrongly, and times that do not go with those of the events."""
    yield from poses.notes
    first, last = poses.span_us
    if year := impossible(first) or impossible(last):
        yield f"times reach {year}: check their unit"
    for count in counts:
        if count.first_us is None or count.last_us is None or len(poses) < _FEW_POSES:
            continue
        span = f"{first * 1e-6:.6f} to {last * 1e-6:.6f} s"
        inside = np.searchsorted(poses.t_us, (count.first_us, count.last_us))
        if count.last_us < first or last < count.first_us:
            yield f"{span}, none at the time of the events: check clock and unit of both"
            return
        if inside[1] - inside[0] < 2 and count.last_us > count.first_us:
            yield f"{span}, fewer than two from the first event to the last: check their unit"
            return


def _covered(count: StreamCount, first_us: int, last_us: int) -> float:
    """Share of a stream's time span in which there are poses."""
    if count.first_us is None or count.last_us is None:
        return 1.0
    both = min(count.last_us, last_us) - max(count.first_us, first_us)
    whole = count.last_us - count.first_us
    return float(np.clip(both / whole, 0.0, 1.0)) if whole else float(both >= 0)


def warnings(description: dict[str, Any]) -> list[str]:
    """What a reader should know before mapping, one sentence each."""
    notes = [note for stream in description["streams"] for note in _stream_notes(stream)]
    recording = description["recording"]
    if not recording or not recording["poses"]:
        return notes
    notes += recording["pose_notes"]
    if not recording["poses_cover_events"]:
        least = min(recording["poses_share_of_events_span"])
        notes.append(f"poses cover {least:.1%} of the events' time; the rest cannot be mapped")
    if recording["pose_gaps"]:
        notes.append(f"{recording['pose_gaps']} gaps between poses exceed 5 times the usual step")
    return notes


def _stream_notes(stream: dict[str, Any]) -> Iterator[str]:
    name = stream["name"]
    if not stream["events"]:
        yield f"{name}: no events"
    for first_us, end_us in stream["longest_gaps_us"][:1]:
        if end_us - first_us >= LONGEST_SILENCE_US:
            yield (
                f"{name}: no event for {(end_us - first_us) / 1e6:,.6g} s, from {first_us} to "
                f"{end_us} µs: the clock jumps, or these are several takes"
            )
    if stream["out_of_order"]:
        yield f"{name}: {stream['out_of_order']:,} events come after later ones: sort by time"
    if stream["outside_sensor"]:
        yield (
            f"{name}: {stream['outside_sensor']:,} events lie outside the sensor: check its size"
        )
    if year := impossible(stream["first_us"] or 0) or impossible(stream["last_us"] or 0):
        yield f"{name}: times reach {year}: check their unit"


def summary(description: dict[str, Any]) -> Iterator[Table | Text]:
    """The facts as tables, and what a reader should know."""
    yield Text.assemble((description["path"], "bold"), f": {description['what']}")
    yield _streams(description)
    if description["recording"] is not None:
        yield _recording(description["recording"])
    for sentence in warnings(description):
        yield Text(f"note: {sentence}", style="yellow")


def _streams(description: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for stream in description["streams"]:
        table.add_column(one_line(stream["name"]), justify="right")
    for key, title in _ROWS.items():
        table.add_row(title, *(_cell(key, stream[key]) for stream in description["streams"]))
    return table


def _cell(key: str, value: Any) -> str:
    if value is None:
        return "–"
    if key.endswith("_us"):
        return f"{value * 1e-6:.6f}"
    if key.endswith("_hz"):
        return f"{value * 1e-3:,.1f}"
    if key.endswith("_px"):
        return f"{value[0]}x{value[1]}" if key == "sensor_px" else f"{value[0]}, {value[1]}"
    return f"{value:,}" if isinstance(value, int) else f"{value:.6f}"


def _recording(facts: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False, show_header=False)
    for camera in facts["cameras"]:
        size = f"{camera['width_px']}x{camera['height_px']} px, {camera['model']}"
        table.add_row(camera["name"], f"{size}, f {camera['fx_px']:.1f} px")
    if facts["baseline_m"] is not None:
        table.add_row("baseline", f"{facts['baseline_m'] * 100:.2f} cm")
    for title, value in _pose_rows(facts):
        table.add_row(title, value)
    table.add_row("ground truth", f"at {facts['truth_times']:,} times")
    if facts["renderer"] is not None:
        table.add_row("drawn by", facts["renderer"])
    return table


def _pose_rows(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    if not facts["poses"]:
        yield "poses", "none"
        return
    first, last = (t * 1e-6 for t in facts["poses_us"])
    rate = "" if facts["pose_rate_hz"] is None else f", {facts['pose_rate_hz']:.1f} Hz"
    yield "poses", f"{facts['poses']:,} from {first:.6f} to {last:.6f} s{rate}"
    yield "poses cover events", "yes" if facts["poses_cover_events"] else "no"
