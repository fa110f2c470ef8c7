"""Folders as one compressed file, the same bytes each time; unpacked without believing any name."""

from __future__ import annotations

import hashlib
import io
import sys
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, cast

from eventsweep.emvs.data.manifest import FileEntry
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils.files import names_full_disk
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.emvs.utils.output_manifest import hashed

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# HDF5's chunks are compressed already: higher levels only take longer.
_LEVEL = 9
_STEP = 1 << 20
_BLOCK = 512
# A header, padding to a block, and room for names that need a header of their own.
_PER_MEMBER = 8 * _BLOCK
_END = 32 * _BLOCK
_FAULTS = (tarfile.TarError, zstd.ZstdError, OSError, EOFError, ValueError, OverflowError)


def pack(path: Path, folder: Path, names: Iterable[str]) -> tuple[str, int]:
    """Writes files below a folder into one; who, when and with which rights is left out.

    Args:
        path: the file to make.
        folder: where they are.
        names: below it.

    Returns:
        sha256 and size of what was written; the same for the same files and library of zstd.
    """
    with (
        zstd.open(path, "wb", level=_LEVEL) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name in sorted(names):
            member = tarfile.TarInfo(name)
            member.size = (folder / name).stat().st_size
            with (folder / name).open("rb") as file:
                tar.addfile(member, file)
    packed = hashed(path)
    return packed.sha256, packed.bytes


def unpack(path: Path, out: Path, expected: Mapping[str, FileEntry]) -> None:
    """Writes exactly the files that are expected into an empty folder.

    Names in the archive are only compared with those expected; links, folders, devices, a name
    twice, one that is not expected, another size or hash, and bytes beyond what all of them need
    are refused.

    Args:
        path: the archive.
        out: an empty folder.
        expected: size and hash by name; where a hash is empty, the most bytes that may come.
    """
    most = sum(entry.bytes + _PER_MEMBER for entry in expected.values()) + _END
    seen: set[str] = set()
    with _opened(path, most) as tar, names_full_disk(out):
        while (member := tar.next()) is not None:
            if member.name in seen:
                raise InputError(f"{path}: {quoted(member.name)} appears twice: create it again")
            _check_expected(path, member, expected)
            seen.add(member.name)
            _copy(path, _file(tar, member), out / member.name, expected[member.name])
    missing = [name for name, entry in expected.items() if name not in seen and entry.sha256]
    if missing:
        raise InputError(f"{path}: {quoted(missing[0])} is missing: create or fetch it again")


def first_member(path: Path, name: str, most_bytes: int) -> bytes:
    """The content of an archive's first file, which must have that name."""
    with _opened(path, most_bytes + _PER_MEMBER + _END) as tar:
        member = tar.next()
        if member is None or member.name != name or not member.isreg():
            first = "nothing" if member is None else quoted(member.name)
            raise InputError(f"{path}: begins with {first}, needs {name} first: create it again")
        if member.size > most_bytes:
            raise InputError(f"{path}: {name} of {member.size} bytes, at most {most_bytes}")
        return _file(tar, member).read()


def sha256_of(path: Path) -> str:
    """Of a file's content."""
    return hashed(path).sha256


def _check_expected(path: Path, member: tarfile.TarInfo, expected: Mapping[str, FileEntry]) -> None:
    name = quoted(member.name)
    if member.name not in expected:
        raise InputError(f"{path}: contains {name}, which does not belong there: create it again")
    if not member.isreg() or member.issparse():
        raise InputError(f"{path}: {name} is not a regular file: create it again")
    entry = expected[member.name]
    if member.size > entry.bytes or (entry.sha256 and member.size != entry.bytes):
        should = "should be" if entry.sha256 else "at most"
        raise InputError(
            f"{path}: {name} has {member.size} bytes, {should} {entry.bytes}: create it again"
        )


def _file(tar: tarfile.TarFile, member: tarfile.TarInfo) -> IO[bytes]:
    file = tar.extractfile(member)
    assert file is not None  # a plain file has content
    return file


def _copy(path: Path, content: IO[bytes], place: Path, expected: FileEntry) -> None:
    digest = hashlib.sha256()
    place.parent.mkdir(parents=True, exist_ok=True)
    # "x": nothing that is there, link or not, is written through.
    with place.open("xb") as file:
        while block := content.read(_STEP):
            digest.update(block)
            file.write(block)
    if expected.sha256 and digest.hexdigest() != expected.sha256:
        raise InputError(f"{path}: {quoted(place.name)} was changed: create or fetch it again")


@contextmanager
def _opened(path: Path, most_bytes: int) -> Iterator[tarfile.TarFile]:
    """The archive as a stream of no more than so many bytes; any damage is one line."""
    try:
        check_file(path)
        with zstd.open(path, "rb") as stream:
            bounded = cast(IO[bytes], _Bounded(stream, path, most_bytes))
            with tarfile.open(fileobj=bounded, mode="r|") as tar:
                yield tar
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except _FAULTS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: damaged archive ({reason}): create or fetch it again") from error


class _Bounded(io.RawIOBase):
    """A stream that ends with an error where more comes than there can be."""

    def __init__(self, stream: io.BufferedIOBase, path: Path, most_bytes: int) -> None:
        self._stream, self._path, self._left = stream, path, most_bytes

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        most = self._left + 1 if size < 0 else min(size, self._left + 1)
        content = self._stream.read(most)
        self._left -= len(content)
        if self._left < 0:
            raise InputError(f"{self._path}: unpacks to more than its limit: create it again")
        return content
