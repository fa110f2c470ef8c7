"""Files of weights: arrays by name, and beside them what they were learnt from; read without trust.

`NAME.npz` holds plain arrays, `NAME.json` the manifest: what network they are of, the hash of the
arrays' file, and where they come from. Nothing in either is ever executed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import DAMAGED_NPY, InputError
from eventsweep.emvs.utils.files import atomic_path, write_text
from eventsweep.emvs.utils.inputs import (
    SETTINGS_BYTES,
    check_file,
    opened_npz,
    parse_json,
    read_text,
)

MOST_BYTES = 1 << 24
"""More than any weights here; what an archive unpacks to counts, too."""
Float32s = NDArray[np.float32]
Net = TypeVar("Net")


@dataclass(frozen=True, eq=False)
class Weights:
    """A network's arrays, checked.

    Attributes:
        arrays: name -> float32 array.
        manifest: what `NAME.json` says: network, arrays_sha256, and how they were learnt.
        path: the arrays' file.
    """

    arrays: Mapping[str, Float32s]
    manifest: Mapping[str, Any]
    path: Path


def packaged(name: str) -> Path:
    """The file of weights that ship with the package."""
    return Path(str(files("eventsweep.plugins.learned.networks"))) / "weights" / f"{name}.npz"


def files_of_weights(path: Path) -> tuple[Path, ...]:
    """A file of weights and its manifest: they decide results.

    Raises:
        InputError: one that is not there.
    """
    files = path, path.with_suffix(".json")
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: no such file; weights are NAME.npz and NAME.json beside it")
    return files


def loaded(name: str, load: Callable[[Path], Net], path: Path | None) -> Net:
    """What `load` makes of a file of weights, by default that of the name that ships.

    It is loaded once, and again where the file or its manifest has changed.
    """
    path = path or packaged(name)
    both = [file.stat() for file in (path, path.with_suffix(".json")) if file.is_file()]
    net: Net = _loaded(load, path, tuple((one.st_mtime_ns, one.st_size) for one in both))
    return net


@cache
def _loaded(load: Callable[[Path], Any], path: Path, _stamp: tuple[tuple[int, int], ...]) -> Any:
    return load(path)


def read_weights(path: Path, network: str, *shapes: Mapping[str, tuple[int, ...]]) -> Weights:
    """Reads the weights of a network.

    Args:
        path: `NAME.npz`; the manifest is `NAME.json` beside it.
        network: its name, which the manifest must state.
        shapes: of every array that it needs, by name; several where it may come in several sizes.

    Raises:
        InputError: a file that is missing, damaged, of another network, or changed since.
    """
    manifest = _manifest(path, network)
    try:
        check_file(path, MOST_BYTES)
        if hashlib.sha256(path.read_bytes()).hexdigest() != manifest.get("arrays_sha256"):
            raise InputError(
                f"{path}: not the file that {path.stem}.json describes: one of the two was changed "
                "or damaged; copy both again"
            )
        arrays = _arrays(path, shapes)
    except DAMAGED_NPY as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read as weights ({error}); copy it again") from error
    return Weights(arrays, manifest, path)


def _manifest(path: Path, network: str) -> Mapping[str, Any]:
    beside = path.with_suffix(".json")
    try:
        manifest = parse_json(read_text(beside, SETTINGS_BYTES))
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(
            f"{beside}: cannot be read ({error}); weights need this file beside {path.name}"
        ) from error
    stated = manifest.get("network") if isinstance(manifest, dict) else None
    if stated != network:
        raise InputError(
            f"{beside}: weights for {stated!r}, but {network!r} is needed; choose others"
        )
    known: Mapping[str, Any] = manifest
    return known


def _arrays(path: Path, known: Sequence[Mapping[str, tuple[int, ...]]]) -> dict[str, Float32s]:
    with opened_npz(path, MOST_BYTES) as archive:
        arrays = {name: np.asarray(archive[name]) for name in archive.files}
    shapes = {name: array.shape for name, array in arrays.items()}
    if shapes not in [dict(needed) for needed in known]:
        needed = known[0]
        differing = sorted(n for n in {*shapes, *needed} if shapes.get(n) != needed.get(n))
        raise InputError(
            f"{path}: arrays differ from what the network needs: {', '.join(differing)}; choose "
            "other weights"
        )
    for name, array in arrays.items():
        if array.dtype != np.float32 or not np.isfinite(array).all():
            raise InputError(f"{path}: {name} must be float32 and finite; train again")
    return {name: np.ascontiguousarray(array) for name, array in arrays.items()}


def write_weights(
    path: Path, network: str, arrays: Mapping[str, Float32s], learnt: Mapping[str, Any]
) -> None:
    """Writes `NAME.npz` and `NAME.json`, each whole or not at all; the latter holds `learnt`."""
    with atomic_path(path) as part, part.open("wb") as file:
        plain: Any = {name: np.asarray(array, np.float32) for name, array in arrays.items()}
        np.savez(file, **plain)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    manifest = {"network": network, "arrays_sha256": digest, **learnt}
    write_text(path.with_suffix(".json"), json.dumps(manifest, indent=1) + "\n")
