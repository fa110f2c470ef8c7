"""`eventsweep align`: events, frames and depth in one pixel grid."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common, Force, command_line

if TYPE_CHECKING:
    from eventsweep.emvs.data.recording import Recording
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.align.folder import Alignment

_WIDTHS = ("depth", ">edges", ">median px", ">95 % px", ">corrected", ">95 % px")


def align(
    recording: Path,
    /,
    *,
    out: Path,
    into: str = "",
    frames: str = "",
    events: str = "",
    depth: str | None = None,
    method: str = "",
    depth_camera: str = "",
    depth_at_s: float | None = None,
    at_s: tuple[float, ...] = (),
    start_s: float | None = None,
    duration_s: float | None = None,
    images: Literal["png", "png16", "npz"] = "png",
    apply: Annotated[bool, NO_NEGATIVE] = False,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Bring frames, events and depth into one camera's pixels, by per-pixel depth and poses.

    The scene counts as still between a frame and the nearest depth. Pixels that are hidden, outside
    or without depth are marked in a mask. Then edges of frames are compared with events, and the
    clock offset and rotation that would bring them together are estimated.

    Args:
        recording: A sequence, a data set in its publisher's layout, a ROS bag or a recording.toml.
        out: Folder to write: frames, mask and depth, events.h5, residual.csv, alignment.json.
        into: Camera whose pixels everything gets; by default the event camera.
        frames: Camera whose frames are aligned; by default the first with frames, if possible one
            beside the event cameras.
        events: Event camera; by default the first.
        depth: truth, a map folder, or a dense depth file (npz with depth_m, npy, exr, or png in
            mm); by default the recording's ground truth.
        method: Method of the map folder; by default its first.
        depth_camera: Camera that a depth file belongs to; by default the event camera.
        depth_at_s: Time of a depth file, s on the recording's clock.
        at_s: Times of views, s on the recording's clock; by default those of the frames.
        start_s: Start, s after the first pose; by default 0.
        duration_s: Length, s; by default to the last pose.
        images: png, 16-bit png16, or npz with floats.
        apply: Align with the corrected calibration, and write it as corrected.json.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.utils.outputs import check_output
    from eventsweep.plugins.align.depths import depth_source
    from eventsweep.plugins.align.folder import align as align_into
    from eventsweep.plugins.align.rig import set_up

    check_output(out, force=force)
    console, opened = common.console(), open_recording(recording)
    taken = None
    if depth_at_s is not None:
        taken = depth_camera or events or opened.rig.camera_names[0], round(depth_at_s * 1e6)
    elif depth_camera:
        raise InputError("--depth-camera without --depth-at-s: say when it was seen")
    source = depth_source(opened, depth, method, taken)
    setup = set_up(opened, source, frames=frames, events=events, into=into)
    span_us = _part(opened, start_s, duration_s)
    with console.progress.stage("align", 3.0) as update:
        begin = {"compare": 0, "frames": 1, "events": 2}
        done = align_into(
            setup, out, times_us=tuple(round(t * 1e6) for t in at_s), span_us=span_us,
            images=images, apply=apply, force=force, command=command_line(),
            progress=lambda what, n, of: update(begin[what] + n / max(of, 1), f"{what} {n}/{of}"),
        )  # fmt: skip
        update(3.0, f"{done.frames} frames")
    for note in done.notes:
        console.warn(note)
    console.result({"align": str(out), **done.facts()}, _summary(done))
    console.wrote(out)


def _part(recording: Recording, start_s: float | None, duration_s: float | None) -> tuple[int, int]:
    first_us, last_us = recording.trajectory.span_us
    begin_us = first_us + round((start_s or 0.0) * 1e6)
    end_us = last_us if duration_s is None else min(last_us, begin_us + round(duration_s * 1e6))
    if not first_us <= begin_us < end_us:
        raise InputError(
            f"{recording.name}: from {start_s or 0:g} s of poses over "
            f"{(last_us - first_us) * 1e-6:g} s: choose a part within them"
        )
    return begin_us, end_us


def _summary(done: Alignment) -> Iterator[Part]:
    from eventsweep.eval.cli.console import table

    setup = done.setup
    frames = f"{done.frames} frames of {setup.frames.name}" if setup.frames else "no frames"
    events = "" if done.events is None else f", {done.events[0]:,} events of " + (
        f"{setup.event_camera.name} ({done.events[1]:,} without depth, {done.events[2]:,} outside, "
        f"{done.events[3]:,} hidden; {done.events[4]:,} unsure)"
    )  # fmt: skip
    yield f"{frames}{events} in the pixels of {setup.target.name}, by {setup.depth.words}"
    if done.before is None:
        return
    after = done.after.table() if done.after else []
    rows = []
    for k, row in enumerate(done.before.table()):
        name = f"{row['depth_from_m']:.2f} to {row['depth_to_m']:.2f} m"
        then = [f"{after[k][key]:.2f}" if k < len(after) else "" for key in ("median_px", "p95_px")]
        given = f"{row['median_px']:.2f}", f"{row['p95_px']:.2f}"
        rows.append((name if k else f"all, {name}", str(row["edges"]), *given, *then))
    yield table("edges of frames and events, px of the frame camera", _WIDTHS, rows)
    if done.found is not None:
        yield table(
            "correction of the frame camera", ("value", ">95 % interval"),
            [(each.name, each.words) for each in done.found.estimates],
        )  # fmt: skip
