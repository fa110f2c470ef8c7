"""The manifest of a sequence: what made it, and the hash of every file."""

from __future__ import annotations

from os.path import lexists, realpath
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import ValidationError

from eventsweep.emvs.errors import InputError, quoted, refused
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.blocks import is_by_blocks
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, read_text
from eventsweep.emvs.utils.output_manifest import digest_of, files_below, hashed

SCHEMA_VERSION = 1
FILE_NAME = "manifest.json"
_MAY_LACK = "poses.txt"  # whoever shares a sequence for tracking takes its poses away


class FileEntry(FrozenModel):
    """One file of the sequence."""

    sha256: str
    bytes: int


class Manifest(FrozenModel):
    """What is known of a sequence beside its data."""

    schema_version: int
    name: str
    configuration: dict[str, Any]
    seed: int
    versions: dict[str, str]
    renderer: str
    depth_range_m: tuple[float, float] | None
    span_us: tuple[int, int]
    event_counts: tuple[int, ...]
    files: dict[str, FileEntry]

    def digest(self) -> str:
        """sha256 over the hashes of all files: equal where the data are equal."""
        return digest_of({name: entry.sha256 for name, entry in self.files.items()})


def entries(folder: Path) -> dict[str, FileEntry]:
    """Hashes every file below a folder, the manifest excepted."""
    facts = files_below(folder)
    names = (name for name in facts if Path(name).name != FILE_NAME)
    return {name: FileEntry(**facts[name]._asdict()) for name in names}


def write(folder: Path, manifest: Manifest) -> None:
    """Writes the manifest into a folder."""
    text = manifest.model_dump_json(indent=2) + "\n"
    (folder / FILE_NAME).write_text(text, encoding="utf-8")


def read(folder: Path) -> Manifest:
    """Reads a folder's manifest and checks that its files are there in full length.

    Raises:
        InputError: no manifest, one of another version, a missing or truncated file, or a link that
            leads out of the folder.
    """
    path = folder / FILE_NAME
    for depth in ("*", "*/*"):
        for link in filter(Path.is_symlink, folder.glob(depth)):
            _check_inside(folder, link.relative_to(folder).as_posix())
    try:
        manifest = Manifest.model_validate_json(read_text(path, TABLE_BYTES))
    except FileNotFoundError as error:
        raise InputError(
            f"{folder}: no {FILE_NAME}; needs a sequence that `eventsweep simulate` wrote"
        ) from error
    except (OSError, UnicodeDecodeError, ValidationError) as error:
        raise InputError(f"{path}: damaged manifest; create the sequence again") from error
    if manifest.schema_version != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {manifest.schema_version}, needs {SCHEMA_VERSION}: create "
            "the sequence again"
        )
    for name, entry in manifest.files.items():
        _check_inside(folder, name)
        if not _is_left_out(folder, name):
            _check_size(folder / name, entry)
    return manifest


def check_hashes(folder: Path, manifest: Manifest) -> None:
    """Reads every file and compares its hash.

    Of a file at an address, read in part, only the length is compared, when it is opened.
    """
    for name, entry in manifest.files.items():
        if _is_left_out(folder, name) or is_by_blocks(folder / name):
            continue
        if hashed(folder / name).sha256 != entry.sha256:
            raise InputError(
                f"{folder / name}: content changed since it was made; create the sequence again"
            )


def _is_left_out(folder: Path, name: str) -> bool:
    return name == _MAY_LACK and not lexists(folder / name)


def _check_inside(folder: Path, name: str) -> None:
    """Refuses names, and symbolic links, that lead out of the folder."""
    parts = PurePosixPath(name).parts
    inside = bool(parts) and parts[0] != "/" and ".." not in parts and "\0" not in name
    # realpath, since resolve() has no answer to links in a circle
    if inside and not Path(realpath(folder / name)).is_relative_to(realpath(folder)):
        inside = False
    if not inside:
        raise InputError(
            f"{folder / FILE_NAME}: {quoted(name)} is not a file in this folder; create the "
            "sequence again, or replace the link by the file itself"
        )


def _check_size(path: Path, entry: FileEntry) -> None:
    with refused(f"{path}: missing", OSError, cure="; create the sequence again"):
        check_file(path)
        size = path.stat().st_size
    if size != entry.bytes:
        raise InputError(
            f"{path}: {size} bytes, should be {entry.bytes}; create the sequence again"
        )
