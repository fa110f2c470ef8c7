"""What an archive of sequences holds: a file for each case and seed, with hashes and sizes.

Everything that unpacking may write is said here, name by name and byte by byte; nothing inside the
files is believed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from eventsweep.emvs.data.manifest import FileEntry
from eventsweep.emvs.errors import InputError, offer, repeated
from eventsweep.emvs.parameters import FrozenModel, first_fault
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, inside
from eventsweep.emvs.utils.outputs import files_together

SCHEMA_VERSION = 1
FILE_NAME = "archive.json"
SUFFIX = ".tar.zst"
LICENCE = "CC-BY-4.0"
Part = Literal["public", "hidden"]

_Plain = r"[A-Za-z0-9][A-Za-z0-9_-]*(?:\.[A-Za-z0-9_-]+)*"
_Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_Name = Annotated[str, Field(pattern=rf"^{_Plain}$", max_length=100)]
_Path = Annotated[str, Field(pattern=rf"^{_Plain}(?:/{_Plain})*$", max_length=200)]
_Bytes = Annotated[int, Field(ge=0, le=1 << 40)]


class PackedFile(FileEntry):
    """One file of a sequence, as it is unpacked; only what a hash and a size can be."""

    sha256: _Sha256
    bytes: _Bytes


class PackedSequence(FrozenModel):
    """The sequence of one case and seed.

    Attributes:
        case: name of the case.
        seed: of the sequence; in a hidden part its number, from 0.
        file: name of the file beside the manifest that holds it.
        sha256: of that file.
        bytes: of that file.
        sequence: hash over the sequence's own files, as results name it.
        scene: hash over what defined the scene.
        drawn_from: scene, rig and settings of the simulator that it was drawn from.
        imperfection: errors added to what a mapper is given; none where they are in it already.
        files: what is in it, by name.
    """

    case: _Name
    seed: Annotated[int, Field(ge=0)]
    file: Annotated[str, Field(pattern=rf"^{_Plain}$", max_length=120)]
    sha256: _Sha256
    bytes: _Bytes
    sequence: _Sha256
    scene: str
    drawn_from: dict[str, Any]
    imperfection: dict[str, float] | None = None
    files: Annotated[dict[_Path, PackedFile], Field(min_length=1, max_length=1000)]

    @property
    def place(self) -> str:
        """What it is called: CASE/seedN."""
        return f"{self.case}/seed{self.seed}"

    @property
    def unpacked_bytes(self) -> int:
        """All its files together."""
        return sum(entry.bytes for entry in self.files.values())


class ArchiveManifest(FrozenModel):
    """A set of archived sequences; the same definition drawn anew is another one.

    Attributes:
        schema_version: of this layout.
        suite: name of the suite that the cases are of.
        digest: hash over the definition that they were drawn from.
        part: `public`, or `hidden`: of seeds that a secret decides.
        truth: whether ground truth is in it; without, it is what a method may read.
        licence: of the data, as SPDX names it.
        secret_sha256: hash of the secret of a hidden part; empty in a public one.
        renderer: what drew the pictures.
        versions: of everything that shaped the sequences.
        subsets: cases and seeds of the suite's subsets, by name.
        sequences: by case and seed.
    """

    schema_version: int = SCHEMA_VERSION
    suite: _Name
    digest: str
    part: Part = "public"
    truth: bool = True
    licence: Annotated[str, Field(min_length=1, max_length=200)] = LICENCE
    secret_sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""
    renderer: str = ""
    versions: dict[str, str] = Field(default_factory=dict)
    subsets: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = Field(default_factory=dict)
    sequences: Annotated[tuple[PackedSequence, ...], Field(min_length=1, max_length=100_000)]

    @model_validator(mode="after")
    def _each_once(self) -> ArchiveManifest:
        for name in ("file", "place"):
            twice = repeated(getattr(entry, name) for entry in self.sequences)
            if twice is not None:
                raise ValueError(f"{twice} is listed twice")
        return self

    @property
    def version(self) -> str:
        """What results call it: a hash over all sequences, equal where the data are equal."""
        facts = sorted((entry.case, entry.seed, entry.sequence) for entry in self.sequences)
        text = json.dumps([self.suite, self.part, facts])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def of(self, case: str, seed: int) -> PackedSequence | None:
        """The sequence of a case and seed, if it is listed."""
        return next((s for s in self.sequences if (s.case, s.seed) == (case, seed)), None)

    def seeds(self, case: str) -> tuple[int, ...]:
        """The seeds of a case."""
        return tuple(entry.seed for entry in self.sequences if entry.case == case)

    def chosen(
        self, subset: str = "", cases: Sequence[str] = (), seeds: Sequence[int] | None = None
    ) -> tuple[PackedSequence, ...]:
        """The sequences of a subset, of cases or of seeds; by default all."""
        if subset and subset not in self.subsets:
            known = offer(self.subsets, "it has none, name cases")
            raise InputError(f"the archive has no part {subset!r}: {known}")
        its_cases, its_seeds = self.subsets.get(subset, ((), ()))
        for case in set(cases) - {entry.case for entry in self.sequences}:
            raise InputError(f"the archive of {self.suite} has no case {case!r}")
        chosen = tuple(
            entry
            for entry in self.sequences
            if (not cases or entry.case in cases)
            and (seeds is None or entry.seed in seeds)
            and (not subset or (entry.case in its_cases and entry.seed in its_seeds))
        )
        if not chosen:
            raise InputError(f"the archive of {self.suite} has none of the requested sequences")
        return chosen


def parse(text: bytes | str, where: str) -> ArchiveManifest:
    """Reads a manifest that somebody else wrote."""
    try:
        manifest = ArchiveManifest.model_validate_json(text)
    except ValidationError as error:
        raise InputError(f"{where}: not an archive's manifest ({first_fault(error)})") from error
    if manifest.schema_version != SCHEMA_VERSION:
        raise InputError(
            f"{where}: schema version {manifest.schema_version}, needs {SCHEMA_VERSION}: create or "
            "fetch the archive again"
        )
    return manifest


def read(folder: Path) -> ArchiveManifest:
    """Reads the manifest in a folder."""
    path = inside(folder, FILE_NAME)
    try:
        check_file(path, TABLE_BYTES)
        text = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{folder}: no {FILE_NAME}; needs a folder of `eventsweep archive make` or `fetch`"
        ) from error
    return parse(text, str(path))


def write(folder: Path, manifest: ArchiveManifest) -> None:
    """Writes the manifest into a folder beside others, and lists it there as ours."""
    with files_together(folder, (FILE_NAME,)) as staged:
        text = manifest.model_dump_json(indent=1) + "\n"
        (staged / FILE_NAME).write_text(text, encoding="utf-8")
