"""Puts an output in the place of one at an address, as nearly at once as its store permits.

The new one is sent beside the old first. Then the old one goes, its indexes before everything else,
and the store copies the new one, its indexes last. So what ends this before the copying leaves the
old output, and what ends it meanwhile leaves the new one beside, and none that seems whole.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils import output_manifest
from eventsweep.emvs.utils.address import Store, address_of, reached, retried, store_of
from eventsweep.emvs.utils.mirror import made

_MANIFESTS = {output_manifest.NAME, "manifest.json"}
_ANOTHER = "choose another output"


def check_free(path: Path) -> None:
    """Refuses an address at which something is."""
    address = str(address_of(path))
    if _files(address):
        raise InputError(f"{address} exists: {_ANOTHER}, or add --force to replace it")


@contextmanager
def replaced(path: Path, beside: str, inputs: Iterable[str] = ()) -> Iterator[Path]:
    """A place to make an output that takes the place of ours at an address in the end.

    Args:
        path: the address.
        beside: another of the same store, to which the new output is sent first; what an attempt
            that was interrupted left there goes.
        inputs: addresses that are read meanwhile.

    Raises:
        InputError: what is there is read, or was not written by this program, or was changed since:
            nothing can be kept there under another name.
    """
    address = str(address_of(path))
    old = _files(address)
    _check_not_read(address, inputs)
    _check_ours(address, old)
    with reached(address, "written"):
        _clear(store_of(beside), _files(beside))
    with made(Path(beside)) as place:
        yield place
    _exchange(address, beside, old)


def _files(address: str) -> dict[str, int]:
    """Size of every file below an address, bytes."""
    store = store_of(address)
    with reached(address):
        found: Mapping[str, Any] = retried(lambda: store.files.find(store.path, detail=True))
    start = f"{store.path.rstrip('/')}/"
    return {place.removeprefix(start): int(facts["size"]) for place, facts in found.items()}


def _check_not_read(address: str, inputs: Iterable[str]) -> None:
    for source in inputs:
        if f"{source}/".startswith(f"{address}/") or f"{address}/".startswith(f"{source}/"):
            raise InputError(f"{address} is, holds or is part of the input {source}: {_ANOTHER}")


def _check_ours(address: str, found: Mapping[str, int]) -> None:
    """Refuses what no manifest there lists with its length; its hash only a download would tell."""
    store = store_of(address)
    with tempfile.TemporaryDirectory() as name, reached(address):
        folder = Path(name)
        for file in (name for name in found if Path(name).name in _MANIFESTS):
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            retried(partial(store.files.get_file, _at(store, file), str(folder / file)))
        ours = set(_listed(folder))
    for file, size in found.items():
        if not {(file, size), (file, None)} & ours:
            raise InputError(
                f"{address} holds {quoted(file)}, which eventsweep did not write, or which was "
                f"changed since: {_ANOTHER}, or remove that first"
            )


def _listed(folder: Path, at: str = "") -> Iterator[tuple[str, int | None]]:
    """What the manifests of a folder and its parts list, with lengths; of manifests None."""
    manifest = output_manifest.read(folder / at)
    if manifest is None:
        return
    for files in (manifest.files, manifest.coming, manifest.sequence):
        yield from ((f"{at}{name}", facts.bytes) for name, facts in files.items())
    yield from ((f"{at}{name}", None) for name in manifest.unlisted)
    for part in manifest.parts:
        yield from _listed(folder, f"{at}{part}/")


def _exchange(address: str, beside: str, old: Mapping[str, int]) -> None:
    """Removes an output at an address, and copies there what lies beside.

    Until that is done a manifest there lists both, so that the same command can do it again.
    """
    store, source, new = store_of(address), store_of(beside), _files(beside)
    manifest = _at(store, output_manifest.NAME)
    try:
        with reached(address, "written"):
            retried(partial(store.files.pipe_file, manifest, _of_both(old, new)))
            _remove(store, [name for name in old if name not in new or _is_index(name)])
            for name in sorted(new, key=_rank):
                retried(partial(store.files.cp_file, _at(source, name), _at(store, name)))
            if output_manifest.NAME not in new:
                retried(partial(store.files.rm_file, manifest))
            _clear(source, new)
    except InputError as error:
        raise InputError(
            f"{error} (the finished output is in {beside.rpartition('/')[0]}: repeat the command, "
            "or move it there)"
        ) from error


def _of_both(old: Mapping[str, int], new: Mapping[str, int]) -> bytes:
    """A manifest of files that are exchanged, by their lengths."""
    files, coming = (
        {name: {"bytes": size, "sha256": ""} for name, size in one.items()} for one in (old, new)
    )
    known = {"written_by": "eventsweep", "schema": 1, "files": files, "coming": coming}
    return json.dumps(known).encode()


def _remove(store: Store, names: Iterable[str]) -> None:
    """Removes files, indexes first; not the manifest of the whole."""
    for name in sorted(set(names) - {output_manifest.NAME}, key=_rank, reverse=True):
        retried(partial(store.files.rm_file, _at(store, name)))


def _clear(store: Store, names: Iterable[str]) -> None:
    """Removes all files, and folders where a store has such."""
    _remove(store, names)
    if retried(lambda: store.files.exists(store.path)):
        retried(lambda: store.files.rm(store.path, recursive=True))


def _is_index(name: str) -> bool:
    return name.endswith(".json")


def _rank(name: str) -> tuple[bool, bool, int, str]:
    """Indexes come after everything, those of the whole after those of parts, its manifest last."""
    index = _is_index(name)
    return name == output_manifest.NAME, index, -name.count("/") if index else 0, name


def _at(store: Store, name: str) -> str:
    return f"{store.path.rstrip('/')}/{name}"
