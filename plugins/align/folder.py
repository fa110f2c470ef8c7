"""What alignment writes: frames, masks, depth, events in one pixel grid, and how well they fit."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.hdf5 import Hdf5Writer
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import write_events
from eventsweep.emvs.formats.depth import write_depth_png, write_image
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.emvs.utils.runtime import Progress, silent, versions
from eventsweep.plugins.align.carry import AlignedFrame, aligned_events, aligned_frame
from eventsweep.plugins.align.offset import MARGIN_US, Found, find_offset
from eventsweep.plugins.align.residual import Apart, apart, samples
from eventsweep.plugins.align.rig import Setup

Images = Literal["png", "png16", "npz"]
INFO_FILE, TABLE_FILE, RIG_FILE = "alignment.json", "residual.csv", "corrected.json"
_MOST_COMPARED = 40
"""Frames whose edges are compared with events, spread evenly."""
_COUNTED = ("aligned", "without depth", "outside", "hidden", "unsure")


@dataclass(frozen=True)
class Alignment:
    """What was done.

    Attributes:
        setup: cameras and depth; with the correction where it was applied.
        frames: how many frames were aligned.
        events: how many events were; how many are without depth, outside, hidden; and how many of
            the first have a depth that is unsure.
        before: how far edges lie apart as calibrated; None where nothing can be compared.
        found: what would bring them together; None likewise.
        after: how far apart they lie then.
        notes: what a user should know, a line each.
    """

    setup: Setup
    frames: int
    events: tuple[int, ...] | None
    before: Apart | None
    found: Found | None
    after: Apart | None
    notes: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        setup = self.setup
        return {
            "schema_version": 1,
            "recording": setup.recording.name,
            "into": setup.target.name,
            "camera": setup.target.camera.to_json(),
            "depth": setup.depth.words,
            "frames_of": setup.frames.name if setup.frames else None,
            "events_of": setup.event_camera.name,
            "frames": self.frames,
            "events": None if self.events is None else dict(
                zip(_COUNTED, self.events, strict=True)
            ),
            "residual_px": self.before.table() if self.before else None,
            "matched": self.before.matched if self.before else None,
            "residual_corrected_px": self.after.table() if self.after else None,
            "correction": [vars(each) for each in self.found.estimates] if self.found else None,
            "corrected": setup.correction != type(setup.correction)(),
            "notes": list(self.notes),
        }  # fmt: skip


def align(
    setup: Setup, out: Path, *,
    times_us: tuple[int, ...] = (), span_us: tuple[int, int] | None = None,
    images: Images = "png", apply: bool = False, force: bool = False, command: str = "",
    progress: Progress = silent,
) -> Alignment:  # fmt: skip
    """Writes frames, depth and events in the target's pixels, and how far edges lie apart.

    Args:
        setup: what to align.
        out: the folder to make.
        times_us: views at these times, each of the frame nearest to it; by default at each frame's.
        span_us: part of the recording; by default all that the poses cover.
        images: 8 or 16 bits, or arrays as floats.
        apply: whether to align with the corrected calibration, and to write it.
        force: whether to replace what an earlier call wrote.
        command: for the provenance.
        progress: called with the name of the stage, how much is done and how much there is.

    Raises:
        InputError: nothing to align, a time without poses, or an output that exists.
    """
    check_output(out, force=force)
    span_us = span_us or setup.recording.trajectory.span_us
    chosen, notes = _chosen(setup, span_us)
    _check_useful(setup, chosen, times_us)
    before, found, after, why = _compared(setup, chosen, progress)
    notes += [why] if why else []
    notes += [found.note] if found is not None and found.note else []
    if apply:
        if found is None or not found.useful:
            reason = found.note if found else why
            raise InputError(f"{setup.recording.name}: nothing to apply: {reason}")
        setup = setup.corrected(found.correction)
    with atomic_dir(out, force=force, inputs=(getattr(setup.recording, "path", None),)) as folder:
        frames = _write_frames(folder, setup, chosen, times_us, images, progress)
        events = None
        if setup.target.name != setup.event_camera.name:
            events = _write_events(folder, setup, span_us, progress)
        done = Alignment(setup, frames, events, before, found, after, tuple(notes))
        if before is not None:
            _write_table(folder / TABLE_FILE, before, after)
        if apply:
            _write_corrected(folder / RIG_FILE, setup)
        facts = done.facts() | {"command": command, "versions": versions()}
        text = json.dumps(facts, indent=2, allow_nan=False) + "\n"
        (folder / INFO_FILE).write_text(text, encoding="utf-8")
    return done


def _chosen(setup: Setup, span_us: tuple[int, int]) -> tuple[list[int], list[str]]:
    if setup.frames is None:
        name = setup.recording.name
        return [], [f"{name}: has no frames: none are aligned, and edges cannot be compared"]
    covered = setup.covered()
    taken_us = setup.frames.pictures.t_us
    chosen = [k for k in covered if span_us[0] <= taken_us[k] <= span_us[1]]
    dropped = len(taken_us) - len(covered)
    return chosen, [f"{dropped} of {len(taken_us)} frames lie outside the poses"] if dropped else []


def _check_useful(setup: Setup, chosen: list[int], times_us: tuple[int, ...]) -> None:
    name, (first_us, last_us) = setup.recording.name, setup.recording.trajectory.span_us
    if not (chosen or times_us) and setup.target.name == setup.event_camera.name:
        raise InputError(
            f"{name}: no frame within the part and the poses: nothing to align with the events of "
            f"{setup.target.name}; choose another part, times, or the camera to align into"
        )
    late = next((t for t in times_us if not first_us <= t <= last_us), None)
    if late is not None:
        raise InputError(f"{name}: no pose at {late} µs, they are from {first_us} to {last_us} µs")


def _compared(
    setup: Setup, chosen: list[int], progress: Progress
) -> tuple[Apart | None, Found | None, Apart | None, str]:
    """Residual, correction and residual after it, or why there are none."""
    inner = [k for k in setup.covered(MARGIN_US) if k in set(chosen)]
    if not inner:
        return None, None, None, "no frame lies 20 ms within the poses: edges are not compared"
    some = [inner[k] for k in np.unique(np.linspace(0, len(inner) - 1, _MOST_COMPARED).astype(int))]
    before = found = None
    try:
        taken = samples(setup, some, progress)
        before = apart(setup, taken)
        found = find_offset(setup, taken)
        return before, found, apart(setup.corrected(found.correction), taken), ""
    except InputError as error:
        return before, found, None, str(error)


def _write_frames(
    folder: Path, setup: Setup, chosen: list[int], times_us: tuple[int, ...], images: Images,
    progress: Progress,
) -> int:  # fmt: skip
    """Writes one view after the other; returns how many have a frame."""
    jobs: list[tuple[int | None, float | None]] = [(index, None) for index in chosen]
    if times_us:
        taken_us = np.array([setup.frame_time_us(index) for index in chosen])
        near = [chosen[int(np.argmin(np.abs(taken_us - t)))] if chosen else None for t in times_us]
        jobs = list(zip(near, map(float, times_us), strict=True))
    elif not chosen:
        jobs = [(None, float(t)) for t in setup.depth.t_us]
    stamps = []
    for done, (index, t_us) in enumerate(jobs):
        frame = _depth_alone(setup, t_us) if index is None else aligned_frame(setup, index, t_us)
        _write_frame(folder, f"{done:06d}", frame, images, pictured=index is not None)
        stamps.append(frame.t_us)
        progress("frames", done + 1, len(jobs))
    (folder / "timestamps.txt").write_text("".join(f"{t}\n" for t in stamps), encoding="ascii")
    return sum(index is not None for index, _ in jobs)


def _depth_alone(setup: Setup, t_us: float | None) -> AlignedFrame:
    from eventsweep.plugins.align.views import known_depth_m

    assert t_us is not None
    rho = setup.carried(setup.view(setup.target, t_us), t_us)
    nothing = np.zeros(rho.shape, np.float32)
    return AlignedFrame(round(t_us), nothing, nothing.astype(np.uint8), known_depth_m(rho))


def _write_frame(
    folder: Path, name: str, frame: AlignedFrame, images: Images, *, pictured: bool
) -> None:
    kinds = ("frames", "mask", "depth") if pictured else ("depth",)
    for kind in kinds if images != "npz" else ("views",):
        (folder / kind).mkdir(exist_ok=True)
    if images == "npz":
        seen: dict[str, Any] = {"image": frame.image, "mask": frame.mask} if pictured else {}
        path = folder / "views" / f"{name}.npz"
        np.savez_compressed(path, t_us=frame.t_us, depth_m=frame.depth_m, **seen)
        return
    finite = np.where(np.isfinite(frame.depth_m), frame.depth_m, np.nan).astype(np.float32)
    write_depth_png(folder / "depth" / f"{name}.png", finite)
    if pictured:
        most = 255 if images == "png" else 65535
        levels = np.rint(frame.image.astype(np.float64) * (most / 255))
        levels = levels.astype(np.uint8 if images == "png" else np.uint16)
        write_image(folder / "frames" / f"{name}.png", ".png", levels)
        write_image(folder / "mask" / f"{name}.png", ".png", frame.mask)


def _write_events(
    folder: Path, setup: Setup, span_us: tuple[int, int], progress: Progress
) -> tuple[int, ...]:
    """Writes `events.h5` as DSEC has it, and beside it exact pixels and depth of each event."""
    first_us, last_us = _event_part(setup, span_us)
    counted, camera = np.zeros(4, np.int64), setup.target.camera
    with Hdf5Writer(folder / "events_px.h5") as exact:
        exact.grow("xy_px", np.float32, 1 << 16, (2,))
        exact.grow("depth_m", np.float32, 1 << 16)
        exact.grow("unsure", np.uint8, 1 << 16)

        def packets() -> Iterator[Events]:
            for t_us, some in aligned_events(setup, first_us, last_us):
                counted.__iadd__([*some.lost, int(some.unsure.sum())])
                exact.extend("xy_px", some.xy_px)
                exact.extend("depth_m", some.depth_m)
                exact.extend("unsure", some.unsure)
                progress("events", t_us - first_us, last_us - first_us)
                yield some.events

        size = camera.width_px, camera.height_px
        count = write_events(folder / "events.h5", "dsec", *size, {"events": packets()})
    return count, *counted.tolist()


def _event_part(setup: Setup, span_us: tuple[int, int]) -> tuple[int, int]:
    """The part of a span with events and poses, half open, µs."""
    spans = (
        span_us, setup.recording.trajectory.span_us, setup.recording.event_span_us(setup.events),
    )  # fmt: skip
    first_us, last_us = max(s[0] for s in spans), min(s[1] for s in spans)
    if first_us >= last_us:
        raise InputError(f"{setup.recording.name}: no events within the part and the poses")
    return first_us, last_us


def _write_table(path: Path, before: Apart, after: Apart | None) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["calibration", "depth_from_m", "depth_to_m", "edges", "median_px", "p95_px"]
        )
        for name, each in (("given", before), ("corrected", after)):
            for row in each.table() if each is not None else ():
                writer.writerow([name, *(f"{value:.6g}" for value in row.values())])


def _write_corrected(path: Path, setup: Setup) -> None:
    """The rig as `rig.json`, with the corrected frame camera, and beside it the frames' clock."""
    assert setup.frames is not None
    frames, rig = setup.frames, setup.recording.rig
    name = frames.name if frames.shares is None else f"{frames.name} frames"
    place, lens = setup.correction.placed(frames.T_body_cam), setup.correction.lens(frames.camera)
    beside = Rig(f"{rig.name}, frames", (lens,), (place,), (name,))
    values = replace(rig, frame_cameras=beside).to_json()
    values["frames_late_us"] = {name: round(setup.correction.late_us, 3)}
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
