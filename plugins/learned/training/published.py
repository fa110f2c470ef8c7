"""The DERD-Net authors' own weights, from their files into ours.

Their files (`models/` of github.com/tub-rip/DERD-Net, MIT licence) are what `torch.save` makes: a
pickle. It is read by torch's loader of plain tensors, which executes nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.emvs.utils.release import install_extra
from eventsweep.plugins.learned.networks.derd import LAYERS, MOST_MODELS, NAME
from eventsweep.plugins.learned.networks.weights import MOST_BYTES, write_weights

STATE = "model_state_dict"
"""Under which the authors save the model, beside the optimiser."""
_MULTIPIXEL = (9, 100)


def convert(paths: Sequence[Path], folder: Path) -> Path:
    """Writes `derd.npz` and `derd.json` from one of the authors' files, or the mean of two."""
    if len(paths) > MOST_MODELS:
        raise InputError(f"{len(paths)} published files: at most {MOST_MODELS} can be averaged")
    weights = folder / "derd.npz"
    if weights.exists():
        raise InputError(f"{weights}: exists already; choose another folder")
    models = [_model(path) for path in paths]
    arrays = {f"{k}.{name}": array for k, own in enumerate(models) for name, array in own.items()}
    manifest = {
        "licence": "MIT, TU Berlin, Robotic Interactive Perception",
        "uniform_in": "linear",
        "published": {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in paths},
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_weights(weights, NAME, arrays, manifest)
    return weights


def _model(path: Path) -> dict[str, NDArray[np.float32]]:
    state = _state(path)
    shapes = {str(name): tuple(getattr(array, "shape", ())) for name, array in state.items()}
    if shapes.get("dense_output.3.weight") == _MULTIPIXEL:
        raise InputError(f"{path}: weights of the 3 x 3 pixel variant; needs those of one pixel")
    if shapes != dict(LAYERS):
        differing = sorted(n for n in {*shapes, *LAYERS} if shapes.get(n) != LAYERS.get(n))
        raise InputError(f"{path}: arrays differ from DERD-Net's: {', '.join(differing[:4])}")
    return {name: np.asarray(state[name].to("cpu").float().numpy()) for name in LAYERS}


def _state(path: Path) -> Mapping[str, Any]:
    """The state of the model that a file holds; nothing in it is executed."""
    try:
        import torch
    except ModuleNotFoundError as error:
        raise InputError(
            f"published weights need torch, which is not installed: {install_extra('train')}"
        ) from error
    try:
        check_file(path, MOST_BYTES)
        saved = torch.load(path, weights_only=True, map_location="cpu")
    except InputError:
        raise
    except Exception as error:  # torch raises anything for damaged files
        why = " ".join(str(error).split()).split(". ")[0][:100]
        raise InputError(
            f"{path}: cannot be read as a file of weights ({type(error).__name__}: {why}); "
            "download it again"
        ) from error
    state = saved.get(STATE, saved) if isinstance(saved, dict) else None
    if not isinstance(state, dict):
        raise InputError(f"{path}: contains no model state; needs a published .pth file")
    return state
