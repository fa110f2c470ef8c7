"""States as files: plain values and arrays in one npz file, so that work goes on after a kill."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import DAMAGED_NPY, InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import opened_npz

State = dict[str, Any]
"""Of dictionaries, lists, arrays, numbers, texts and None."""
_TREE, _ARRAY = "tree", "array"
_FAULTS: tuple[type[Exception], ...] = (*DAMAGED_NPY, KeyError, TypeError, RecursionError)


class Checkpoints(Protocol):
    """Where a tracker's state is kept."""

    def is_due(self) -> bool:
        """Whether a state is to be kept now."""

    def save(self, state: State) -> None:
        """Keeps a state instead of the last."""

    def load(self) -> State | None:
        """The state that was kept last; None where there is none of the same work."""


def write_state(path: Path, state: State) -> None:
    """Writes a state; the file is whole or the last one."""
    arrays: list[NDArray[Any]] = []
    tree = json.dumps(_without_arrays(state, arrays)).encode()
    named = {f"{_ARRAY}{k}": array for k, array in enumerate(arrays)}
    with atomic_path(path) as partial, partial.open("wb") as file:
        np.savez(file, **{_TREE: np.frombuffer(tree, np.uint8)}, **named)  # type: ignore[arg-type]


def read_state(path: Path) -> State:
    """Reads a state.

    Raises:
        InputError: no such file, or a damaged one.
    """
    try:
        with opened_npz(path) as file:
            tree = json.loads(file[_TREE].tobytes())
            state: State = _with_arrays(tree, file)
    except _FAULTS as error:
        raise InputError(f"{path}: no state of a tracker ({error}): remove it") from error
    return state


def _without_arrays(value: Any, arrays: list[NDArray[Any]]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {_ARRAY: len(arrays) - 1}
    if isinstance(value, dict):
        return {name: _without_arrays(each, arrays) for name, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_without_arrays(each, arrays) for each in value]
    return value


def _with_arrays(value: Any, file: Any) -> Any:
    if isinstance(value, dict):
        if set(value) == {_ARRAY}:
            return file[f"{_ARRAY}{value[_ARRAY]}"]
        return {name: _with_arrays(each, file) for name, each in value.items()}
    return [_with_arrays(each, file) for each in value] if isinstance(value, list) else value
