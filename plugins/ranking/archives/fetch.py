"""Fetches archived sequences from an address or a folder: resumed, and verified byte by byte.

A file is written in a hidden folder until its hash agrees. What a broken connection or a killed
process left there is continued where it ended, if the server can do that, and begun anew if it
cannot. Files of other origin in the output are never touched.
"""

from __future__ import annotations

import functools
import http.client
import io
import os
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from email.message import Message
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from eventsweep.emvs.errors import InputError, printable
from eventsweep.emvs.utils.files import (
    bytes_text,
    flush,
    free_bytes,
    link_new,
    made_parent,
    names_full_disk,
    work_folder,
)
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, inside
from eventsweep.emvs.utils.output_manifest import FileFacts, listing
from eventsweep.emvs.utils.outputs import claimed
from eventsweep.eval.progress import Display
from eventsweep.plugins.ranking.archives import manifest as manifests
from eventsweep.plugins.ranking.archives.manifest import FILE_NAME, ArchiveManifest, PackedSequence
from eventsweep.plugins.ranking.archives.tarball import sha256_of

TIMEOUT_S = 30.0
ATTEMPTS = 4
_WAIT_S = 0.5
_STEP = 1 << 20
SLOWEST_BYTES_S = 1000
"""Of a server that sends less, on average over `TIMEOUT_S`, the connection is broken off."""
_FAULTS = (urllib.error.URLError, http.client.HTTPException, OSError)


Opened = tuple[io.BufferedIOBase, int]
Source = Callable[[str, int, int], Opened]
"""Gives a file by its name, from a byte on: the content, and the byte that it does begin at.

The last argument is the size of the whole file, or -1 where that is not known.
"""


def _in_folder(folder: Path, name: str, start: int, _size: int) -> Opened:
    """A file on this machine; its hash will tell whether it has its size."""
    path = inside(folder, name)
    check_file(path)
    file = path.open("rb")
    file.seek(start)
    return file, start


def _at_address(address: str, name: str, start: int, size: int) -> Opened:
    """Asks a server for a file, from a byte on where that is not the first."""
    request = urllib.request.Request(f"{address}/{quote(name)}")
    if start:
        request.add_header("Range", f"bytes={start}-")
    answer = _opener().open(request, timeout=TIMEOUT_S)
    begins = 0
    if answer.status == http.HTTPStatus.PARTIAL_CONTENT:
        content_range = str(answer.headers.get("Content-Range", ""))
        begins = _number(content_range.removeprefix("bytes ").partition("-")[0], 0)
    if size >= 0:
        _check_sent(f"{address}/{name}", answer.headers, size - begins)
    return answer, begins


def _check_sent(where: str, headers: Message, size: int) -> None:
    """Refuses a page in the place of a file before anything of it is written."""
    sent, kind = _number(str(headers.get("Content-Length")), size), headers.get_content_type()
    if sent != size or kind == "text/html":
        raise InputError(
            f"{where}: the server sends {sent} bytes of {printable(kind)} instead of the "
            f"archive's {size} bytes: try again later, or ask its publisher"
        )


def _number(text: str, otherwise: int) -> int:
    return int(text) if text.isdecimal() and len(text) < 20 else otherwise


class _Timed(io.RawIOBase):
    """What a server sends, for as long as it comes fast enough: answers, headers and content."""

    def __init__(self, sent: io.RawIOBase) -> None:
        self._sent, self._waited_s, self._count = sent, 0.0, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int | None:
        began_s = time.monotonic()
        count: int | None = self._sent.readinto(buffer)
        self._waited_s += time.monotonic() - began_s
        self._count += count or 0
        if self._waited_s > TIMEOUT_S:
            if self._count < SLOWEST_BYTES_S * self._waited_s:
                rate = self._count / self._waited_s
                raise TimeoutError(f"only {rate:.3g} bytes/s came for {self._waited_s:.0f} s")
            self._waited_s, self._count = 0.0, 0
        return count

    def close(self) -> None:
        self._sent.close()
        super().close()


class _Response(http.client.HTTPResponse):
    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.fp: Any = io.BufferedReader(_Timed(self.fp.detach()))


class _TimedAnswers(urllib.request.HTTPSHandler, urllib.request.HTTPHandler):
    def do_open(self, http_class: Any, req: Any, **arguments: Any) -> Any:
        def connection(*places: Any, **named: Any) -> Any:
            made = http_class(*places, **named)
            made.response_class = _Response
            return made

        return super().do_open(connection, req, **arguments)


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows to other servers, but to no other protocol, and never out of encryption."""

    def redirect_request(
        self, req: Any, fp: Any, code: Any, msg: Any, headers: Any, newurl: Any
    ) -> Any:
        followed = ("https",) if req.type == "https" else ("http", "https")
        if urlsplit(newurl).scheme not in followed:
            raise InputError(
                f"{req.full_url}: redirects to {printable(newurl)}, but only "
                f"{' and '.join(followed)} is followed from there: give the final address"
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


@functools.cache
def _opener() -> urllib.request.OpenerDirector:
    return urllib.request.build_opener(_TimedAnswers, _Redirects)


def source_of(place: str) -> Source:
    """What a user names: `http://...`, `https://...` or a folder."""
    if _is_address(place):
        return functools.partial(_at_address, place.rstrip("/"))
    if not Path(place).is_dir():
        raise InputError(f"{place}: neither a folder nor an address; needs https://... or a folder")
    return functools.partial(_in_folder, Path(place))


def _is_address(place: str) -> bool:
    return urlsplit(place).scheme in ("http", "https")


def fetch(
    place: str,
    out: Path,
    progress: Display,
    *,
    subset: str = "",
    cases: Sequence[str] = (),
    seeds: Sequence[int] | None = None,
    version: str = "",
) -> tuple[ArchiveManifest, tuple[PackedSequence, ...]]:
    """Fetches a manifest and the files of the sequences that are asked for.

    Args:
        place: address or folder.
        out: folder that they are put into; those that are there and whole stay.
        progress: shown how much is there.
        subset: of the suite, such as `quick`.
        cases: only these.
        seeds: only these.
        version: what the archive must be, as its maker published it; any where it is empty.

    Returns:
        The manifest, and the sequences asked for.

    Raises:
        InputError: an unreachable place, a manifest of another version than `version` or than that
            in `out`, no such subset, case or seed, a file that is not what the manifest says, a
            file of another origin in its place, another process that writes into `out`, or no room
            on the disk.
    """
    source = source_of(place)
    text = _read_manifest(source, place)
    manifest = manifests.parse(text, f"{place}/{FILE_NAME}")
    if version and manifest.version != version:
        raise InputError(f"{place}: is archive {manifest.version}, but {version} was requested")
    chosen = manifest.chosen(subset, cases, seeds)
    with claimed(out), made_parent(out / FILE_NAME, make=False), names_full_disk(out):
        _check_same(out, manifest)
        missing = [packed for packed in chosen if not is_whole(out / packed.file, packed)]
        for packed in missing:
            if os.path.lexists(out / packed.file):
                raise InputError(
                    f"{out / packed.file}: is not the archive's file, or was changed since it was "
                    "fetched: move it away"
                )
        _check_room(out, missing)
        out.mkdir(parents=True, exist_ok=True)
        total, done = sum(packed.bytes for packed in missing), 0
        with progress.stage("fetch", max(total, 1)) as update:
            for packed in missing:
                _fetch_file(source, place, out, packed)
                done += packed.bytes
                update(done, f"{bytes_text(done)} of {bytes_text(total)}")
        if not (out / FILE_NAME).exists():
            manifests.write(out, manifest)
    return manifest, chosen


def is_whole(path: Path, sequence: PackedSequence) -> bool:
    """Whether a file is there with the size and hash that the manifest says."""
    try:
        if not path.is_file():  # a pipe would be waited for
            check_file(path)
        return path.stat().st_size == sequence.bytes and sha256_of(path) == sequence.sha256
    except OSError:
        return False


def verify(folder: Path) -> tuple[ArchiveManifest, tuple[PackedSequence, ...]]:
    """Reads all files of an archive, and returns its manifest and the sequences that are there."""
    manifest = manifests.read(folder)
    there = tuple(packed for packed in manifest.sequences if (folder / packed.file).exists())
    for packed in there:
        if not is_whole(inside(folder, packed.file), packed):
            path = folder / packed.file
            raise InputError(f"{path}: was changed or is incomplete: fetch it again")
    return manifest, there


def _read_manifest(source: Source, place: str) -> bytes:
    with _as_input_error(f"{place}/{FILE_NAME}"):
        file, _ = source(FILE_NAME, 0, -1)
        with file:
            text = file.read(TABLE_BYTES + 1)
    if len(text) > TABLE_BYTES:
        raise InputError(
            f"{place}/{FILE_NAME}: more than {TABLE_BYTES} bytes, which is no manifest; correct "
            "the address"
        )
    return text


def _check_same(out: Path, manifest: ArchiveManifest) -> None:
    if not os.path.lexists(out / FILE_NAME):
        return
    there = manifests.read(out)
    if there.version != manifest.version:
        raise InputError(
            f"{out}: holds archive {there.version}, this is {manifest.version}: choose another "
            "folder"
        )


def _check_room(out: Path, missing: Sequence[PackedSequence]) -> None:
    needed, free = sum(packed.bytes for packed in missing), free_bytes(out)
    if needed > free:
        raise InputError(
            f"{out}: {bytes_text(needed)} to download, but {bytes_text(free)} are free: free "
            "some space or choose another folder"
        )


def _fetch_file(source: Source, place: str, out: Path, packed: PackedSequence) -> None:
    """Fetches one file; broken connections are tried again, from where they broke."""
    target = out / packed.file
    with work_folder(target, resume=True) as work:
        partial = work / packed.file
        taken_up = partial.exists()
        _fetch_rest(source, place, partial, packed)
        if taken_up and not is_whole(partial, packed):  # what was left may have been of no use
            partial.unlink()
            _fetch_rest(source, place, partial, packed)
        if not is_whole(partial, packed):
            partial.unlink(missing_ok=True)
            raise InputError(
                f"{place}/{packed.file}: does not match the manifest's SHA-256: ask its publisher"
            )
        flush(partial)
        checked = partial.stat()
        with listing(out, {packed.file: FileFacts(packed.bytes, packed.sha256)}):
            try:
                link_new(partial, target)
            except FileExistsError as error:
                raise InputError(
                    f"{target}: was created during the download: move it away"
                ) from error
        now = target.stat()
        if (now.st_size, now.st_mtime_ns) != (checked.st_size, checked.st_mtime_ns):
            raise InputError(f"{target}: was changed while it was fetched: move it away")


def _fetch_rest(source: Source, place: str, partial: Path, packed: PackedSequence) -> None:
    for attempt in range(ATTEMPTS):
        try:
            _append(source, partial, packed)
        except _FAULTS:
            if attempt + 1 == ATTEMPTS or not _is_address(place):
                with _as_input_error(f"{place}/{packed.file}"):
                    raise
            time.sleep(_WAIT_S * 2**attempt)
        else:
            return


def _append(source: Source, partial: Path, packed: PackedSequence) -> None:
    # What somebody links to, or from, is not appended to.
    is_only_ours = partial.is_file() and not partial.is_symlink() and partial.stat().st_nlink == 1
    start = partial.stat().st_size if is_only_ours else 0
    if start == 0 or start > packed.bytes:
        partial.unlink(missing_ok=True)
        start = 0
    if start == packed.bytes:
        return
    content, begins = source(packed.file, start, packed.bytes)
    with content, partial.open("ab" if start else "xb") as file:
        if begins != start:  # a server that always sends all of it
            file.truncate(0)
        left = packed.bytes - (start if begins == start else 0)
        # One byte more shows a file that is too long without reading all of it.
        while left >= 0 and (block := content.read1(min(_STEP, left + 1))):
            file.write(block)
            left -= len(block)
    if left > 0:
        raise http.client.IncompleteRead(b"", left)


@contextmanager
def _as_input_error(what: str) -> Iterator[None]:
    """One line for whatever a network or a disk says."""
    try:
        yield
    except _FAULTS as error:
        reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or error
        code = f"HTTP {error.code}, " if isinstance(error, urllib.error.HTTPError) else ""
        raise InputError(
            f"{what}: cannot be fetched ({code}{printable(str(reason))}): correct the address, "
            "or try again: finished files are kept"
        ) from error
