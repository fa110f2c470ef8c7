"""A stage of its own: one of the sliding windows of a recording, wherever the recording lies."""

from __future__ import annotations

import socket
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.hot_pixels import WithoutPixels
from eventsweep.emvs.maps.folder import MapInfo
from eventsweep.emvs.maps.sliding import NO_MEMORY, Hot, map_sliding_into
from eventsweep.emvs.methods import device_for_methods, methods_by_name
from eventsweep.emvs.utils.address import address_of
from eventsweep.emvs.windows import Window
from eventsweep.eval.jobs.job import Job, Runtime
from eventsweep.eval.stages.map import code as code  # of the same methods, device and weights

STAGE = __name__


def window_job(
    path: Path, head: MapInfo, name: str, window: Window, hot: Hot, *, clouds: bool
) -> Job:
    """The job of a window of the recording at a path; `head` says what is mapped, and how."""
    masks = None if hot is None else [np.argwhere(camera.mask).tolist() for camera in hot]
    parameters = {
        "map": head.config.model_dump(mode="json", exclude={"threads"}),
        "recording_sha256": head.recording_sha256,
        "manifest_sha256": head.recording.manifest_sha256,
        "window": [window.t0_us, window.t1_us, window.t_ref_us, list(window.left_out)],
        "hot": masks,
        "clouds": clouds,
        "name": name,
    }
    source = address_of(path) or str(path.absolute())
    return Job(f"map/{name}", STAGE, parameters, sources=(source,))


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, runtime: Runtime) -> None:
    """Maps the window into `out`, with its entry of `map.json`."""
    recording = open_recording(inputs[0])
    digest = recording.manifest.digest() if isinstance(recording, EventSequence) else None
    if digest != parameters["manifest_sha256"]:
        raise InputError(f"{inputs[0]}: another recording lies here on {socket.gethostname()}")
    config = MapperConfig.model_validate({**parameters["map"], **runtime.threads()})
    if parameters["hot"] is not None:
        cameras = zip(recording.rig.cameras, parameters["hot"], strict=True)
        masks = [np.zeros((c.height_px, c.width_px), bool) for c, _ in cameras]
        for mask, pixels in zip(masks, parameters["hot"], strict=True):
            for y, x in pixels:
                mask[y, x] = True
        recording = WithoutPixels(recording, masks)
    requested = methods_by_name(config.methods, len(recording.rig), mcemvs=config.is_mcemvs)
    t0_us, t1_us, t_ref_us, left_out = parameters["window"]
    try:
        map_sliding_into(
            out, recording, config, Window(t0_us, t1_us, t_ref_us, tuple(left_out)),
            device=device_for_methods(config, requested), clouds=parameters["clouds"],
            name=parameters["name"],
        )  # fmt: skip
    except MemoryError as error:
        raise InputError(NO_MEMORY) from error
