"""`eventsweep archive`: a suite's sequences, frozen, fetched, verified and unpacked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.eval.cli.app import COMMON, QUIET, Common, Force, Quiet, SuiteName
from eventsweep.eval.cli.help import HELP_FLAGS, Program
from eventsweep.eval.cli.job_flags import JOB_FLAGS, JobFlags, seed_numbers

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console
    from eventsweep.plugins.ranking.archives.manifest import ArchiveManifest, PackedSequence

Cases = Annotated[tuple[str, ...], Parameter(negative=(), help="Only this case, repeatable.")]
Part = Annotated[str, Parameter(help="Subset of the suite, such as quick.")]
Seeds = Annotated[str | None, Parameter(help="Only these seeds, such as 0,1,2.")]
Made = Annotated[Path, Parameter(help="Folder of `archive make` or `fetch`.")]

archive = Program(
    name="archive",
    help="Make, fetch, verify or unpack archives of a suite's sequences.",
    help_flags=HELP_FLAGS,
)


@archive.command
def make(
    name: SuiteName,
    /,
    *,
    out: Path,
    seeds: str | None = None,
    case: Cases = (),
    truth: bool = True,
    secret: Path | None = None,
    licence: str = "CC-BY-4.0",
    force: Force = False,
    job_flags: JobFlags = JOB_FLAGS,
    common: Common = COMMON,
) -> int:
    """Render a suite's sequences and pack them; equal sequences give equal bytes.

    Args:
        name: Such as suite-v5, quick, or FILE.toml.
        out: Folder to write: archive.json and a file for each case and seed.
        seeds: Seeds instead of the suite's own, such as 0,1,2; with --secret, numbers.
        truth: Include ground truth; without it methods can read the sequences, but nobody can score
            them.
        secret: File from which the seeds of a hidden part are drawn; only its hash is written.
        licence: Licence of the data, as an SPDX identifier.
    """
    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.eval.suite.definition import load
    from eventsweep.eval.suite.plan import extent
    from eventsweep.plugins.ranking.archive import ArchivePlan, make_archive, read_secret

    suite, subset = load(name)
    cases, numbers = extent(suite, subset, seed_numbers(seeds, "--seeds"), case)
    key = None if secret is None else read_secret(secret)
    plan = ArchivePlan(suite, cases, numbers, licence, truth, key)
    console, store = common.console(), Cache(job_flags.cache_folder())
    manifest, failed = make_archive(plan, out, job_flags.open, store, console.progress, force=force)
    if manifest is None:
        first = failed[0]
        console.warn(f"{len(failed)} jobs failed, the first: {first.name}: {first.reason}")
        return 1
    _show(console, manifest, manifest.sequences)
    console.wrote(out / "archive.json")
    return 0


@archive.command
def fetch(
    source: str,
    /,
    *,
    out: Path,
    part: Part = "",
    seeds: Seeds = None,
    case: Cases = (),
    version: Annotated[str, Parameter(name="--version-is")] = "",
    common: Common = COMMON,
) -> None:
    """Download an archive or a part of it, keep files already present, and verify all.

    Args:
        source: Address or folder that holds archive.json.
        out: Folder to write the files into.
        version: Refuse any archive but this one, such as 0123456789abcdef.
    """
    from eventsweep.plugins.ranking.archives.fetch import fetch as fetched

    console = common.console()
    manifest, chosen = fetched(
        source, out, console.progress, subset=part, cases=case,
        seeds=seed_numbers(seeds, "--seeds"), version=version,
    )  # fmt: skip
    _show(console, manifest, chosen)
    console.wrote(out)


@archive.command
def verify(folder: Made, /, *, common: Common = COMMON) -> None:
    """Read every file of an archive and compare its hash."""
    from eventsweep.plugins.ranking.archives.fetch import verify as verified

    _show(common.console(), *verified(folder))


@archive.command
def unpack(
    folder: Made,
    /,
    *,
    out: Path,
    part: Part = "",
    seeds: Seeds = None,
    case: Cases = (),
    force: Force = False,
    common: Quiet = QUIET,
) -> None:
    """Unpack sequences for your program: CASE/seedN, each as a mapper may read it.

    Args:
        out: Folder to write.
    """
    from eventsweep.plugins.ranking.archive import unpack_recordings
    from eventsweep.plugins.ranking.archives.manifest import read

    console = common.console()
    chosen = read(folder).chosen(part, case, seed_numbers(seeds, "--seeds"))
    unpack_recordings(folder, chosen, out, console.progress, force=force)
    console.wrote(out)


def _show(console: Console, manifest: ArchiveManifest, chosen: Sequence[PackedSequence]) -> None:
    from eventsweep.emvs.utils.files import bytes_text

    packed = sum(sequence.bytes for sequence in chosen)
    unpacked = sum(sequence.unpacked_bytes for sequence in chosen)
    facts = {
        **manifest.model_dump(include={"suite", "digest", "part", "truth", "licence"}),
        "version": manifest.version,
        "sequences": [sequence.place for sequence in chosen],
        "bytes": packed,
        "unpacked_bytes": unpacked,
    }
    line = (
        f"{manifest.suite}, {manifest.part}, version {manifest.version}: {len(chosen)} of "
        f"{len(manifest.sequences)} sequences, {bytes_text(packed)}, {bytes_text(unpacked)} "
        f"unpacked; {manifest.licence}; {'with' if manifest.truth else 'without'} ground truth"
    )
    console.result(facts, [line])
