"""Fuzzes the readers of results: `python plugins/ranking/tests/fuzz_results.py [N ...]`.

As `fuzz_datasets.py`, whose odd values it uses: in a sound ranking, suite, study, submission or
archive some values are replaced, everything that reads it is called, and the end is a page or an
`InputError` of one line.
"""

import json
import shutil
import sys
from pathlib import Path

# Run as a program, too: what it shares with the tests lies beside its folder.
TESTS = Path(__file__).parents[3] / "tests"
sys.path[:0] = [str(TESTS / name) for name in ("helpers", "reference", "fuzz")]

import tomli_w

import fuzz_datasets
import fuzz_events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, key_of
from eventsweep.eval.report.compare.page import write_comparison
from eventsweep.eval.report.suite_page import write_suite_report
from eventsweep.eval.report.suite_pictures import METHODS_NAME
from eventsweep.eval.results.results import (
    SUITE_NAME,
    JobNote,
    MeasuredCost,
    Results,
    Sample,
)
from eventsweep.eval.results.table import POOLED, tidy, together
from eventsweep.eval.suite import definition, output
from eventsweep.plugins.ranking.archives.manifest import ArchiveManifest, PackedFile, PackedSequence
from eventsweep.plugins.ranking.archives.manifest import parse as parse_archive
from eventsweep.plugins.ranking.archives.tarball import pack
from eventsweep.plugins.ranking.entries import DATA_NAME, RankingData
from eventsweep.plugins.ranking.facts import SubmissionFacts
from eventsweep.plugins.ranking.pages.page import write_ranking
from eventsweep.plugins.ranking.sources import read_source
from eventsweep.plugins.ranking.submission import MANIFEST, Asked, unpack_submission
from ranking_entries import entry
from score_rows import score_row
from small_suite import case, suite_text

COST = {"seconds_per_window": 0.5, "peak_memory_mb": 120.0, "hardware": "a laptop"}
FACTS = {"method": "Guess", "authors": ["A. Author"], "licence": "MIT", "url": None, "cost": COST}
ODD = (*fuzz_datasets.ODD, "\ud800", 1 << 63, 1 << 64, "../../x", "a\x1b]0;b\x07", {"x": [0] * 9})


def ranking(folder):
    one = entry("v1", {"Alg1/H": 0.1, "Given/Guess": 0.3}, seeds=2)
    one = one.model_copy(
        update={
            "stated": {"Given/Guess": SubmissionFacts.model_validate(FACTS)},
            "cost": {"Alg1/H": MeasuredCost("wall", 0.1, 200.0)},
            "perfect": {"Alg1/H": ["wall seed 0"]},
            "failures": {"map/x": "it broke"},
        }
    )
    (folder / DATA_NAME).write_text(RankingData(entries=(one,)).to_text())
    (folder / "pictures").mkdir()
    (folder / "pictures" / "a.webp").write_bytes(b"RIFF")
    about = {"best": {"file": "a.webp", "case": "wall", "abs_rel": 1.5, "error_cm": 8}}
    (folder / "pictures" / METHODS_NAME).write_text(json.dumps({"Alg1/H": about}))


def rank(folder):
    write_ranking([read_source(str(folder))], folder / "out")


def suite(folder):
    text = suite_text(case("wall"), case("late", [(0.01, 0.02)]), seeds=(0, 1))
    (folder / "suite.toml").write_text(text)
    found = definition.read(folder / "suite.toml")
    samples, rows = [], []
    for name in found.cases:
        for seed in (0, 1):
            samples.append(Sample(name, seed, "s", truth="t", scene="n", renderer="osmesa"))
            scored = [
                score_row(name, POOLED, method, metric, 0.1 + seed, "m", "lower")
                for method in ("Alg1/H", "Given/Guess")
                for metric in ("mean_error", "abs_rel", "points")
            ]
            rows.append(tidy(scored, seed))
    output.write(folder, Results(
        together(rows), samples=tuple(samples), suite=found.name, subset="all",
        digest=found.digest, definition=found.model_dump(mode="json"),
        cases={name: found.digest_of(name) for name in found.cases}, seeds=(0, 1),
        jobs=(JobNote("map/x", failure="it broke"), JobNote("map/y", "k", "c")),
        stated={"Given/Guess": FACTS}, cost={"Alg1/H": MeasuredCost("wall", 0.1, 200.0)},
    ))  # fmt: skip


def report_suite(folder):
    write_suite_report(folder)
    write_comparison([folder, folder], folder / "compared")
    rank(folder)


def submission(folder):
    """A manifest alone: what it says is looked at before anything else is read."""
    suite(folder)
    files = {
        f"{one.place}/{view.t_us}.npz": {"sha256": "0" * 64, "bytes": 9}
        for one in asked(folder).assignments()
        for view in one.views
    }
    content = {"suite": "pair", "cases": ["wall", "late"], "seeds": [0, 1], "facts": FACTS}
    (folder / MANIFEST).write_text(json.dumps({"schema_version": 1, **content, "files": files}))


def asked(folder):
    return Asked.of(definition.read(folder / "suite.toml"), "all", None)


def unpack(folder):
    pack(folder / "x.tar.zst", folder, [MANIFEST])
    (folder / "out").mkdir()
    unpack_submission(folder / "x.tar.zst", asked(folder), folder / "out")


def archive(folder):
    facts = {"sha256": "0" * 64, "bytes": 5, "sequence": "1" * 64, "scene": "s", "drawn_from": {}}
    files = {"manifest.json": PackedFile(sha256="0" * 64, bytes=1)}
    packed = PackedSequence(case="wall", seed=0, file="w.tar.zst", files=files, **facts)
    manifest = ArchiveManifest(suite="tiny", digest="d", sequences=(packed,),
                               subsets={"quick": (("wall",), (0,))})  # fmt: skip
    (folder / "archive.json").write_text(manifest.model_dump_json())


def read_archive(folder):
    found = parse_archive((folder / "archive.json").read_text(), str(folder / "archive.json"))
    assert found.chosen(version := "", (), None), version
    assert found.version


def cached(folder):
    Cache(folder / "cache").get(key_of("x"), "x", lambda out: (out / "a").write_text("a"))


def reuse(folder):
    store = Cache(folder / "cache")
    assert store.get(key_of("x"), "x", lambda out: (out / "a").write_text("a")).files == ("a",)
    store.prune(0)


def definition_of(folder):
    (folder / "s.toml").write_text(suite_text(case("wall")))
    (folder / "s.json").write_text(json.dumps(
        definition.read(folder / "s.toml").model_dump(mode="json", exclude_none=True)
    ))  # fmt: skip


def read_definition(folder):
    text = (folder / "s.json").read_text()
    try:
        (folder / "s.toml").write_text(tomli_w.dumps(json.loads(text)))
    except (TypeError, ValueError, AttributeError, RecursionError):
        return  # TOML has no such value
    found = definition.read(folder / "s.toml")
    for name in found.cases:
        Asked.of(found, "all", None).assignments()
        found.digest_of(name)


KINDS = {
    "ranking": (ranking, DATA_NAME, rank),
    "pictures": (ranking, f"pictures/{METHODS_NAME}", rank),
    "suite": (suite, SUITE_NAME, report_suite),
    "submission": (submission, MANIFEST, unpack),
    "archive": (archive, "archive.json", read_archive),
    "cache": (cached, "entry.json", reuse),
    "definition": (definition_of, "s.json", read_definition),
}


def begin(folder, kind):
    """What one example of a kind does."""
    make, name, read = KINDS[kind]
    source, target = Path(folder) / "sound", Path(folder) / "damaged"
    source.mkdir()
    make(source)
    shutil.copytree(source, target)
    if kind != "submission":
        read(target)
    shutil.rmtree(target)
    place = next(source.rglob(name)).relative_to(source)

    def example(rng):
        shutil.copytree(source, target)
        file = target / place
        if rng.random() < 0.1:
            text = "[" * 200_000 if rng.random() < 0.5 else '{"a":' * 100_000
        else:
            text = json.dumps(fuzz_datasets.odd(json.loads(file.read_text()), rng, ODD))
        file.write_text(text)
        try:
            read(target)
            return True
        except InputError as error:
            fuzz_events.assert_proper(error, "")
            return None
        finally:
            shutil.rmtree(target)

    return example


if __name__ == "__main__":
    words = sys.argv[1:] or ["100"]
    raise SystemExit(fuzz_events.main(*words, kinds=[*KINDS], begin=begin))
