"""A submission: what a method found for a suite in one file, with who made it and what it costs.

Made from the folder of a [prediction](predictions) that holds a `submission.toml`, or of one file
per sequence (`files`), and checked as far as no truth is needed. Nothing in such a file is
believed: what may be in it, and how large it may be, follows from the suite.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import Field, ValidationError

from eventsweep.emvs.errors import DAMAGED_NPY, InputError, located, quoted, refused, repeated
from eventsweep.emvs.parameters import FrozenModel, first_fault
from eventsweep.emvs.utils.cache import Cache, key_of
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.emvs.utils.outputs import output_file
from eventsweep.eval.scoring.predictions import (
    DESCRIPTION,
    NamedFolder,
    Prediction,
    TargetView,
    described,
    method_name,
    plain,
    timed_files,
)
from eventsweep.eval.suite.definition import ALL, Suite
from eventsweep.eval.suite.packages import Wanted
from eventsweep.eval.suite.predictions import Assignment, assignment, open_predictions
from eventsweep.plugins.ranking.archives.manifest import ArchiveManifest, PackedFile
from eventsweep.plugins.ranking.archives.tarball import first_member, pack, unpack
from eventsweep.plugins.ranking.facts import FACTS, AnyFacts, FileFacts, read_facts
from eventsweep.plugins.ranking.files import (
    MOST_BYTES,
    SUFFIXES,
    check_content,
    file_names,
    stage_files,
)

MANIFEST = ".manifest.json"
PACKAGE = "maps.tar.zst"
"""Of an entry."""
SCHEMA_VERSION = 1
_MANIFEST_BYTES = 1 << 24
_ARRAYS = {"depth_m.npy", "mask.npy", "confidence.npy"}
# Depth, confidence and a mask of 8 bytes per pixel each, and what files say of themselves.
_PIXEL_BYTES, _FILE_BYTES = 24, 1 << 16


class SubmissionManifest(FrozenModel):
    """The first file of a submission.

    Attributes:
        schema_version: of this layout.
        suite: name of the suite.
        archive: version of the archive that was read; empty where none was said.
        seeds: of every case; numbers in a hidden part.
        cases: of the suite.
        may_be_empty: whether a depth map may hold no depth.
        facts: what is submitted.
        files: size and hash of every other file.
    """

    schema_version: int = SCHEMA_VERSION
    suite: str
    archive: str = ""
    cases: Annotated[tuple[str, ...], Field(min_length=1, max_length=1000)]
    seeds: Annotated[tuple[int, ...], Field(min_length=1, max_length=1000)]
    may_be_empty: bool = False
    facts: AnyFacts
    files: dict[str, PackedFile]


@dataclass(frozen=True)
class Asked(Wanted):
    """What a submission must hold: cases and seeds of a `subset` of the suite."""

    subset: str = ALL

    @property
    def name(self) -> str:
        """Suite and subset, as `load` takes them."""
        return self.suite.name if self.subset == ALL else f"{self.suite.name}:{self.subset}"

    @classmethod
    def of(cls, suite: Suite, subset: str, archive: ArchiveManifest | None) -> Asked:
        """All of a subset; of an archive, what is in it."""
        chosen = suite.subset(subset)
        if archive is None:
            return cls(suite, chosen.cases, chosen.seeds, subset=subset)
        cases = tuple(case for case in chosen.cases if archive.seeds(case))
        if not cases:
            raise InputError(f"the archive of {archive.suite} has no case of {suite.name}")
        hidden = archive.part == "hidden"
        there = archive.seeds(cases[0])
        seeds = tuple(seed for seed in there if hidden or seed in chosen.seeds)
        return cls(suite, cases, seeds, archive.version, subset)

    def assignments(self) -> list[Assignment]:
        """One for each case and its seeds."""
        return [
            assignment(self.suite, case, seed)
            for case in self.cases
            for seed in self.seeds
            if not self.suite.leaves_out(case, seed)
        ]

    def views(self) -> dict[str, TargetView]:
        """The views, by the name of their file in a submission."""
        return {
            f"{sample.place}/{view.t_us}.npz": view
            for sample in self.assignments()
            for view in sample.views
        }


def make_submission(folder: Path, asked: Asked, out: Path, *, force: bool) -> SubmissionManifest:
    """Checks a folder with depth maps or files, and `submission.toml`, and packs it into a file.

    Depth is stored in metres as 32-bit numbers, whatever the folder's files hold; other files are
    packed as they are.

    Args:
        folder: as `open_predictions` takes it, or with `CASE/seedN` files of the facts' track.
        asked: what it must hold.
        out: the file to write.
        force: whether a file that is there is replaced.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; needs one with depth maps and {FACTS}")
    facts = read_facts(folder)
    with output_file(out, force=force, inputs=(folder,)) as path:
        stage = path.with_name("staged")  # a kill leaves it where the next call removes it
        if isinstance(facts, FileFacts):
            names, may_be_empty = stage_files(folder, facts, asked, stage), False
        else:
            names, may_be_empty = sorted(asked.views()), _stage_maps(folder, asked, stage)
        manifest = SubmissionManifest(
            suite=asked.suite.name,
            archive=asked.archive,
            cases=asked.cases,
            seeds=asked.seeds,
            may_be_empty=may_be_empty,
            facts=facts,
            files={name: PackedFile(**hashed(stage / name)._asdict()) for name in sorted(names)},
        )
        (stage / MANIFEST).write_text(manifest.model_dump_json(), encoding="utf-8")
        # Sorted, the manifest comes first: nothing else begins with a dot.
        pack(path, stage, [MANIFEST, *manifest.files])
    return manifest


def _stage_maps(folder: Path, asked: Asked, stage: Path) -> bool:
    """Writes the depth maps that are packed; returns whether some may be empty."""
    (prediction,) = open_predictions([NamedFolder(folder)], asked.suite, asked.assignments())
    for sample in asked.assignments():
        files = timed_files(folder, prediction.description, sample.place)
        _export(Prediction(prediction.name, files, prediction.description), sample, stage)
    return prediction.description.may_be_empty


def _export(prediction: Prediction, asked: Assignment, stage: Path) -> None:
    for view in asked.views:
        depth_m, _ = prediction.depth_m(view)
        confidence = prediction.confidence(view)
        arrays: dict[str, Any] = {"depth_m": depth_m}
        if confidence is not None:
            arrays["confidence"] = confidence.astype(np.float32)
        path = stage / asked.place / f"{view.t_us}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **arrays)


def read_manifest(path: Path) -> SubmissionManifest:
    """Reads the first file of a submission, and nothing else of it."""
    return _parsed(path, first_member(path, MANIFEST, _MANIFEST_BYTES))


def _parsed(path: Path, text: bytes) -> SubmissionManifest:
    try:
        manifest = SubmissionManifest.model_validate_json(text)
    except ValidationError as error:
        fault = first_fault(error)
        raise InputError(f"{path}: its manifest: {fault}: create it again") from error
    if manifest.schema_version != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {manifest.schema_version}, needs {SCHEMA_VERSION}: create "
            "it again"
        )
    return manifest


def check_submission(path: Path, asked: Asked) -> AnyFacts:
    """Reads all of a submission, or of a folder that one is to be made of; no truth is needed."""
    with TemporaryDirectory() as place:
        if path.is_dir():
            facts = read_facts(path)
            if isinstance(facts, FileFacts):
                stage_files(path, facts, asked, Path(place))
                return facts
        else:
            facts, path = unpack_submission(path, asked, Path(place)).facts, Path(place)
        if not isinstance(facts, FileFacts):
            open_predictions([NamedFolder(path)], asked.suite, asked.assignments())
    return facts


def opened_files(path: Path, asked: Wanted, out: Path) -> tuple[FileFacts, Path, dict[str, str]]:
    """The files of a submission, an entry or a folder, for scoring.

    Args:
        path: what holds them, checked.
        asked: what it must hold.
        out: an empty folder to unpack into.

    Returns:
        What is submitted, the folder of its files, and the file of each sequence.

    Raises:
        InputError: it is of depth maps, which a suite scores.
    """
    folder, facts = path, None
    if path.is_dir() and (path / FACTS).exists():
        facts = read_facts(path)
    if facts is None:
        package = path / PACKAGE if path.is_dir() else path
        facts, folder = unpack_submission(package, asked, out).facts, out
    if not isinstance(facts, FileFacts):
        raise InputError(f"{path}: holds depth maps: give it to `suite` as --prediction")
    there = [file.relative_to(folder).as_posix() for file in folder.glob("*/*") if file.is_file()]
    kept = [name for name in there if name.endswith(SUFFIXES[facts.track])]
    return facts, folder, file_names(kept, facts.track, asked)


def unpack_submission(path: Path, asked: Wanted, out: Path) -> SubmissionManifest:
    """Unpacks a submission into an empty folder; depth maps as `open_predictions` takes them."""
    text = first_member(path, MANIFEST, _MANIFEST_BYTES)
    manifest = _parsed(path, text)
    if manifest.suite != asked.suite.name:
        raise InputError(f"{path}: is for {manifest.suite}, not for {asked.suite.name}")
    if asked.archive and manifest.archive and manifest.archive != asked.archive:
        raise InputError(
            f"{path}: is for archive {manifest.archive}, not for {asked.archive}: those are "
            "different sequences"
        )
    claimed = _claimed(path, manifest, asked)
    own = PackedFile(sha256=hashlib.sha256(text).hexdigest(), bytes=len(text))
    members = {MANIFEST: own, **manifest.files}
    if isinstance(manifest.facts, FileFacts):
        with located(path):
            _unpack_files(path, manifest, manifest.facts.track, claimed, out, members)
        return manifest
    views = claimed.views()
    _check_files(path, manifest, views)
    unpack(path, out, members)
    for name, view in views.items():
        _check_arrays(path, out / name, name, view)
    facts = {"name": manifest.facts.method, "may_be_empty": manifest.may_be_empty}
    (out / DESCRIPTION).write_text(tomli_w.dumps(facts), encoding="utf-8")
    return manifest


def _unpack_files(
    path: Path, manifest: SubmissionManifest, track: str, claimed: Asked, out: Path,
    members: Mapping[str, PackedFile],
) -> None:  # fmt: skip
    names = file_names(list(manifest.files), track, claimed).values()
    for name in names:
        if manifest.files[name].bytes > MOST_BYTES:
            raise InputError(f"{name}: more than {MOST_BYTES} bytes: leave points out")
    unpack(path, out, members)
    for name in names:
        try:
            check_content(out / name, track)
        except InputError as error:  # where it was unpacked says nothing
            raise InputError(str(error).replace(f"{out}/", "")) from error


def _claimed(path: Path, manifest: SubmissionManifest, asked: Wanted) -> Asked:
    """What a submission says it holds: known cases, and all that is asked for."""
    # Every pair of a case and a seed is looked up: none twice, no seed that no suite asks for.
    twice = repeated(manifest.cases) or repeated(map(str, manifest.seeds))
    if twice is not None:
        raise InputError(f"{path}: {quoted(twice)} is listed twice: create it again")
    parts = [subset.seeds for subset in asked.suite.subsets.values()]
    known = {*asked.seeds, *asked.suite.seeds, *chain.from_iterable(parts)}
    strange = next((seed for seed in manifest.seeds if seed not in known), None)
    for case in manifest.cases:
        if case not in asked.suite.cases:
            raise InputError(f"{path}: {asked.suite.name} has no case {case!r}: create it again")
    for what, wanted, there in (
        ("the case", asked.cases, manifest.cases),
        ("the seed", asked.seeds, manifest.seeds),
    ):
        lacking = [str(value) for value in wanted if value not in there]
        if lacking:
            raise InputError(
                f"{path}: {what} {', '.join(lacking)} is missing: create it with all of them"
            )
    if strange is not None:
        raise InputError(f"{path}: {asked.suite.name} has no seed {strange}: create it again")
    return Asked(asked.suite, manifest.cases, manifest.seeds)


def _check_files(path: Path, manifest: SubmissionManifest, views: Mapping[str, TargetView]) -> None:
    for name, view in views.items():
        if name not in manifest.files:
            raise InputError(f"{path}: {name} is missing: create it again")
        size, most = manifest.files[name].bytes, _most_bytes(view)
        if size > most:
            raise InputError(f"{path}: {name} of {size} bytes, at most {most}: create it again")
    strange = next((name for name in manifest.files if name not in views), None)
    if strange is not None:
        raise InputError(f"{path}: {quoted(strange)} is no view of the suite: create it again")


def _most_bytes(view: TargetView) -> int:
    return _FILE_BYTES + _PIXEL_BYTES * view.width_px * view.height_px


def _check_arrays(path: Path, file: Path, name: str, view: TargetView) -> None:
    """Refuses an npz that would unpack to more than its view has pixels, before it is read."""
    what = f"{path}: {name} is damaged"
    with refused(what, *DAMAGED_NPY, cure=": create it again"), zipfile.ZipFile(file) as arrays:
        members = arrays.infolist()
    most = _most_bytes(view)
    names = [member.filename for member in members]
    if not set(names) <= _ARRAYS or len(set(names)) < len(names):
        raise InputError(f"{path}: {name} holds other arrays than depth_m, mask and confidence")
    if sum(member.file_size for member in members) > most:
        raise InputError(f"{path}: {name} unpacks to more than {most} bytes: create it again")


def opened(
    given: Sequence[NamedFolder], wanted: Wanted, cache: Cache
) -> tuple[list[NamedFolder], dict[str, dict[str, Any]]]:
    """Folders of predictions, submissions unpacked, and what each says of itself.

    Args:
        given: folders, or files of `make_submission`.
        wanted: what they must hold.
        cache: where submissions are unpacked, once.

    Returns:
        The folders; and by the method's name in scores, facts of those that state them.
    """
    folders: list[NamedFolder] = []
    stated: dict[str, dict[str, Any]] = {}
    for folder in given:
        facts = None
        if folder.path.is_file():
            folder, facts = _in_cache(folder, wanted, cache)
        elif (folder.path / FACTS).exists():
            facts = read_facts(folder.path)
            folder = NamedFolder(folder.path, folder.name or plain(facts.method))
        if isinstance(facts, FileFacts):
            raise InputError(
                f"{given[len(folders)].path}: has no depth maps, it is of the track {facts.track}: "
                "score it with `submission score`"
            )
        folders.append(folder)
        if facts is not None:
            stated[method_name(folder, described(folder.path))] = facts.model_dump(mode="json")
    return folders, stated


def _in_cache(
    submission: NamedFolder, wanted: Wanted, cache: Cache
) -> tuple[NamedFolder, AnyFacts]:
    facts = {
        "submission": hashed(submission.path).sha256,
        "suite": wanted.suite.digest,
        "asked": [wanted.cases, wanted.seeds, wanted.archive],
    }

    def fill(out: Path) -> None:
        unpack_submission(submission.path, wanted, out)

    entry = cache.get(key_of(facts), facts, fill)
    return NamedFolder(entry.path, submission.name), read_manifest(submission.path).facts
