"""The real slider as a sequence with depth from its own frames: `slider_sequence SLIDER --out DIR`.

`SLIDER` is `slider_depth` of the Event Camera Dataset, which anyone may download. Camera 0 is the
recording, camera 1 its own events restamped 10 cm farther on (`slid_pair`); depth is known at four
places where the frames agree (`frame_depth`). What a simulated sequence does, this one does:

    eventsweep map DIR --out maps --map.start-s 0.873 --map.duration-s 0.4 --map.reference-s 1.073
    eventsweep score maps
    eventsweep track DIR --out track

It prints each place's time T, how much of the view has depth, and how accurate that is: the band
that holds 68 % of its own errors, as a share of depth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.cli.exit_codes import exit_code
from frame_depth import FrameDepth
from real_check import BASELINE_M, DEPTH_RANGE_M, DEVELOPMENT_M, HELD_OUT_M, frame_depth_at
from slid_pair import SlidPair, straight_way

Pixel = TypeVar("Pixel", np.float32, np.uint8)
VIEWS_M = (*HELD_OUT_M, *DEVELOPMENT_M)
"""Places on the slider's way with truth."""


def write(recording: EventCameraDataset, out: Path, *, force: bool = False) -> list[str]:
    """Writes the sequence; returns a line per place with truth."""
    pair, (t_us, x_m) = SlidPair(recording, BASELINE_M), straight_way(recording)
    first_us, last_us = pair.event_span_us(0)
    lines = ["time s  place m  with depth %  accuracy %"]
    with SequenceWriter(
        out, name=recording.name, rig=pair.rig, trajectory=recording.trajectory, renderer="none",
        config={"truth": "frames", "baseline_m": BASELINE_M}, depth_range_m=DEPTH_RANGE_M,
        span_us=(first_us, last_us), force=force, inputs=(recording.path,),
    ) as writer:  # fmt: skip
        for camera in range(len(pair.rig)):
            writer.append_events(camera, pair.events(camera, first_us, last_us))
        for at_us in places_us(t_us, x_m, first_us):
            view_m = float(np.interp(at_us, t_us, x_m))
            for camera in reversed(range(len(pair.rig))):
                truth = frame_depth_at(recording, view_m + camera * BASELINE_M)
                _append(writer, camera, recording, at_us, truth)
            lines.append(
                f"{(at_us - first_us) / 1e6:6.3f}  {view_m:7.3f}  {100 * truth.known.mean():12.1f}"
                f"  {100 * truth.own_error:10.2f}"
            )
    return lines


def places_us(
    t_us: NDArray[np.int64], x_m: NDArray[np.float64], first_us: int
) -> NDArray[np.int64]:
    """When the slider is at the places with truth, to whole ms after the first event."""
    exact_us = np.interp(sorted(VIEWS_M), x_m, t_us)
    return first_us + 1000 * np.rint((exact_us - first_us) / 1000).astype(np.int64)


def _append(
    writer: SequenceWriter,
    number: int,
    recording: EventCameraDataset,
    at_us: int,
    truth: FrameDepth,
) -> None:
    view_m = np.where(truth.known, truth.depth_m, np.nan).astype(np.float32)
    camera, light = recording.rig.cameras[0], np.rint(truth.frame).clip(0, 255).astype(np.uint8)
    optional = {"view_depth_m": view_m}
    writer.append_truth(
        number, at_us, in_sensor(view_m, camera), in_sensor(light, camera), optional
    )


def in_sensor(view: NDArray[Pixel], camera: Camera) -> NDArray[Pixel]:
    """(H, W) what the sensor's pixels see of the undistorted view, the nearest of its pixels."""
    at = camera.bearing_table() * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
    u, v = np.rint(at).astype(np.int64).transpose(2, 0, 1)
    inside = (u >= 0) & (v >= 0) & (u < view.shape[1]) & (v < view.shape[0])
    unknown = np.nan if view.dtype.kind == "f" else 0
    seen = view[np.where(inside, v, 0), np.where(inside, u, 0)]
    return np.where(inside, seen, view.dtype.type(unknown))


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes and prints; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("slider", type=Path, help="folder of slider_depth")
    parser.add_argument("--out", type=Path, required=True, help="sequence folder to write")
    parser.add_argument("--force", action="store_true", help="replace an earlier one")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        recording = open_recording(asked.slider)
        if not isinstance(recording, EventCameraDataset):
            raise InputError(f"{asked.slider}: needs slider_depth of the Event Camera Dataset")
        sys.stdout.write("\n".join(write(recording, asked.out, force=asked.force)) + "\n")
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
