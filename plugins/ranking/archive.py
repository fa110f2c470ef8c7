"""A suite's sequences, frozen: made once, and used instead of simulating by whoever fetched them.

What a graphics library draws differs from one to the next, so numbers of sequences that were drawn
anew are of another version. A hidden part is drawn from seeds that a secret decides: its sequences
are numbered, and nothing that is published says which seeds they have.
"""

from __future__ import annotations

import hashlib
import hmac
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eventsweep import scenes
from eventsweep.emvs.data import manifest as sequences
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.inputs import check_file, inside
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.emvs.utils.outputs import atomic_dir, check_output
from eventsweep.eval.jobs.job import SEQUENCE, Failed, Job, entry
from eventsweep.eval.jobs.scheduler import Open, run_jobs
from eventsweep.eval.progress import Display
from eventsweep.eval.results.results import ArchiveFacts
from eventsweep.eval.stages.map import as_perturbed
from eventsweep.eval.stages.perturb import write_perturbed
from eventsweep.eval.stages.simulate import scene_digest
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.given import is_given
from eventsweep.eval.suite.plan import simulated
from eventsweep.plugins.ranking.archives import manifest as manifests
from eventsweep.plugins.ranking.archives.manifest import (
    LICENCE,
    SUFFIX,
    ArchiveManifest,
    PackedFile,
    PackedSequence,
)
from eventsweep.plugins.ranking.archives.tarball import pack, unpack

SECRET_BYTES = 16
_MOST_SECRET_BYTES = 1 << 16


class SequenceArchive:
    """An archive in a folder, in which a suite finds its sequences; it must hold ground truth."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.manifest = manifests.read(folder)
        if not self.manifest.truth:
            raise InputError(
                f"{folder}: contains no ground truth, so it cannot be scored: ask whoever made "
                "it to score"
            )

    @property
    def facts(self) -> ArchiveFacts:
        """What results say of it."""
        own = self.manifest
        return ArchiveFacts(own.version, own.suite, own.part, own.secret_sha256)

    def seeds(self, cases: Sequence[str], asked: Sequence[int]) -> tuple[int, ...]:
        """The seeds of a run where none are said: those asked for that are there; all if hidden."""
        there = dict.fromkeys(seed for case in cases for seed in self.manifest.seeds(case))
        hidden = self.manifest.part == "hidden"
        return tuple(seed for seed in there if hidden or seed in asked) or tuple(asked)

    def sequence(self, suite: Suite, case: str, seed: int) -> tuple[Job, str]:
        """The job that unpacks the sequence of a case, and the hash of its scene."""
        packed = self.manifest.of(case, seed)
        if packed is None:
            raise InputError(f"{self.folder}: has no sequence of {case} with seed {seed}")
        if packed.drawn_from != drawn_from(suite, case):
            raise InputError(
                f"{self.folder}: {case} was simulated from a different definition than "
                f"{suite.name}'s: use the suite {self.manifest.suite}"
            )
        path = inside(self.folder, packed.file)
        if not path.is_file():
            raise InputError(f"{path}: is missing: fetch {case} with seed {seed}")
        files = {name: entry.model_dump() for name, entry in packed.files.items()}
        parameters = {**packed.drawn_from, "seed": seed, "files": files}
        stage = "eventsweep.plugins.ranking.unpack"
        return Job(f"unpack/{packed.place}", stage, parameters, (), (str(path),)), packed.scene


def drawn_from(suite: Suite, case: str) -> dict[str, Any]:
    """What a case's sequence is drawn from beside its seed: scene, rig, settings."""
    spec = suite.cases[case]
    rig = spec.rig or scenes.load(spec.scene).rig
    return {"scene": spec.scene, "rig": rig, "sim": suite.sim_of(spec)}


# Making one


@dataclass(frozen=True)
class ArchivePlan:
    """What is archived.

    Attributes:
        seeds: of every case; with a secret, numbers from 0.
        truth: whether ground truth is in it.
        secret: what decides the seeds of a hidden part; None for a public one.
    """

    suite: Suite
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    licence: str = LICENCE
    truth: bool = True
    secret: bytes | None = None

    def job(self, case: str, seed: int) -> Job:
        """The job that makes what is packed of a case and seed."""
        spec = self.suite.cases[case]
        if is_given(spec.scene):
            raise InputError(
                f"case {case}: its sequence is given, not drawn: archive a subset without it"
            )
        drawn = seed
        if self.secret is not None:
            drawn = hidden_seed(self.secret, self.suite.name, case, seed)
        sequence, _ = simulated(self.suite, case, drawn)
        if self.secret is not None:  # its name is printed where it fails
            sequence = Job(f"simulate/{case}/hidden{seed}", sequence.stage, sequence.parameters)
        if self.truth:
            return sequence
        parameters = {"perturb": spec.imperfection, "seed": seed}
        stage = "eventsweep.eval.stages.perturb"
        return Job(f"perturb/{case}/seed{seed}", stage, parameters, (sequence,))


def hidden_seed(secret: bytes, suite: str, case: str, number: int) -> int:
    """The seed of a hidden sequence: 63 bits of a keyed hash (HMAC-SHA256, RFC 2104).

    Nobody finds it without the secret, neither from its number nor by trying motions.
    """
    text = f"{suite}/{case}/{number}".encode()
    return int.from_bytes(hmac.digest(secret, text, "sha256")[:8]) >> 1


def read_secret(path: Path) -> bytes:
    """Reads a secret, such as `head -c 32 /dev/urandom > FILE` makes."""
    try:
        check_file(path, _MOST_SECRET_BYTES)
        secret = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); needs a secret") from error
    if len(secret.strip()) < SECRET_BYTES:
        raise InputError(
            f"{path}: {len(secret.strip())} bytes are too few for a secret, needs {SECRET_BYTES} "
            "or more: head -c 32 /dev/urandom makes one"
        )
    return secret


def make_archive(
    plan: ArchivePlan, out: Path, workers: Open, store: Cache, progress: Display, *, force: bool
) -> tuple[ArchiveManifest | None, tuple[Failed, ...]]:
    """Draws all sequences, or takes them from the cache, and packs them.

    Returns what was written, or nothing and the jobs that failed.
    """
    check_output(out, force=force)
    jobs = {(case, seed): plan.job(case, seed) for case in plan.cases for seed in plan.seeds}
    outcomes = run_jobs(list(jobs.values()), workers, progress)
    failed = tuple(outcome for outcome in outcomes.values() if isinstance(outcome, Failed))
    if failed:
        return None, failed
    with (
        atomic_dir(out, force=force, inputs=(plan.suite,)) as folder,
        progress.stage("pack", len(jobs)) as update,
    ):
        packed = []
        for (case, seed), job in jobs.items():
            made = entry(job, store)
            packed.append(_packed(plan, case, seed, made.path / SEQUENCE, folder))
            update(len(packed), packed[-1].place)
        manifest = _manifest(plan, packed, sequences.read(made.path / SEQUENCE))
        manifests.write(folder, manifest)
    return manifest, ()


def _packed(
    plan: ArchivePlan, case: str, seed: int, sequence: Path, folder: Path
) -> PackedSequence:
    drawn, entries = sequences.read(sequence), sequences.entries(sequence)
    own = hashed(sequence / sequences.FILE_NAME)._asdict()
    files = {name: PackedFile(**entry.model_dump()) for name, entry in entries.items()}
    files[sequences.FILE_NAME] = PackedFile(**own)
    file = f"{case}-seed{seed}{SUFFIX}"
    sha256, size = pack(folder / file, sequence, files)
    spec = plan.suite.cases[case]
    return PackedSequence(
        case=case,
        seed=seed,
        file=file,
        sha256=sha256,
        bytes=size,
        sequence=drawn.digest(),
        scene=scene_digest(spec.scene),
        drawn_from=drawn_from(plan.suite, case),
        imperfection=spec.imperfection if plan.truth else None,
        files=dict(sorted(files.items())),
    )


def _manifest(
    plan: ArchivePlan, packed: Sequence[PackedSequence], drawn: sequences.Manifest
) -> ArchiveManifest:
    hidden = plan.secret is not None
    return ArchiveManifest(
        suite=plan.suite.name,
        digest=plan.suite.digest,
        part="hidden" if hidden else "public",
        truth=plan.truth,
        licence=plan.licence,
        secret_sha256=hashlib.sha256(plan.secret).hexdigest() if plan.secret else "",
        renderer=drawn.renderer,
        versions=drawn.versions,
        subsets={n: (s.cases, s.seeds) for n, s in plan.suite.subsets.items()},
        sequences=tuple(packed),
    )


def unpack_recordings(
    folder: Path, chosen: Sequence[PackedSequence], out: Path, progress: Display, *, force: bool
) -> None:
    """Unpacks sequences as a method may read them: OUT/CASE/seedN, imperfect where a case is."""
    with (
        atomic_dir(out, force=force, inputs=(folder,)) as made,
        progress.stage("unpack", len(chosen)) as update,
    ):
        for number, packed in enumerate(chosen):
            place = made / packed.place
            if packed.imperfection is None:
                place.mkdir(parents=True)
                unpack(folder / packed.file, place, packed.files)
            else:
                _unpack_perturbed(folder / packed.file, packed, place)
            update(number + 1, packed.place)


def _unpack_perturbed(path: Path, packed: PackedSequence, place: Path) -> None:
    with tempfile.TemporaryDirectory(dir=place.parents[1]) as exact:
        unpack(path, Path(exact), packed.files)
        perturbation = {"perturb": packed.imperfection, "seed": packed.seed}
        place.parent.mkdir(exist_ok=True)
        write_perturbed(as_perturbed(open_recording(exact), perturbation), packed.seed, place)
