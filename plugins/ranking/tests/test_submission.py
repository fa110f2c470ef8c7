"""Submissions: made, checked without truth, refused in one line, and scored as predictions are."""

import json
import os
import shutil
import subprocess
import sys
import tempfile

import numpy as np
import pytest

from blank_pictures import blank_pictures
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.utils.output_manifest import NAME
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from eventsweep.eval.suite.definition import read as read_definition
from eventsweep.plugins.ranking.archives.tarball import pack, sha256_of, unpack
from eventsweep.plugins.ranking.entry import ENTRY, read_entry
from eventsweep.plugins.ranking.entry import PACKAGE as MAPS
from eventsweep.plugins.ranking.submission import MANIFEST, Asked, read_manifest
from places import ROOT
from refusals import command_refused
from small_suite import case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

SUITE = suite_text(case("wall"), case("late", [(0.01, 0.02)]))
FACTS = """
method = "Guess"
authors = ["A. Author", "Ü. Österreich"]
licence = "CC-BY-4.0"
url = "https://example.org/guess"

[cost]
seconds_per_window = 0.5
peak_memory_mb = 120
hardware = "one core of a laptop"
"""
NAMES = ("wall/seed0/10000.npz", "wall/seed0/30000.npz", "late/seed0/20000.npz")
SIZE = (180, 240)


def depth(number, shape=SIZE):
    return np.full(shape, 2.0) + np.random.default_rng(number).uniform(0, 0.1, shape)


@pytest.fixture
def place(tmp_path):
    """What an outsider has: the suite's file, and depth maps that nobody's truth went into."""
    (tmp_path / "pair.toml").write_text(SUITE)
    theirs = tmp_path / "theirs"
    for number, name in enumerate(NAMES):
        (theirs / name).parent.mkdir(parents=True, exist_ok=True)
        np.savez(theirs / name, depth_m=depth(number), confidence=np.ones(SIZE))
    (theirs / "submission.toml").write_text(FACTS)
    return tmp_path


def making(place, *more):
    words = ["submission", "make", place / "theirs", "--suite", place / "pair.toml"]
    return [str(word) for word in (*words, "--out", place / "guess.tar.zst", *more)]


def make(place, *more):
    return main(making(place, *more))


def checking(place, *paths):
    paths = paths or [place / "guess.tar.zst"]
    return ["submission", "check", *map(str, paths), "--suite", str(place / "pair.toml")]


def check(place, *paths):
    return main(checking(place, *paths))


def test_what_is_right_is_made_and_found_right(place, capsys):
    assert make(place) == 0
    out = capsys.readouterr().out
    assert "Guess by A. Author, Ü. Österreich, CC-BY-4.0: 3 depth maps for pair are" in out
    assert check(place) == check(place, place / "theirs") == 0
    manifest = read_manifest(place / "guess.tar.zst")
    assert (set(manifest.files), manifest.facts.cost.peak_memory_mb) == (set(NAMES), 120)


def test_it_is_the_same_bytes_each_time_and_the_same_numbers(place):
    assert make(place) == 0
    first = sha256_of(place / "guess.tar.zst")
    assert make(place, "--force", "--quiet") == 0
    assert sha256_of(place / "guess.tar.zst") == first
    manifest = read_manifest(place / "guess.tar.zst")
    (place / "out").mkdir()
    unpack(place / "guess.tar.zst", place / "out", {**manifest.files, MANIFEST: _Any()})
    with np.load(place / "out" / NAMES[1]) as stored:
        np.testing.assert_array_equal(stored["depth_m"], np.float32(depth(1)))


class _Any:
    sha256, bytes = "", 1 << 20


def test_what_a_kill_leaves_the_next_call_removes(place, monkeypatch):
    temporary = place / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    before = {*place.iterdir()}
    child = os.fork()
    if child == 0:
        monkeypatch.setattr("eventsweep.plugins.ranking.submission.pack", lambda *_: os._exit(9))
        os._exit(make(place))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    assert list(temporary.iterdir()) == []  # nobody would look there
    assert {*place.iterdir()} > before
    assert make(place) == 0
    assert {*place.iterdir()} - before == {place / "guess.tar.zst", place / NAME}


def test_disparities_are_stored_as_depth(place):
    for name in NAMES:
        path = place / "theirs" / name
        with np.load(path) as stored:
            np.save(path.with_suffix(".npy"), 40.0 / stored["depth_m"])
        path.unlink()
    (place / "theirs" / "prediction.toml").write_text(
        'quantity = "disparity"\nbaseline_m = 0.2\nfocal_px = 200.0\n'
    )
    assert make(place, "--quiet") == 0
    assert check(place) == 0


# Entries: a folder in a pull request
def entering(place, name="guess", *more):
    words = ["submission", "enter", place / "theirs", "--suite", place / "pair.toml"]
    return [str(word) for word in (*words, "--out", place / "submissions" / name, *more)]


def entered(place, *more):
    return main(entering(place, *more))


def test_an_entry_is_a_folder_that_a_command_makes_and_another_checks(place, capsys):
    assert entered(place) == 0
    folder = place / "submissions" / "guess"
    assert {path.name for path in folder.iterdir()} == {ENTRY, MAPS, NAME}
    assert read_entry(folder).sha256 == sha256_of(folder / MAPS)
    (folder / NAME).unlink()  # whoever commits the folder may leave it out
    capsys.readouterr()
    assert check(place, folder) == 0
    assert "Guess by A. Author" in capsys.readouterr().out


def test_an_entry_for_a_subset_is_checked_for_that_subset_alone(place, capsys):
    path = place / "pair.toml"
    subset = '[subsets.near]\ncases = ["wall"]\nseeds = [0]'
    path.write_text(suite_text(case("wall"), case("late"), more=subset))
    out = place / "submissions" / "guess"
    theirs, suite = str(place / "theirs"), f"{path}:near"
    assert main(["submission", "enter", theirs, "--suite", suite, "--out", str(out)]) == 0
    assert "2 depth maps for pair:near are complete" in capsys.readouterr().out
    assert read_entry(out).suite == "pair:near"
    assert check(place, out) == 0


def text_in(name, old, new):
    def spoil(folder):
        path = folder / name
        path.write_text(path.read_text().replace(old, new))

    return spoil


SPOILT_ENTRIES = {
    "another package": (lambda f: (f / MAPS).write_bytes(b"x"), "its SHA-256 is"),
    "no package": (lambda f: (f / MAPS).unlink(), "is missing"),
    "a linked package": (
        lambda f: ((f / MAPS).rename(f.parent / "p"), (f / MAPS).symlink_to("../p")), "is a link",
    ),
    "a file too many": (lambda f: (f / "run.sh").write_text("x"), "run.sh does not belong"),
    "another suite": (text_in(ENTRY, '"pair"', '"quick"'), "is for quick, not for pair"),
    "a suite that is a path": (text_in(ENTRY, '"pair"', '"../pair"'), "suite"),
    "no hash": (text_in(ENTRY, "sha256", "sha"), "sha256"),
    "not TOML": (lambda f: (f / ENTRY).write_text("x = ["), "not TOML"),
    "a strange key": (text_in(ENTRY, "suite =", 'more = 1\nsuite ='), "more"),
}  # fmt: skip


@pytest.mark.parametrize("kind", SPOILT_ENTRIES)
def test_what_is_wrong_with_an_entry_is_one_line(place, capsys, kind):
    spoil, words = SPOILT_ENTRIES[kind]
    assert entered(place, "guess", "--quiet") == 0
    folder = place / "submissions" / "guess"
    spoil(folder)
    assert words in command_refused(capsys, *checking(place, folder))


def test_names_of_entries_and_of_methods_are_checked(place, capsys):
    assert "needs a name of a to z" in command_refused(capsys, *entering(place, "Gu_ess"))
    assert not (place / "submissions").exists()
    assert entered(place, "one", "--quiet") == entered(place, "two", "--quiet") == 0
    both = [place / "submissions" / name for name in ("one", "two")]
    assert check(place, *both) == 2  # after the first was found right
    assert "is called 'Guess' as well" in capsys.readouterr().err
    for name, said in (("theirs", "give its --suite"), ("nowhere", "nowhere: no such file")):
        assert said in command_refused(capsys, "submission", "check", place / name)


# What is wrong with a folder
def put(depth_m, name=NAMES[0]):
    return lambda folder: np.savez(folder / name, depth_m=depth_m)


def each(change):
    def spoil(folder):
        for number, name in enumerate(NAMES):
            np.savez(folder / name, depth_m=change(depth(number)))

    return spoil


def facts(old, new):
    return lambda folder: (folder / "submission.toml").write_text(FACTS.replace(old, new))


def spotted(value):
    depth_m = depth(9)
    depth_m[3, 4:7] = value
    return depth_m


def renamed(name):
    return lambda folder: (folder / NAMES[0]).rename(folder / name)


def pipe(folder):
    (folder / NAMES[0]).unlink()
    os.mkfifo(folder / NAMES[0])


def linked(name, content=None):
    """What a stranger wants to be read, outside of the folder, linked to from inside."""

    def spoil(folder):
        kept = folder.parent / "kept"
        (folder / (content or name)).rename(kept) if content is None else kept.write_text("mine")
        (folder / name).symlink_to(kept)

    return spoil


WRONG = {
    "no facts": (lambda folder: (folder / "submission.toml").unlink(), "is missing; needs method"),
    "no method": (facts('method = "Guess"', ""), "method: is missing; it holds"),
    "no authors": (facts('["A. Author", "Ü. Österreich"]', "[]"), "authors: "),
    "no licence": (facts('licence = "CC-BY-4.0"', ""), "licence: is missing"),
    "no cost": (lambda folder: facts(FACTS[FACTS.index("[cost]") :], "")(folder), "cost: is mis"),
    "no memory": (facts("peak_memory_mb = 120", ""), "cost.peak_memory_mb: is missing"),
    "a negative time": (facts("= 0.5", "= -0.5"), "cost.seconds_per_window: "),
    "a line break in a name": (facts('"Guess"', '"Gu\\nss"'), "method: "),
    "an unknown key": (facts("url", "page"), "page: "),
    "no TOML": (facts("[cost]", "[cost"), "not TOML"),
    "missing case": (lambda folder: shutil.rmtree(folder / "late"), "late with seed 0"),
    "inverse depth": (each(lambda d: 1 / d), "instead of inverse depth"),
    "seconds": (renamed("wall/seed0/0.01.npz"), "set time_unit"),
    "twice the same": (put(depth(1)), "is identical to the depth map of wall/seed0/10000.npz"),
    "a pipe": (pipe, "10000.npz: is a pipe"),
    "a link to a file": (linked(NAMES[0]), "10000.npz: is a link"),
    "a link to a folder": (linked("wall/seed0"), "seed0: is a link"),
    "a linked description": (linked("prediction.toml", "submission.toml"), ".toml: is a link"),
    "linked facts": (linked("submission.toml"), "submission.toml: is a link"),
    "linked times": (linked("wall/seed0/timestamps.txt", NAMES[0]), "timestamps.txt: is a link"),
    "a time of many digits": (
        lambda folder: (folder / "wall/seed0/timestamps.txt").write_text("9" * 5000),
        "is not a time",
    ),
    "confidence of NaN": (
        lambda folder: np.savez(folder / NAMES[0], depth_m=depth(0), confidence=spotted(np.nan)),
        "confidence is not finite",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_with_a_folder_is_one_line(place, capsys, kind):
    spoil, words = WRONG[kind]
    spoil(place / "theirs")
    for command in (making(place), checking(place, place / "theirs")):
        assert words in command_refused(capsys, *command)
    assert not (place / "guess.tar.zst").exists()


# What is wrong with a file
def repacked(place, spoil):
    """Unpacks a right submission, spoils what is in it, and packs it as an attacker would."""
    assert make(place, "--quiet") == 0
    path, inside = place / "guess.tar.zst", place / "inside"
    inside.mkdir()
    unpack(path, inside, {**read_manifest(path).files, MANIFEST: _Any()})
    spoil(inside)
    pack(path, inside, [p.relative_to(inside).as_posix() for p in inside.rglob("*") if p.is_file()])


def stated(change):
    def spoil(inside):
        content = json.loads((inside / MANIFEST).read_text())
        change(content)
        (inside / MANIFEST).write_text(json.dumps(content))

    return spoil


def then_listed(change):
    """Lists all files with the hashes that they have then, as a careful attacker would."""

    def spoil(inside):
        change(inside)
        content = json.loads((inside / MANIFEST).read_text())
        for name in content["files"]:
            path = inside / name
            content["files"][name] = {"sha256": sha256_of(path), "bytes": path.stat().st_size}
        (inside / MANIFEST).write_text(json.dumps(content))

    return spoil


SPOILT = {
    "a file too few": (lambda inside: (inside / NAMES[0]).unlink(), "10000.npz is missing"),
    "a file too many": (lambda inside: (inside / "x.npz").write_bytes(b"x"), "does not belong"),
    "a changed file": (
        lambda inside: (inside / NAMES[0]).write_bytes((inside / NAMES[0]).read_bytes()[::-1]),
        "was changed",
    ),
    "a path that leads out": (
        stated(lambda c: c["files"].update({"../../x.npz": c["files"].pop(NAMES[0])})),
        "10000.npz is missing",
    ),
    "another path beside": (
        stated(lambda c: c["files"].update({"/etc/x": c["files"][NAMES[0]]})),
        "/etc/x is no view of the suite",
    ),
    "a huge file": (stated(lambda c: c["files"][NAMES[0]].update(bytes=1 << 40)), "bytes, at most"),
    "a bomb": (
        then_listed(lambda f: np.savez_compressed(f / NAMES[0], depth_m=np.zeros((6000, 6000)))),
        "unpacks to more than",
    ),
    "another array": (
        then_listed(lambda inside: np.savez(inside / NAMES[0], depth=depth(0))),
        "other arrays than depth_m",
    ),
    "another size": (then_listed(put(depth(0, (90, 120)))), "has 180 rows"),
    "a pickle": (then_listed(put(np.array([{}], object))), "10000.npz"),
    "another suite": (stated(lambda c: c.update(suite="other")), "is for other, not for pair"),
    "a case too few": (stated(lambda c: c.update(cases=["wall"])), "the case late is missing"),
    "another seed": (stated(lambda c: c.update(seeds=[7])), "the seed 0 is missing"),
    "a case many times": (
        stated(lambda c: c.update(cases=["wall", "late"] * 400)), "wall is listed",
    ),
    "a seed many times": (stated(lambda c: c.update(seeds=[0] * 1000)), "0 is listed twice"),
    "many seeds": (stated(lambda c: c.update(seeds=[*range(1000)])), "pair has no seed 1"),
    "another layout": (stated(lambda c: c.update(schema_version=9)), "schema version 9"),
    "no facts": (stated(lambda c: c.pop("facts")), "its manifest: facts"),
    "manifest": (lambda inside: (inside / MANIFEST).unlink(), "needs .manifest.json first"),
}  # fmt: skip


@pytest.mark.parametrize("kind", SPOILT)
def test_what_is_wrong_with_a_file_is_one_line(place, capsys, kind):
    spoil, words = SPOILT[kind]
    repacked(place, spoil)
    assert words in command_refused(capsys, *checking(place))


# In a suite
@pytest.fixture(scope="module")
def ran(tmp_path_factory, jobs_in_this_process):
    """The suite's archive, as published, and a cache that holds what it needs."""
    folder = tmp_path_factory.mktemp("suite")
    (folder / "pair.toml").write_text(SUITE)
    arguments = ["--cache", str(folder / "cache"), "--workers", "1", "--quiet"]
    frozen = ["--out", str(folder / "frozen")]
    assert main(["archive", "make", str(folder / "pair.toml"), *frozen, *arguments]) == 0
    return folder


PACKAGE = '''
"""A method of somebody else: reads what was unpacked, writes what is asked for."""

import json, pathlib, sys
import h5py, numpy

listed, recordings, out = json.load(open(sys.argv[1])), *map(pathlib.Path, sys.argv[2:])
for one in listed["sequences"]:
    place = f"{one['case']}/seed{one['seed']}"
    with h5py.File(recordings / place / "cam0" / "events.h5") as events:
        assert len(events)
    near_m, far_m = one["depth_range_m"]
    shape = one["camera"]["height_px"], one["camera"]["width_px"]
    for number, window in enumerate(one["windows"]):
        path = out / window["file"]
        path.parent.mkdir(parents=True, exist_ok=True)
        depth_m = numpy.full(shape, (near_m * far_m) ** 0.5) + 1e-3 * number + 1e-5 * ord(place[0])
        numpy.savez(path, depth_m=depth_m)
'''


def run(ran, out, *more):
    arguments = ["--cache", str(ran / "cache"), "--workers", "1", "--no-speed", "--quiet"]
    words = ["suite", str(ran / "pair.toml"), "--archive", str(ran / "frozen"), "--out", str(out)]
    return main([*words, *arguments, *map(str, more)])


def unpacked(ran, out):
    assert main(["archive", "unpack", str(ran / "frozen"), "--out", str(out), "--quiet"]) == 0


@pytest.mark.slow
def test_from_a_package_outside_to_a_row_in_two_commands(ran, tmp_path, capsys):
    """Unpacked recordings and the list are all that it has; it runs without this project."""
    recordings, theirs = tmp_path / "recordings", tmp_path / "theirs"
    unpacked(ran, recordings)
    capsys.readouterr()
    words = ["--list-cases", "--json", "--archive", str(ran / "frozen")]
    assert main(["suite", str(ran / "pair.toml"), *words]) == 0
    (tmp_path / "list.json").write_text(capsys.readouterr().out)
    (tmp_path / "guess.py").write_text(PACKAGE)
    program = [sys.executable, "-I", "guess.py", "list.json", str(recordings), str(theirs)]
    subprocess.run(program, cwd=tmp_path, check=True, env={"PATH": os.environ["PATH"]})
    (theirs / "submission.toml").write_text(FACTS)
    # Two commands: from its files to numbers, from numbers to a row.
    assert run(ran, tmp_path / "out", "--prediction", theirs) == 0
    assert main(["ranking", str(tmp_path / "out"), "--out", str(tmp_path / "page"), "--quiet"]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    first = page[page.index("<tbody>") : page.index("</tbody>")]
    (row,) = [
        line for line in first.splitlines() if ">Given/Guess<" in line.replace("</span>", ">")
    ]
    for text in ("0.5 stated", "120 stated", "by A. Author, Ü. Österreich"):
        assert text in row
    own = (tmp_path / "page" / "methods" / "Given_Guess.html").read_text()
    for which in ("best", "worst"):
        assert f"{which} case: " in own
    result = read_results(tmp_path / "out")
    assert set(result.rows["method"]) >= {"Given/Guess", "Alg1/H"}
    assert result.stated["Given/Guess"]["cost"]["seconds_per_window"] == 0.5
    packed = tmp_path / "guess.tar.zst"
    suite = ["--suite", str(ran / "pair.toml"), "--archive", str(ran / "frozen")]
    assert main(["submission", "make", str(theirs), *suite, "--out", str(packed), "--quiet"]) == 0
    assert run(ran, tmp_path / "same", "--prediction", packed) == 0
    same = read_results(tmp_path / "same")
    assert same.stated == result.stated
    assert same.rows.equals(result.rows)
    assert run(ran, tmp_path / "named", "--prediction", f"x={packed}", "--case", "late") == 0
    assert "Given/x" in read_results(tmp_path / "named").stated


@pytest.mark.slow
def test_copied_truth_is_flagged(ran, tmp_path, capsys):
    recordings = tmp_path / "recordings"
    unpacked(ran, recordings)
    for name in NAMES:
        case, seed, file = name.split("/")
        truth_m = Sequence.open(recordings / case / seed).truth_view_depth_m(0, int(file[:-4]))
        (tmp_path / "theirs" / name).parent.mkdir(parents=True, exist_ok=True)
        np.savez(tmp_path / "theirs" / name, depth_m=np.round(truth_m, 3))
    with blank_pictures():
        assert run(ran, tmp_path / "out", "--prediction", tmp_path / "theirs") == 0
    err = capsys.readouterr().err
    assert (
        "Given/theirs: a perfect score, as if the truth were copied, in wall seed 0, late seed 0"
        in err
    )
    assert "Alg1/H" not in err


def test_of_an_archive_what_is_in_it_is_asked_for(ran):
    suite = read_definition(ran / "pair.toml")
    from eventsweep.plugins.ranking.archives.manifest import read

    manifest = read(ran / "frozen")
    assert Asked.of(suite, "all", manifest).seeds == (0,)
    assert Asked.of(suite, "all", manifest).archive == manifest.version
    assert set(Asked.of(suite, "all", None).views()) == set(NAMES)
    assert str(ROOT) not in manifest.model_dump_json()
