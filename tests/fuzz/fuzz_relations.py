"""Random relations of inputs, outputs and files of others: `fuzz_relations.py [RELATIONS] [FIRST]`.

A world of a few folders with files of somebody is made, and `archive`, `cache`, `ranking` or
`submission` is called with places in it that may be each other's input, hold each other, or be
links to each other. Whatever it says, no file of somebody is lost or changed, it ends with 0, 1 or
2 and no traceback, and what it refuses is one line.
"""

import io
import json
import os
import shutil
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

# Run as a program, too: what it shares with the tests lies beside its folder, and in plug-ins.
ROOT = Path(__file__).parents[2]
SHARED = "tests/helpers", "tests/reference", "plugins/ranking/tests", "plugins/video/tests"
sys.path[:0] = [str(ROOT / name) for name in SHARED]

import numpy as np

import fuzz_results
from eventsweep.emvs.utils.cache import Cache, key_of
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.eval.cli.main import main as verb

PLACES = ("a", "b", "a/in", "b/in", "a/deep/er", "ours", "theirs", "theirs/pictures", "link")


def world(folder):
    """Sources of ours, and files that are somebody's; returns the latter's content."""
    for name in ("ours", "theirs", "cache", "suite", "a/in"):
        (folder / name).mkdir(parents=True)
    fuzz_results.ranking(folder / "ours")
    fuzz_results.suite(folder / "suite")
    archive(folder)
    Cache(folder / "cache").get(key_of("x"), "x", lambda out: (out / "made").write_text("made"))
    for name in ("theirs/index.html", "a/in/thesis.txt", "a/thesis.txt", "cache/notes.txt",
                 "theirs/archive.json.partial", "cache/th/thesis/entry.json"):  # fmt: skip
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"of somebody: {name}")


def archive(folder):
    place = folder / "archive"
    place.mkdir()
    (place / "w.tar.zst").write_bytes(b"packed" * 99)
    fuzz_results.archive(place)
    content = json.loads((place / "archive.json").read_text())
    facts = {"sha256": hashed(place / "w.tar.zst").sha256, "bytes": 594}
    content["sequences"] = [content["sequences"][0] | facts]
    (place / "archive.json").write_text(json.dumps(content))


def plant(folder, rng):
    """One more thing of somebody at a random place: a file, a link, a pipe, an empty folder."""
    names = (
        "index.html", "ranking.json", "w.tar.zst", "archive.json", "pictures", ".eventsweep.json",
    )  # fmt: skip
    place = folder / pick(PLACES, rng) / pick(names, rng)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        match pick(("file", "link", "pipe", "folder"), rng):
            case "file" if not place.exists():
                place.write_text("of somebody: planted")
            case "link":
                place.symlink_to(folder / pick(("a/thesis.txt", "theirs", "nowhere"), rng))
            case "pipe":
                os.mkfifo(place)
            case "folder":
                place.mkdir()


def pick(choices, rng):
    return choices[int(rng.integers(0, len(choices)))]


def words(folder, rng):
    """A call with places of the world."""
    place = lambda: str(folder / pick((*PLACES, "archive", "cache", "suite"), rng))  # noqa: E731
    suite = str(folder / "suite" / "suite.toml")
    return pick(
        (
            ("ranking", str(folder / "ours"), "--out", place()),
            ("ranking", place(), place(), "--out", place()),
            ("archive", "fetch", str(folder / "archive"), "--out", place()),
            ("archive", "fetch", place(), "--out", place()),
            ("archive", "verify", place()),
            ("archive", "unpack", place(), "--out", place(), "--force"),
            ("cache", "--cache", place(), "--prune", "0"),
            ("submission", "make", place(), "--suite", suite, "--out", place(), "--force"),
            ("submission", "check", place(), "--suite", suite),
        ),
        rng,
    )


def of_somebody(folder):
    """Every file of somebody: its path and what it says; sound sources and links count as well."""
    found = {}
    for parent, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(parent, name)
            if path.is_symlink():
                found[str(path)] = str(path.readlink())
            elif path.is_file() and (text := path.read_bytes()).startswith(b"of somebody"):
                found[str(path)] = text
    return found


def relation(folder, number):
    """One example; returns what is wrong, or an empty text."""
    rng = np.random.default_rng([32, number])
    world(folder)
    with suppress(OSError):
        (folder / "link").symlink_to(folder / pick(PLACES[:-1], rng))
    for _ in range(int(rng.integers(0, 4))):
        plant(folder, rng)
    before, asked, said = of_somebody(folder), words(folder, rng), io.StringIO()
    try:
        with redirect_stderr(said), redirect_stdout(io.StringIO()):
            code = verb([*asked, *(["--quiet"] if asked[0] == "ranking" else [])])
    except BaseException as error:  # whatever a verb lets through is a fault
        return f"{asked}: {type(error).__name__}: {error}"
    after = of_somebody(folder)
    lost = [path for path in before if before[path] != after.get(path)]
    if lost:
        return f"{asked}: lost {lost}"
    if code not in (0, 1, 2) or "Traceback" in said.getvalue():
        return f"{asked}: ends with {code}: {said.getvalue()[-300:]}"
    if code == 2 and said.getvalue().count("\n") != 1:
        return f"{asked}: more than a line: {said.getvalue()[-300:]}"
    return ""


def main(count="100", first="0"):
    faults = []
    for number in range(int(first), int(first) + int(count)):
        folder = Path(tempfile.mkdtemp())
        try:
            fault = relation(folder, number)
        finally:
            shutil.rmtree(folder)
        if fault:
            faults.append(number)
            sys.stdout.write(f"{number}: {fault}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{count} relations, {len(faults)} faults\n")
    return bool(faults)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
