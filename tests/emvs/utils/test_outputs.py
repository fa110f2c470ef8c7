"""Outputs: what is ours is replaced, everything else is kept beside, and nothing is lost."""

import hashlib
import json
import os
import re
import shutil
import tempfile
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product
from pathlib import Path

import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import files, outputs
from eventsweep.emvs.utils.files import (
    MARK,
    DiskFull,
    atomic_path,
    bytes_text,
    free_bytes,
    work_folder,
)
from eventsweep.emvs.utils.inputs import also_read, command
from eventsweep.emvs.utils.output_manifest import NAME, complete, is_ours, strangers
from eventsweep.emvs.utils.outputs import (
    atomic_dir,
    check_files,
    check_output,
    claimed,
    discard,
    files_together,
    output_file,
    output_folder,
    replace_dir,
)
from killed import killed_at_every_step
from refusals import contents as bytes_below
from refusals import refused
from tiers import often

MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def put(folder, **texts):
    """Writes files, whose names have `__` for slashes and `_0` for dots."""
    for name, text in texts.items():
        path = folder / name.replace("__", "/").replace("_0", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def sha256(text):
    return hashlib.sha256(text.encode()).hexdigest()


def write_sequence(folder):
    """A sequence lists its files in a manifest of its own."""
    texts = {"cam0/events.h5": "events", "poses.txt": "poses"}
    put(folder, cam0__events_0h5="events", poses_0txt="poses")
    facts = {n: {"sha256": sha256(text), "bytes": len(text)} for n, text in texts.items()}
    manifest = {"schema_version": 1, "event_counts": [1], "files": facts}
    put(folder, manifest_0json=json.dumps(manifest))


def write_map(folder):
    put(folder, map_0json="{}", w000__events_0npz="n", w000__depth_0npz="d")
    complete(folder)
    with files_together(folder, ["report.html", "tables/ranking.csv"]) as staged:
        put(staged, report_0html="page", tables__ranking_0csv="r")


def write_run(folder):
    write_sequence(folder / "desk" / "sequence")
    write_map(folder / "desk" / "map")
    put(folder, config_0toml="", results_0json="{}")
    complete(folder)


WRITERS = {"sequence": write_sequence, "map": write_map, "run": write_run}


def contents(folder):
    """Bytes of every file below a folder, and where links lead."""
    content = {}
    for parent, folders, names in os.walk(folder):
        for path in (Path(parent, name) for name in (*folders, *names)):
            if path.is_symlink():
                content[path] = str(path.readlink())
            else:
                content[path] = path.read_bytes() if path.is_file() else "folder"
    return content


def names(folder):
    return {path.name for path in folder.iterdir()}


def made_anew(out, inputs=()):
    with atomic_dir(out, force=True, inputs=inputs) as folder:
        put(folder, new="new")


def written_new(folder, name):
    with files_together(folder, [name]) as staged:
        put(staged, **{name.replace("/", "__"): "new"})


@pytest.mark.parametrize("verb", WRITERS)
def test_what_each_verb_writes_is_known_and_replaced(tmp_path, caplog, verb):
    out = tmp_path / "out"
    WRITERS[verb](out)
    assert strangers(out) == []
    refused(r"exists: .* set force=True", atomic_dir(out).__enter__)
    made_anew(out)
    assert contents(tmp_path).keys() == {out, out / "new", out / NAME}
    assert caplog.messages == []
    discard(out)
    assert names(tmp_path) == set()


def test_manifests_of_earlier_versions_say_what_is_ours(tmp_path):
    facts = {"bytes": 1, "sha256": sha256("a")}
    old = {"written_by": "eventsweep", "schema": 1, "files": {"a": facts}, "parts": ["b"]}
    put(tmp_path / "out", a="a", **{f"_0{NAME[1:]}": json.dumps(old)})
    write_map(tmp_path / "out" / "b")
    assert strangers(tmp_path / "out") == []
    put(tmp_path / "out", a="b")
    assert strangers(tmp_path / "out") == ["a"]


# --- what stands there and is not ours, or is read: kept beside, with a line


def edited(out):
    path = next(out.rglob("*s.txt"), out / "map.json")
    path.write_text("x" * len(path.read_text()))


def copied(out):
    shutil.copytree(out, out.parent / "copy")
    shutil.move(out.parent / "copy", out / "copy")


def renamed(out):
    path = next(path for path in out.rglob("*.txt"))
    path.rename(path.with_name("renamed"))


def linked(out):
    (out / "link").symlink_to(out.parent)


def as_a_link(out):
    out.rename(out.with_name("target"))
    out.symlink_to("target")


def as_a_broken_link(out):
    as_a_link(out)
    out.with_name("target").rename(out.with_name("gone"))


def as_a_file(out):
    shutil.rmtree(out)
    out.write_text("precious")


def without_manifests(out):
    for path in [*out.rglob(NAME), *out.rglob("manifest.json")]:
        path.unlink()


FOREIGN = [
    "thesis.tex", "figs/a.svg", "w000/notes.txt", "w000/mine/depth.npz", "tables/mine.csv",
    "desk/map/w000/mine.txt", "cam0/events.h5.bak", ".out.abcdefgh.partial/thesis.tex",
    ".thesis.download.partial", ".a.lock", ".a.partial/thesis.tex",
]  # fmt: skip
CHANGES = {
    "edited": (edited, "poses.txt"), "copied": (copied, "copy/"), "renamed": (renamed, "renamed"),
    "linked": (linked, "link"), "a link": (as_a_link, "is a link"),
    "a broken link": (as_a_broken_link, "is a link"), "a file": (as_a_file, "was not written by"),
    "no manifests": (without_manifests, "did not write"),
    **{name: (lambda out, name=name: put(out, **{name.replace("/", "__").replace(".", "_0"): "x"}),
              name) for name in FOREIGN},
}  # fmt: skip


def kept(caplog, out, number=1):
    """Where the one line says that something is kept."""
    (line,) = caplog.messages
    caplog.clear()
    assert line.startswith(f"{out} ")
    assert line.endswith(f": it is kept as {out}.kept-{number}")
    assert len(line.splitlines()) == 1
    return line


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_not_ours_is_kept_beside_and_a_line_says_where(tmp_path, caplog, change):
    out = tmp_path / "out"
    write_run(out)
    alter, words = CHANGES[change]
    alter(out)
    before = {str(path): what for path, what in contents(tmp_path).items()}
    for number in (1, 2):
        made_anew(out)
        if number == 1:
            assert words in kept(caplog, out)
            after = {
                str(path).replace(".kept-1", ""): what
                for path, what in contents(tmp_path).items()
                if not path.is_relative_to(out)
            }
            assert after == before
        assert contents(out).keys() == {out / "new", out / NAME}
        put(out, mine="x")
    assert "holds mine, which eventsweep did not write" in kept(caplog, out, 2)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"written_by": "eventsweep", "files": {"a": 1}}', '{"schema": 1}']
)
def test_without_a_manifest_that_can_be_read_nothing_is_ours(tmp_path, caplog, text):
    put(tmp_path / "out", a="a", **{f"_0{NAME[1:]}": text})
    written_new(tmp_path / "out", "b")
    assert "damaged" in kept(caplog, tmp_path / "out" / NAME)
    assert (tmp_path / "out" / f"{NAME}.kept-1").read_text() == text
    made_anew(tmp_path / "out")
    assert "did not write" in kept(caplog, tmp_path / "out")
    assert (tmp_path / "out.kept-1" / "a").read_text() == "a"


@dataclass(frozen=True)
class Group:
    """Settings, as those of a command are: in groups."""

    weights: Path | str
    out: Path | None = None


READ = {
    "a path": lambda path: (path,),
    "in settings": lambda path: ({"map": [Group(path)]},),
    "as a text": lambda path: (f"NAME={path / 'poses.txt' if path.name == 'rec' else path}",),
}


@pytest.mark.parametrize("of_command", [False, True])
@pytest.mark.parametrize("how", READ)
@pytest.mark.parametrize(("out", "source", "words"), [
    ("rec", "rec", "is or holds the input"), ("rec", "link", "is or holds the input"),
    ("parent", "parent/rec/poses.txt", "is or holds the input"),
    ("parent", "parent/rec", "is or holds the input"), ("rec/map", "rec", "is part of the input"),
])  # fmt: skip
def test_an_input_is_never_removed(tmp_path, caplog, how, of_command, out, source, words):
    """However it is named, and though all of it is ours."""
    write_sequence(tmp_path / "rec")
    write_sequence(tmp_path / "parent" / "rec")
    complete(tmp_path / "parent")
    write_map(tmp_path / "rec" / "map")
    (tmp_path / "link").symlink_to("rec")
    if how == "as a text" and out == "rec/map":
        pytest.skip("a file of the recording does not say that the map lies in an input")
    before = {str(path): what for path, what in contents(tmp_path).items()}
    given_values = READ[how](tmp_path / source)
    with command():
        if of_command:
            also_read({"given": given_values, "out": tmp_path / out})
        made_anew(tmp_path / out, () if of_command else given_values)
    assert words in kept(caplog, tmp_path / out)
    after = {(str(path).replace(".kept-1", ""), what) for path, what in contents(tmp_path).items()}
    assert before.items() <= after


@pytest.mark.parametrize("named", ["weights.npz", "sub/weights.npz"])
def test_what_a_file_of_settings_names_is_an_input(tmp_path, monkeypatch, caplog, named):
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / "out" / "sub" / "weights.npz", tmp_path / "out" / "weights.npz"):
        put(path.parent, weights_0npz="w")
    complete(tmp_path / "out")
    put(tmp_path, recording_0toml=f'[map]\nweights = ["out/{named}"]')
    made_anew(Path("out"), [Path("recording.toml")])
    assert f"the input out/{named}" in caplog.text
    assert (tmp_path / "out.kept-1" / named).read_text() == "w"
    caplog.clear()
    made_anew(Path("out"), [Group("out", out=tmp_path / "out")])
    assert caplog.messages == []


def test_a_file_is_replaced_where_it_is_listed_and_else_kept(tmp_path, caplog):
    out = tmp_path / "a.npz"

    def make(inputs=()):
        with output_file(out, force=True, inputs=inputs) as place:
            assert place.name == "a.npz"
            place.write_text("new")

    for before in ("nothing", "ours", "mine", "a folder", "a sequence's", "an input"):
        if before == "mine":
            out.write_text("mine")
        if before == "a folder":
            out.unlink()
            put(out, thesis="mine")
        if before == "a sequence's":
            write_sequence(tmp_path / "rec")
            out = tmp_path / "rec" / "poses.txt"
            with output_file(out, force=True) as place:
                place.write_text("new")
            assert "was not written" in kept(caplog, out)
            assert out.with_name("poses.txt.kept-1").read_text() == "poses"
            out = tmp_path / "a.npz"
        make([out] if before == "an input" else ())
        assert out.read_text() == "new"
        assert is_ours(out)
        if before in ("mine", "a folder", "an input"):
            kept(caplog, out, ["mine", "a folder", "an input"].index(before) + 1)
        assert caplog.messages == []
    assert (tmp_path / "a.npz.kept-1").read_text() == "mine"
    assert (tmp_path / "a.npz.kept-2" / "thesis").read_text() == "mine"
    refused("exists", output_file(out).__enter__)


@pytest.mark.parametrize(("before", "words"), [
    ("mine", "was not written"), ("link", "was not written"), ("tables link", "in the way"),
    ("tables file", "in the way"), ("input", "is or holds the input"), ("ours", ""),
])  # fmt: skip
def test_files_in_a_folder_are_replaced_where_they_are_ours(tmp_path, caplog, before, words):
    put(tmp_path, theirs__a="precious")
    out = tmp_path / "out"
    if before in ("ours", "input"):
        written_new(out, "tables/a")
    elif before == "tables file":
        put(out, tables="mine")
    elif before == "tables link":
        out.mkdir()
        (out / "tables").symlink_to(tmp_path / "theirs")
    else:
        put(out, tables__a="mine")
    if before == "link":
        (out / "tables" / "a").unlink()
        (out / "tables" / "a").symlink_to(tmp_path / "theirs" / "a")
    with command():
        if before == "input":
            also_read(out / "tables" / "a")
        check_files(out, ["tables/a"], force=True)
        written_new(out, "tables/a")
    assert (out / "tables" / "a").read_text() == "new"
    assert strangers(out) == ([] if before in ("ours",) else [
        "tables.kept-1" if "tables" in before else "tables/a.kept-1"
    ])  # fmt: skip
    if words:
        at = out / "tables" if "tables" in before else out / "tables" / "a"
        assert words in kept(caplog, at)
    assert bytes_below(tmp_path / "theirs") == {tmp_path / "theirs" / "a": b"precious"}
    refused("exists", check_files, out, ["tables/a"])


def test_nothing_is_written_through_a_hard_or_symbolic_link(tmp_path):
    put(tmp_path, theirs__a="precious")
    with atomic_path(tmp_path / "hard") as path:
        path.write_text("old")
    os.link(tmp_path / "hard", tmp_path / "theirs" / "linked")
    (tmp_path / "soft").symlink_to(tmp_path / "theirs" / "a")
    for path in (tmp_path / "hard", tmp_path / "soft"):
        with atomic_path(path) as place:
            place.write_text("new")
    assert {path.name: path.read_text() for path in (tmp_path / "theirs").iterdir()} == {
        "a": "precious", "linked": "old"
    }  # fmt: skip


def test_a_part_belongs_to_the_output_that_made_it(tmp_path):
    write_map(tmp_path / "out")
    for listed in (False, True):
        with atomic_dir(
            tmp_path / "out" / f"part{listed}", part_of=tmp_path / "out" if listed else None
        ) as folder:
            put(folder, a="a")
    assert strangers(tmp_path / "out") == [f"partFalse/{NAME}", "partFalse/a"]


# --- what is refused, and leaves everything as it was


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Places that no output may have."""
    put(tmp_path, file="f", home__a="mine")
    write_map(tmp_path / "map")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "circle").symlink_to("circle")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path / "map" / "w000")
    return tmp_path


@pytest.mark.parametrize(("name", "words"), [
    ("pipe", "is a pipe, device or socket"), ("file/below", "cannot make the folder"),
    ("a\0b", "not a valid file name"), ("circle/a", "not a valid file name"),
    ("map/w000", "is or holds the working directory"), ("map", "is or holds the working directory"),
    ("home", "is or holds the home folder"), ("map/w000/..", "the working directory"),
])  # fmt: skip
@pytest.mark.parametrize("make", [atomic_dir, output_file])
def test_what_no_output_may_replace(places, make, name, words):
    before = {path: what for path, what in contents(places).items() if path.name != "pipe"} if (
        name != "pipe") else None  # fmt: skip
    for force in (True, False):
        said = refused(words, make(places / name, force=force).__enter__)
        assert "force" not in said
    if before is not None:
        pipe = places / "pipe"
        pipe.unlink()
        assert contents(places) == before


def test_the_working_directory_by_its_own_name(places):
    refused(r"^\. is or holds the working directory", atomic_dir(Path(), force=True).__enter__)


@pytest.mark.parametrize("make", [atomic_dir, output_file, output_folder])
def test_a_refused_output_leaves_no_folders(tmp_path, make):
    with pytest.raises(InputError, match="no"), make(tmp_path / "a" / "b" / "out"):
        raise InputError("no")
    assert names(tmp_path) == set()


def test_a_folder_that_cannot_be_moved_is_left_and_the_work_is_kept(tmp_path, monkeypatch):
    """Such as one on a layer of a container below: no name of it may change."""
    write_map(tmp_path / "out")
    before = contents(tmp_path / "out")
    rename = Path.rename

    def across(path, to):
        if path == tmp_path / "out":
            raise OSError(18, "Invalid cross-device link")
        return rename(path, to)

    monkeypatch.setattr(Path, "rename", across)
    words = rf"cannot move {tmp_path}/out away \(Invalid cross-device link\): .*out\.finished"
    refused(words, made_anew, tmp_path / "out")
    assert contents(tmp_path / "out") == before
    assert (tmp_path / "out.finished" / "new").read_text() == "new"


def test_a_place_without_permission_says_so(tmp_path, monkeypatch):
    write_map(tmp_path / "out")
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) != tmp_path)
    refused("no permission", check_output, tmp_path / "out", force=True)
    refused("no permission", check_output, tmp_path / "other", force=True)


def test_a_pipe_is_not_replaced_by_a_file(tmp_path):
    """Nor a device: for root, `/dev/null` is a name like any other."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is a pipe, device"), atomic_path(tmp_path / "pipe"):
        pytest.fail("it is opened for writing")
    assert (tmp_path / "pipe").is_fifo()


def test_an_error_about_a_file_names_it_and_not_where_it_is_made(tmp_path):
    path = tmp_path / "out.npz"
    with pytest.raises(InputError) as caught, output_file(path) as place:
        raise InputError(f"{place}: too large")
    assert str(caught.value) == f"{path}: too large"


# --- races


@pytest.mark.parametrize("make", [atomic_dir, output_file])
def test_what_appears_meanwhile_is_kept_and_so_is_the_work(tmp_path, make):
    out = tmp_path / "out.npz"

    def work():
        with make(out) as place:
            put(place, new="n") if make is atomic_dir else place.write_text("n")
            put(tmp_path, out_0npz="precious")

    refused(r"exists.*finished output is in .*out\.finished\.npz", work)
    assert out.read_text() == "precious"
    finished = tmp_path / "out.finished.npz"
    assert (finished / "new" if make is atomic_dir else finished).read_text() == "n"
    assert names(tmp_path) <= {out.name, finished.name, NAME}


@pytest.mark.parametrize("late", ["before", "while surveyed"])
def test_what_comes_while_an_output_is_replaced_is_kept(tmp_path, monkeypatch, caplog, late):
    out = tmp_path / "out"
    write_map(out)
    survey = outputs.survey

    def slow(folder):
        put(folder, notes="p") if late == "before" else None
        yield from survey(folder)
        put(folder, notes="p")

    monkeypatch.setattr(outputs, "survey", slow)
    made_anew(out)
    kept(caplog, out)
    assert (tmp_path / "out.kept-1" / "notes").read_text() == "p"
    assert names(tmp_path) == {"out", "out.kept-1"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
@pytest.mark.parametrize("mine", [False, True])
def test_an_interrupt_in_the_swap_loses_neither_old_nor_new(tmp_path, monkeypatch, error, mine):
    out = tmp_path / "out"
    write_map(out)
    put(out, mine="m") if mine else None
    before = contents(tmp_path)

    def stopped(made, place):
        raise error("stopped")

    monkeypatch.setattr(outputs, "link_new", stopped)
    with pytest.raises(error):
        made_anew(out)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_two_runs_into_one_output(tmp_path, kind):
    out = tmp_path / "out"
    make = atomic_dir if kind == "folder" else output_file
    with make(out) as place:
        put(place, a="a") if kind == "folder" else place.write_text("a")
        for second in (atomic_dir, output_file, output_folder):
            refused("another process is writing it", second(out).__enter__)
    assert names(tmp_path) - {NAME} == {"out"}


def test_many_at_once_and_one_wins(tmp_path):
    out, won = tmp_path / "deep" / "out", []
    barrier = threading.Barrier(8)

    def work(k):
        barrier.wait()
        try:
            with atomic_dir(out) as folder:
                put(folder, who=str(k))
            won.append(k)
        except InputError:
            pass

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [(out / "who").read_text()] == list(map(str, won))
    assert names(out.parent) == {"out"}


def test_those_who_write_one_file_at_once_wait_for_each_other(tmp_path):
    def work(k):
        files.write_text(tmp_path / "a", str(k))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (tmp_path / "a").read_text() in map(str, range(8))
    assert names(tmp_path) == {"a"}


def test_somebodys_folder_of_a_hidden_name_is_kept(tmp_path, caplog):
    put(tmp_path, _0out_0partial__thesis="mine")
    made_anew(tmp_path / "out")
    kept(caplog, tmp_path / ".out.partial")
    assert (tmp_path / ".out.partial.kept-1" / "thesis").read_text() == "mine"


def test_a_disk_without_locks_takes_nothing_for_a_leftover(tmp_path, monkeypatch):
    def lockless(_file, _kind):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(files.fcntl, "flock", lockless)
    made_anew(tmp_path / "out")
    put(tmp_path, **{"_0out_0partial__" + MARK.replace(".", "_0"): ""})
    refused("another process is writing it", atomic_dir(tmp_path / "out", force=True).__enter__)
    assert names(tmp_path) == {"out", ".out.partial"}


# --- anything at all

ENTRY = st.sampled_from(
    ["thesis.tex", "w000/depth.npz", "map.json", "tables/a.csv", ".in.partial/a", NAME]
)
SPOT = st.sampled_from(["out", "out/in", "parent", "other", "out/w000", "link", "parent/out"])


def plant(root, kinds, foreign, link):
    """Outputs of ours here and there, what others put beside and in them, and a link."""
    for place, verb in kinds.items():
        WRITERS[verb](root / place)
    ours = set(contents(root))
    for place, name in foreign:
        path = root / place / name
        if not any(above.is_file() for above in (path, *path.parents)) and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"precious {place}/{name}")
    if link is not None and not os.path.lexists(root / "link"):
        (root / "link").symlink_to(root / link)
    return {path: what for path, what in contents(root).items() if path not in ours}


ANYTHING = given(
    kinds=st.dictionaries(SPOT, st.sampled_from(sorted(WRITERS)), max_size=3),
    foreign=st.lists(st.tuples(SPOT, ENTRY), max_size=4),
    link=st.none() | SPOT,
    out=SPOT,
    given_inputs=st.lists(SPOT, max_size=2),
    verb=st.sampled_from([*sorted(WRITERS), "file", "together"]),
    working=st.sampled_from(["", "", "out", "parent"]),
)


@settings(max_examples=100)
@example(
    kinds={"out/in": "run"}, foreign=[], link=None, out="out/in", given_inputs=["out"],
    verb="together", working="",
)  # fmt: skip
@ANYTHING
def test_whatever_lies_where_nothing_of_others_is_lost(**drawn):
    check_nothing_is_lost(**drawn)


@pytest.mark.slow
@settings(max_examples=10_000)
@ANYTHING
def test_in_thousands_of_cases_nothing_of_others_is_lost(**drawn):
    check_nothing_is_lost(**drawn)


def check_nothing_is_lost(kinds, foreign, link, out, given_inputs, verb, working):
    """What was there and is not ours, and what is read, has its bytes, there or under `kept`."""
    kinds.pop("link", None)
    foreign = [(place, name) for place, name in foreign if place != "link"]
    root = Path(tempfile.mkdtemp(dir=MEMORY))
    home, fsync = Path.cwd(), os.fsync
    os.fsync = lambda _file: None  # a real disk takes most of the time
    try:
        precious = plant(root, kinds, foreign, link)
        inputs = [root / name for name in given_inputs if verb != "together"]
        for source in inputs:
            precious |= contents(os.path.realpath(source))
        # Lists what is added beside the output, or to it.
        precious.pop(Path(os.path.realpath((root / out).parent)) / NAME, None)
        precious.pop(Path(os.path.realpath(root / out)) / NAME, None)
        before = contents(root)
        if (root / working).is_dir():
            os.chdir(root / working)
        is_made = attempt(root / out, verb, inputs)
        event(f"{verb} {'made' if is_made else 'refused'}")
        after = contents(root)
        if is_made:
            there = {(re.sub(r"\.kept-\d+", "", str(path)), what) for path, what in after.items()}
            lost = {(str(path), what) for path, what in precious.items()} - there
            assert not {(path, what) for path, what in lost if what != "folder"}
        else:
            assert after == before
        new = {re.sub(r"\.kept-\d+", "", str(path)) for path in after} - set(map(str, before))
        assert not {name for name in new if name.endswith((".partial", MARK))}
    finally:
        os.fsync = fsync
        os.chdir(home)
        shutil.rmtree(root)


def attempt(out, verb, inputs):
    """Makes an output by force; whether it was made."""
    try:
        if verb == "file":
            with output_file(out, force=True, inputs=inputs) as place:
                place.write_text("new")
        elif verb == "together":
            together = ["map.json", "tables/a.csv"]
            with (
                output_folder(out, together, force=True),
                files_together(out, together) as staged,
            ):
                put(staged, map_0json="new", tables__a_0csv="new")
        else:
            with atomic_dir(out, force=True, inputs=inputs) as folder:
                WRITERS[verb](folder)
    except InputError:
        return False
    return True


# --- kills


def replaced_whole(out):
    with atomic_dir(out, force=True) as folder:
        write_map(folder)
        put(folder, a="new")


def exchanged(out):
    with files_together(out, ["b", "tables/c", "index"], index="index") as staged:
        put(staged, b="a newer text", tables__c="new", index="new")


def taken_up(out):
    """A folder that grows beside its place, and takes it in the end."""
    following = out.with_name(".out.next")
    with claimed(out) as work:
        if (out / "part0").exists():
            return
        with output_folder(following):
            following.mkdir(exist_ok=True)
            for part in (following / "part0", following / "part1"):
                if not part.exists():
                    with atomic_dir(part, part_of=following) as folder:
                        put(folder, a="new")
            with files_together(following, ["index"]) as staged:
                put(staged, index="new")
        replace_dir(following, out, work)


def one_file(out):
    with output_file(out / "a.xml", force=True) as place:
        place.write_text("new")


KILLED = {"whole": replaced_whole, "exchanged": exchanged, "grown": taken_up, "file": one_file}


@pytest.fixture
def memory():
    """A folder in memory, where there is one: a real disk takes most of the time of many kills."""
    folder = Path(tempfile.mkdtemp(dir=MEMORY))
    yield folder
    shutil.rmtree(folder)


# What replaces a whole folder takes many steps.
OFTEN = [("exchanged", "beside somebody's"), ("file", "beside somebody's")]
SELDOM = [
    *product(("exchanged", "file", "whole", "grown"), ("ours",)),
    *product(("whole",), ("beside somebody's",)),
    *product(KILLED, ("nothing",)),
]


@pytest.mark.parametrize(("call", "before"), often(OFTEN, [*OFTEN, *SELDOM]))
def test_killed_at_any_step_it_ends_with_the_same_bytes(memory, call, before):
    """At every moment the old output is there, or both; the same call then ends the same."""
    out, make = memory / "out", KILLED[call]

    def start():
        shutil.rmtree(memory)
        put(memory, **{"_0out_0abcdefgh_0partial__thesis": "mine"})
        if before != "nothing":
            put(out, b="old", index="old", a_0xml="old")
            complete(out)
        if before == "beside somebody's":
            put(out, mine_0txt="mine")
        if call == "file":
            out.mkdir(exist_ok=True)

    def state():
        return {
            path: what
            for path, what in contents(memory).items()
            if call == "exchanged" or ".kept-" not in str(path)
        }

    def check(step):
        if before == "beside somebody's":
            assert [path.read_bytes() for path in memory.rglob("mine.txt")] == [b"mine"], step
        make(out)
        assert state() == expected, step
        start()

    start()
    make(out)
    expected = state()
    start()
    assert killed_at_every_step(lambda: make(out), check) > 5
    assert state() == expected


@pytest.mark.parametrize("done", [False, True])
def test_a_kill_between_old_and_new_leaves_both_or_the_old_one(tmp_path, caplog, done):
    out, hidden = tmp_path / "out", tmp_path / ".out.partial"
    write_map(hidden / "replaced")
    (hidden / MARK).touch()
    if done:
        written_new(out, "new")
        made_anew(out)
    else:
        refused("exists", atomic_dir(out).__enter__)
    write_map(tmp_path / "same")
    before = {path.relative_to(tmp_path / "same") for path in contents(tmp_path / "same")}
    old = tmp_path / "out.kept-1" if done else out
    assert {path.relative_to(old) for path in contents(old)} == before
    assert kept(caplog, out) if done else not caplog.messages
    assert not hidden.exists()


# --- outputs whose names begin alike, or look like what is kept beside another

ALIKE = ("o", "o.a", "o.kept-1", ".o", "o.track", "o.unfinished")


def stopped(place):
    """Work that can be gone on from, and that a kill stopped."""
    work = place.with_name(f".{place.name}.unfinished")
    put(work, state="half done")
    (work / MARK).touch()


def written_by_all(out):
    """Everything that writes an output, one after another, in the place of one."""
    put(out.parent, **{"_0" + out.name.replace(".", "_0") + "_0partial__new__a": "left"})
    (out.parent / f".{out.name}.partial" / MARK).touch()
    for make in (replaced_whole, exchanged, discard, taken_up, discard):
        make(out)
    out.mkdir()
    one_file(out)
    with output_folder(out, force=True):
        stopped(out / "inner")
    with output_folder(out, force=True):
        assert (out / ".inner.unfinished" / "state").exists()


@pytest.mark.parametrize("name", ALIKE)
def test_no_output_takes_the_unfinished_work_of_another_for_its_own(memory, name):
    others = [memory / other for other in ALIKE if other != name]
    for other in others:
        written_new(other, f"of {other.name}")
        stopped(other)
    before = contents(memory)
    written_by_all(memory / name)
    after = contents(memory)
    assert {path: after.get(path) for path in before} == before
    for other in others:
        with work_folder(other, resume=True) as work:
            assert (work / "state").read_text() == "half done"


@pytest.mark.parametrize(("killed", "name"), often([("o.a", "o")], permutations(ALIKE[:5], 2)))
def test_a_kill_between_two_renames_leaves_nothing_to_an_output_of_a_like_name(
    memory, killed, name
):
    def start():
        for path in memory.iterdir():
            shutil.rmtree(path)
        put(memory / killed, b="old")
        complete(memory / killed)

    def check(step):
        written_by_all(memory / name)
        texts = [path.read_text() for path in memory.rglob("b")]
        new = list((memory / killed).glob("new")), list((memory / killed).glob("a"))
        assert "old" in texts or any(new), step
        replaced_whole(memory / killed)
        start()

    start()
    assert killed_at_every_step(lambda: replaced_whole(memory / killed), check) > 5


# --- a full disk


def fill(path):
    """What writing to a full disk says: it names no file."""
    del path
    with Path("/dev/full").open("wb", buffering=0) as file:
        file.write(b"x")


@contextmanager
def nested(path):
    with atomic_dir(path) as folder, atomic_path(folder / "part") as part:
        yield part


WAYS = {"atomic_dir": atomic_dir, "output_file": output_file, "atomic_path": atomic_path,
        "nested": nested, "files_together": lambda path: files_together(path, ["a"])}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_full_disk_names_the_output_and_what_is_free(tmp_path, way):
    out = tmp_path / "out"
    with pytest.raises(InputError) as caught, WAYS[way](out) as partial:
        fill(partial)
    free = bytes_text(free_bytes(tmp_path)).split()[1]
    words = rf"{re.escape(str(out))}: no space left on device, [\d.]+ {free} are free: free some"
    assert re.match(words, str(caught.value))
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == set()


def test_other_faults_of_the_system_stay_what_they_are(tmp_path):
    with pytest.raises(IsADirectoryError), atomic_dir(tmp_path / "out") as folder:
        folder.write_text("x")
    words = "Can't write data (file write failed: errno = 28, 'No space left on device')"
    with pytest.raises(DiskFull, match="out: no space left"), atomic_dir(tmp_path / "out"):
        raise OSError(words)  # HDF5's


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 bytes"), (999, "999 bytes"), (1000, "1 kB"), (4096, "4.1 kB"), (999_400, "999 kB"),
     (999_600, "1 MB"), (3.2e6, "3.2 MB"), (1.05e9, "1.05 GB"), (10**18, "1 EB")],
)  # fmt: skip
def test_sizes_are_said_in_the_unit_that_suits_them(count, text):
    assert bytes_text(count) == text


@pytest.mark.parametrize("address", ["s3://lab/run", "https://host/run", "s3://lab"])
def test_an_address_is_no_output_of_a_call_and_leaves_no_folder(tmp_path, monkeypatch, address):
    """The command line gives it a mirror."""
    monkeypatch.chdir(tmp_path)
    for make in (partial(check_output, Path(address), force=False), partial(made, Path(address))):
        with pytest.raises(InputError, match="then send it"):
            make()
    assert list(tmp_path.iterdir()) == []


def made(path):
    with atomic_dir(path) as folder:
        put(folder, a="a")
