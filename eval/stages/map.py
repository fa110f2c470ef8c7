"""The second stage: a sequence to the depth maps of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.depth.precision import PRECISION
from eventsweep.emvs.dsi.device import code_of_device
from eventsweep.emvs.maps.folder import RecordingInfo
from eventsweep.emvs.maps.sliding import map_into, map_windows, one_window, without
from eventsweep.emvs.maps.store import write_entry
from eventsweep.emvs.methods import code_of_methods
from eventsweep.eval.jobs.job import MAP, SEQUENCE, Runtime
from eventsweep.eval.perturbations import Perturbation, perturbed
from eventsweep.eval.progress import MapBars

STAGE = __name__


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The modules of its methods and device, and the weights, tables and packages it reads."""
    config = MapperConfig.model_validate(parameters["map"])
    modules, files = code_of_methods(config)
    device_modules, device_files = code_of_device(config.device)
    return (*modules, *device_modules), (*files, *device_files, PRECISION)


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, runtime: Runtime) -> None:
    """Maps as `map` says: the one window called `window`, or into a whole map folder.

    The entry of a window lies beside its folder. The results do not depend on the threads.
    """
    recording = as_perturbed(open_recording(inputs[0] / SEQUENCE), parameters)
    config = MapperConfig.model_validate({**parameters["map"], **runtime.threads()})
    if "window" in parameters:
        folder = out / str(parameters["window"])
        window, hot = one_window(recording, config, folder)
        write_entry(out, map_into(folder, without(recording, hot), config, window, clouds=False))
        return
    digest = recording.manifest.digest() if isinstance(recording, EventSequence) else None
    about = RecordingInfo(name=recording.name, path=f"../{SEQUENCE}", manifest_sha256=digest)
    with MapBars(runtime.display, f"map {recording.name}") as bars:
        map_windows(recording, out / MAP, config, about, bars)


def as_perturbed(recording: Recording, parameters: Mapping[str, Any]) -> Recording:
    """What the mapper is given of a recording: the truth, or what `perturb` makes of it."""
    if not parameters.get("perturb"):
        return recording
    amount = Perturbation.model_validate(parameters["perturb"])
    return perturbed(recording, amount, parameters["seed"])
