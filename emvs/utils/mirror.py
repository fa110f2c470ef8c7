"""Fills the mirror of a folder at an address, and sends back what changed in it.

Of HDF5 files only those blocks come that are read, when they are; everything else is small and
comes at once. What is sent takes the place of what was there file by file, the indexes last: they
are taken away first, so that half of an output is never taken for the whole.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.address import (
    Store,
    address_of,
    mirror_of,
    mirrors,
    reached,
    retried,
    store_of,
)
from eventsweep.emvs.utils.blocks import is_by_blocks, stand_in
from eventsweep.emvs.utils.files import atomic_path, bytes_text, is_work_folder
from eventsweep.emvs.utils.inputs import TABLE_BYTES
from eventsweep.emvs.utils.output_manifest import FileFacts, facts_of

_SEQUENCE = "manifest.json"
_LAST = {_SEQUENCE, "map.json", "results.json", "suite.json"}
_BY_BLOCKS = {".h5", ".hdf5"}
_NOT_READ = {".ply"}  # clouds: large, and no command that reads addresses reads them
_MOST_BYTES = 1 << 32  # of all that comes at once
_STATE_KEYS = ("size", "ETag", "etag", "content_md5", "LastModified", "mtime", "created", "md5Hash")
_MAKING: set[Path] = set()
_COPY = "copy it here first, with `aws s3 cp --recursive` for example"


def fetched(path: Path) -> Path:
    """The mirror of a recording or output at an address, filled; a path that is none as it is.

    Raises:
        InputError: nothing there, or it is not reached, or files other than HDF5 that are large.
    """
    address = address_of(path)
    if address is None or any(place in _MAKING for place in (path, *path.parents)):
        return path
    return _filled(address)[0]


@contextmanager
def changed(path: Path) -> Iterator[Path]:
    """The mirror of an output at an address, to add to; at the end what changed is sent there.

    Where an error ends it nothing is sent.
    """
    address = str(address_of(path))
    _check_writes(address)
    mirror, names = _filled(address)
    _empty(mirror, _files(mirror).keys() - names)
    before = _files(mirror)
    try:
        yield mirror
        _send(address, mirror, before)
    finally:
        _empty(mirror, _files(mirror))


@contextmanager
def made(path: Path) -> Iterator[Path]:
    """A place to make an output that is sent to an address at the end.

    Where an error ends it nothing is sent; what its maker can go on from stays here.

    Raises:
        InputError: something is there already: at an address nothing is kept under another name.
    """
    address = str(address_of(path))
    mirror, store = mirror_of(address), store_of(address)
    with reached(address):
        if retried(lambda: store.files.exists(store.path)):
            raise InputError(
                f"{address} exists: choose another output, or remove that first; at an address "
                "nothing is replaced"
            )
    _check_writes(address)
    _MAKING.add(mirror)
    try:
        yield mirror
        _send(address, mirror, {})
        _empty(mirror, _files(mirror))
    finally:
        _MAKING.discard(mirror)


def _filled(address: str) -> tuple[Path, set[str]]:
    """The mirror of an address, and the files that are there now."""
    mirror, store = mirror_of(address), store_of(address)
    with reached(address):
        found = _of_sequence(store) or _listed(store)
        if not found:
            raise FileNotFoundError(address)
        by_blocks = {name for name in found if Path(name).suffix in _BY_BLOCKS}
        _check_small(address, {name: found[name] for name in found.keys() - by_blocks})
        for name in by_blocks:
            stand_in(mirror / name, int(found[name]["size"]), _state(found[name]))
        for name in sorted(found.keys() - by_blocks):
            _get(store, name, mirror / name, found[name])
    return mirror, set(found)


def _check_writes(address: str) -> None:
    """Refuses, before the work, an address that cannot be written to: writes and removes a file."""
    store = store_of(address)
    if address.startswith("http"):
        raise InputError(f"{address}: is only read from; choose an output at s3:// or in a folder")
    trial = _at(store, ".eventsweep-trial")
    with reached(address, "written"):
        retried(lambda: store.files.pipe_file(trial, b"-"))
        retried(lambda: store.files.rm_file(trial))


def _send(address: str, mirror: Path, before: Mapping[str, FileFacts]) -> None:
    """Sends files that are new or others than before, indexes last."""
    store, after = store_of(address), _files(mirror)
    new = sorted((name for name in after if after[name] != before.get(name)), key=_rank)
    replaced = [name for name in new if name in before and _is_index(name)]
    try:
        with reached(address, "written"):
            for name in [*replaced[::-1], *(before.keys() - after.keys())]:
                retried(partial(store.files.rm_file, _at(store, name)))
            for name in new:
                retried(partial(store.files.put_file, str(mirror / name), _at(store, name)))
    except InputError as error:
        kept = _kept_here(mirror)
        raise InputError(f"{error} (the finished output is in {kept}: copy it there)") from error


def _kept_here(mirror: Path) -> Path:
    """Where an output that could not be sent is kept."""
    folder = mirrors().with_name("unsent")
    folder.mkdir(exist_ok=True)
    return mirror.rename(tempfile.mkdtemp(prefix=f"{mirror.name}-", dir=folder))


def _empty(mirror: Path, names: Iterable[str]) -> None:
    """Removes whole files from a mirror, and folders that are left empty."""
    for name in names:
        (mirror / name).unlink(missing_ok=True)
    for parent, _, _ in os.walk(mirror, topdown=False):
        with suppress(OSError):  # blocks, or what another run goes on from
            Path(parent).rmdir()


def _files(mirror: Path) -> dict[str, FileFacts]:
    """Size and hash of every file of a mirror that is whole there."""
    found = {}
    for parent, below, names in os.walk(mirror):
        below[:] = [name for name in below if not is_work_folder(Path(parent) / name)]
        for file in map(Path(parent).joinpath, names):
            if not (file.name.endswith(".blocks") or is_by_blocks(file)):
                found[file.relative_to(mirror).as_posix()] = facts_of(file)
    return found


def _is_index(name: str) -> bool:
    return name.endswith(".json")


def _rank(name: str) -> tuple[bool, int, bool, str]:
    """Indexes come after everything, those of the whole after those of parts."""
    index = _is_index(name)
    return index, -name.count("/") if index else 0, name in _LAST, name


def _of_sequence(store: Store) -> dict[str, Any]:
    """Files of a sequence, as its manifest names them: no listing, which may be long."""
    try:
        text = retried(lambda: store.files.cat_file(_at(store, _SEQUENCE), end=TABLE_BYTES))
        names = {name: str(entry["sha256"]) for name, entry in json.loads(text)["files"].items()}
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    found = {_SEQUENCE: _info(store, _SEQUENCE)}
    for name in filter(_is_below, names):  # the manifest's reader refuses the others
        with suppress(FileNotFoundError):  # and says what is missing
            found[name] = _info(store, name) | {"sha256": names[name]}
    return found


def _is_below(name: str) -> bool:
    return not {"", ".", ".."} & {*name.split("/")} and "\0" not in name


def _info(store: Store, name: str) -> dict[str, Any]:
    facts: dict[str, Any] = retried(lambda: store.files.info(_at(store, name)))
    return facts


def _listed(store: Store) -> dict[str, Any]:
    """Files below an address."""
    found = retried(lambda: store.files.find(store.path, detail=True))
    start = f"{store.path.rstrip('/')}/"
    below = {place.removeprefix(start): facts for place, facts in found.items()}
    return {
        name: facts
        for name, facts in below.items()
        if _is_below(name) and Path(name).suffix not in _NOT_READ
    }


def _check_small(address: str, whole: Mapping[str, Any]) -> None:
    """Refuses what would come whole and is large: of such files none is read in parts."""
    sizes = {name: int(facts.get("size") or 0) for name, facts in whole.items()}
    for name, size in sizes.items():
        if size > TABLE_BYTES:
            raise InputError(
                f"{address}/{name}: {bytes_text(size)}, and no HDF5: not read in parts; {_COPY}"
            )
    if sum(sizes.values()) > _MOST_BYTES:
        raise InputError(
            f"{address}: {len(sizes)} files other than HDF5 hold {bytes_text(sum(sizes.values()))}"
            f", at most {bytes_text(_MOST_BYTES)} come; {_COPY}"
        )


def _get(store: Store, name: str, place: Path, facts: Mapping[str, Any]) -> None:
    """Fetches a whole file, unless it is there with the hash that its manifest says."""
    sha256 = facts.get("sha256")
    if sha256 and place.is_file() and facts_of(place).sha256 == sha256:
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(place) as coming:
        retried(lambda: store.files.get_file(_at(store, name), str(coming)))


def _state(facts: Mapping[str, Any]) -> str:
    """What changes whenever a file does, as far as its store says."""
    known = {key: str(facts[key]) for key in _STATE_KEYS if facts.get(key)}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def _at(store: Store, name: str) -> str:
    return f"{store.path.rstrip('/')}/{name}"
