"""Outputs: nothing that was there is lost, and nothing is left of what was refused."""

import hashlib
import json
import os
import re
import shutil
import tempfile
import threading
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import output_manifest, outputs
from eventsweep.emvs.utils.files import MARK, DiskFull, atomic_path, bytes_text, free_bytes
from eventsweep.emvs.utils.output_manifest import NAME, complete, remove_ours, strangers
from eventsweep.emvs.utils.outputs import (
    atomic_dir,
    check_files,
    check_output,
    claimed,
    files_together,
    inputs_of,
    output_file,
    output_folder,
    replace_dir,
)
from killed import killed_at_every_step
from refusals import refused
from tiers import often


def put(folder, **files):
    """Writes files, whose names have `__` for slashes and `_0` for dots."""
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_0", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_sequence(folder):
    """A sequence lists its files in a manifest of its own."""
    files = {"cam0/events.h5": "events", "poses.txt": "poses"}
    put(folder, cam0__events_0h5="events", poses_0txt="poses")
    facts = {n: {"sha256": sha256(text), "bytes": len(text)} for n, text in files.items()}
    manifest = {"schema_version": 1, "event_counts": [1], "files": facts}
    put(folder, manifest_0json=json.dumps(manifest))


def sha256(text):
    return hashlib.sha256(text.encode()).hexdigest()


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
    found = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            if path.is_symlink():
                found[path] = str(path.readlink())
            elif path.is_file():
                found[path] = path.read_bytes()
            else:
                found[path] = "folder"
    return found


@pytest.mark.parametrize("verb", WRITERS)
def test_what_each_verb_writes_is_known_and_replaced(tmp_path, verb):
    out = tmp_path / "out"
    WRITERS[verb](out)
    assert strangers(out) == []
    with pytest.raises(InputError, match=r"exists: .* set force=True"), atomic_dir(out):
        pass
    with atomic_dir(out, force=True) as folder:
        (folder / "new").write_text("new")
    assert contents(tmp_path).keys() == {out, out / "new", out / NAME}
    assert (out / "new").read_text() == "new"


def written(folder):
    """Every file of an output but its manifests."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path for path in files if path.name not in (NAME, "manifest.json"))


@pytest.mark.parametrize("verb", WRITERS)
def test_a_file_that_somebody_edited_is_no_longer_ours(tmp_path, verb):
    WRITERS[verb](tmp_path / "out")
    for path in written(tmp_path / "out"):
        text = path.read_text()
        path.write_text("x" * max(len(text), 1))  # of the same size, where there is any
        said = refused("did not write", check_output, tmp_path / "out", force=True)
        assert path.relative_to(tmp_path / "out").as_posix() in said
        path.write_text(text)
    check_output(tmp_path / "out", force=True)


@pytest.mark.parametrize("verb", WRITERS)
def test_a_copy_or_a_move_within_an_output_is_somebodys(tmp_path, verb):
    out = tmp_path / "out"
    WRITERS[verb](out)
    shutil.copytree(out, tmp_path / "copy")
    shutil.move(tmp_path / "copy", out / "copy")
    refused("copy/", check_output, out, force=True)
    shutil.rmtree(out / "copy")
    first = written(out)[0]
    first.rename(first.with_name("renamed"))
    refused("renamed", check_output, out, force=True)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"written_by": "eventsweep", "files": {"a": 1}}', '{"schema": 1}']
)
def test_without_a_manifest_that_can_be_read_nothing_is_ours(tmp_path, text):
    put(tmp_path / "out", a="a", **{f"_0{NAME[1:]}": text})
    refused("a, which eventsweep did not write", check_output, tmp_path / "out", force=True)
    refused("older version", written_new, tmp_path / "out", "b")
    assert (tmp_path / "out" / NAME).read_text() == text


FOREIGN = [
    "thesis.tex", "figs/a.svg", "w000/notes.txt", "w000/mine/depth.npz", "tables/mine.csv",
    "desk/map/w000/mine.txt", "cam0/events.h5.bak", ".out.abcdefgh.partial/thesis.tex",
    ".thesis.download.partial", ".a.lock",
]  # fmt: skip


@pytest.mark.parametrize("verb", WRITERS)
@pytest.mark.parametrize("name", FOREIGN)
def test_what_others_put_into_an_output_is_named_and_kept(tmp_path, verb, name):
    out = tmp_path / "out"
    WRITERS[verb](out)
    path = out / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("precious")
    before = contents(tmp_path)
    with pytest.raises(InputError, match="did not write") as caught, atomic_dir(out, force=True):
        pass
    assert name in str(caught.value)
    assert "force" not in str(caught.value)
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == before


def test_a_link_into_an_output_is_never_ours(tmp_path):
    out = tmp_path / "out"
    write_map(out)
    (out / "w000" / "events.npz").rename(tmp_path / "precious")
    (out / "w000" / "events.npz").symlink_to(tmp_path / "precious")
    refused(r"w000/events\.npz", check_output, out, force=True)
    assert remove_ours(out) == ["w000/events.npz"]
    assert (tmp_path / "precious").read_text() == "n"


def test_a_pipe_is_not_replaced_by_a_file(tmp_path):
    """Nor a device: for root, `/dev/null` is a name like any other."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is a pipe, device"), atomic_path(tmp_path / "pipe"):
        pytest.fail("it is opened for writing")
    assert (tmp_path / "pipe").is_fifo()


def written_new(folder, name):
    with files_together(folder, [name]) as staged:
        put(staged, **{name.replace("/", "__"): "new"})


def test_nothing_is_written_through_a_link(tmp_path):
    """Neither a hard nor a symbolic one, of a file or of a folder on the way to it."""
    put(tmp_path, theirs__a="precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "tables").symlink_to(tmp_path / "theirs")
    for name in ("tables/a", "tables/b"):
        refused("tables", written_new, tmp_path / "out", name)
    with atomic_path(tmp_path / "out" / "hard") as path:
        path.write_text("old")
    os.link(tmp_path / "out" / "hard", tmp_path / "theirs" / "linked")
    (tmp_path / "soft").symlink_to(tmp_path / "theirs" / "a")
    for path in (tmp_path / "out" / "hard", tmp_path / "soft"):
        with atomic_path(path) as place:
            place.write_text("new")
    assert {path.name: path.read_text() for path in (tmp_path / "theirs").iterdir()} == {
        "a": "precious", "linked": "old"
    }  # fmt: skip


@pytest.mark.parametrize(("out", "given", "words"), [
    ("rec", "rec", "is the input itself"), ("rec", "link", "is the input itself"),
    ("parent", "parent/rec", "holds the input"),
    ("parent", "parent/rec/poses.txt", "holds the input"),
    ("rec/map", "rec", "is part of the input"),
])  # fmt: skip
def test_an_input_is_never_replaced(tmp_path, out, given, words):
    write_sequence(tmp_path / "rec")
    write_run(tmp_path / "parent")
    write_map(tmp_path / "rec" / "map")
    put(tmp_path / "parent" / "rec", poses_0txt="p")
    (tmp_path / "link").symlink_to("rec")
    before = contents(tmp_path)
    for force in (True, False):
        said = refused(words, check_output, tmp_path / out, force=force, inputs=[tmp_path / given])
        assert "force" not in said
    assert contents(tmp_path) == before


def test_files_that_a_descriptor_names_are_inputs(tmp_path):
    text = '[calibration]\nfile = "rig.json"\n[[events]]\nfile = "a.h5"\n'
    put(tmp_path, recording_0toml=text, rig_0json="{}", a_0h5="a")
    for source in (tmp_path / "recording.toml", tmp_path):
        assert {tmp_path / "rig.json", tmp_path / "a.h5"} <= set(inputs_of(source))
        with pytest.raises(InputError, match="input"):
            check_output(tmp_path / "a.h5", force=True, inputs=inputs_of(source), folder=False)


def test_where_one_works_or_lives_is_never_replaced(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_map(out)
    (out / "w000").chmod(0o755)
    monkeypatch.chdir(out / "w000")
    for path in (out, out / "w000", Path(), Path(".."), Path("/")):
        refused("the working directory: choose another output", check_output, path, force=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(out / "w000"))
    refused("holds the home folder", check_output, out, force=True)
    monkeypatch.undo()
    monkeypatch.setattr(outputs, "_mounts", lambda: [out / "w000"])
    refused("mounted file system", check_output, out, force=True)


def test_the_name_of_the_working_directory_leaves_nothing(tmp_path, monkeypatch):
    write_sequence(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    before = contents(tmp_path)
    refused(r"^\. is the working directory", atomic_dir(Path(), force=True).__enter__)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(("name", "folder", "words"), [
    ("file", True, "is a file, the output is a folder"),
    ("map", False, "is a folder, the output is a file"), ("pipe", False, "is not a regular file"),
    ("gone", True, "is a broken link"), ("file/below", True, "cannot make the folder"),
    ("a\0b", True, "not a valid file name"),
])  # fmt: skip
def test_files_and_folders_never_take_each_others_place(tmp_path, name, folder, words):
    put(tmp_path, file="f")
    write_map(tmp_path / "map")
    (tmp_path / "gone").symlink_to("nowhere")
    os.mkfifo(tmp_path / "pipe")
    before = contents(tmp_path)
    refused(words, check_output, tmp_path / name, force=True, folder=folder)
    assert contents(tmp_path) == before


def test_a_link_to_an_output_stays_a_link(tmp_path):
    write_map(tmp_path / "disk" / "map")
    (tmp_path / "out").symlink_to("disk/map")
    with atomic_dir(tmp_path / "out", force=True) as folder:
        put(folder, new="n")
    made = tmp_path / "disk" / "map"
    assert contents(tmp_path / "disk").keys() == {made, made / "new", made / NAME}
    assert (tmp_path / "out").readlink() == Path("disk/map")


# Races


@pytest.mark.parametrize(("before", "words"), [
    (False, r"finished output is in .*out\.finished"),
    (True, r"holds precious, .*: .*out\.finished"),
])  # fmt: skip
def test_what_appears_meanwhile_is_kept_and_so_is_the_work(tmp_path, before, words):
    out = tmp_path / "out"
    if before:
        write_map(out)

    def work():
        with atomic_dir(out, force=before) as folder:
            put(folder, new="n")
            put(out, precious="p")

    refused(words, work)
    assert (out / "precious").read_text() == "p"
    assert (out / "map.json").exists() is before
    assert (tmp_path / "out.finished" / "new").read_text() == "n"
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.finished"}


def test_what_comes_between_the_last_check_and_the_swap_is_kept(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_map(out)
    swap = outputs._swap

    def late(made, place, replaced):
        put(place, notes="p")
        swap(made, place, replaced)

    monkeypatch.setattr(outputs, "_swap", late)
    with pytest.raises(InputError, match=r"now contains .*notes"), atomic_dir(out, force=True):
        pass
    assert (out / "notes").read_text() == "p"
    assert (out / "map.json").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interrupt_in_the_swap_loses_neither_old_nor_new(tmp_path, monkeypatch, error):
    out = tmp_path / "out"
    write_map(out)
    before = contents(tmp_path)

    def stopped(made, place):
        raise error("stopped")

    monkeypatch.setattr(outputs, "_rename", stopped)
    with pytest.raises(error), atomic_dir(out, force=True):
        pass
    assert contents(tmp_path) == before


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_two_runs_into_one_output(tmp_path, kind):
    out = tmp_path / "out"
    make = atomic_dir if kind == "folder" else output_file
    with make(out) as place:
        put(place, a="a") if kind == "folder" else place.write_text("a")
        for second in (atomic_dir, output_file, output_folder):
            refused("another process is writing it", second(out).__enter__)
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_killed_run_leaves_no_claim(tmp_path):
    put(tmp_path, **{"_0out_0lock": outputs.LOCK.decode()})
    with atomic_dir(tmp_path / "out"):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_somebodys_file_of_the_claims_name_is_kept(tmp_path):
    for text in ("", "mine"):
        put(tmp_path, **{"_0out_0lock": text})
        with atomic_dir(tmp_path / "out", force=True):
            pass
        assert (tmp_path / ".out.lock").read_text() == text
        shutil.rmtree(tmp_path / "out")


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
    assert {path.name for path in out.parent.iterdir()} == {"out"}


# Nothing is left of what was refused


@pytest.mark.parametrize("make", [atomic_dir, output_file, output_folder])
def test_a_refused_output_leaves_no_folders(tmp_path, make):
    with pytest.raises(InputError, match="no"), make(tmp_path / "a" / "b" / "out"):
        raise InputError("no")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_appears_meanwhile_is_kept(tmp_path):
    def work():
        with output_file(tmp_path / "out.npz") as place:
            assert place.name == "out.npz"
            place.write_text("new")
            put(tmp_path, out_0npz="precious")

    refused(r"finished output is in .*out\.finished\.npz", work)
    assert (tmp_path / "out.npz").read_text() == "precious"
    assert (tmp_path / "out.finished.npz").read_text() == "new"


def test_an_error_about_a_file_names_it_and_not_where_it_is_made(tmp_path):
    path = tmp_path / "out.npz"
    with pytest.raises(InputError) as caught, output_file(path) as place:
        raise InputError(f"{place}: too large")
    assert str(caught.value) == f"{path}: too large"


# Anything at all

MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
ENTRY = st.sampled_from(
    ["thesis.tex", "w000/depth.npz", "map.json", "tables/a.csv", ".in.abcdefgh.partial/a", NAME]
)
SPOT = st.sampled_from(["out", "out/in", "parent", "other", "out/w000", "link", "parent/out"])


def plant(root, kinds, foreign, link):
    """Outputs of ours here and there, what others put beside and in them, and a link."""
    for place, verb in kinds.items():
        WRITERS[verb](root / place)
    ours = set(contents(root))
    for place, name in foreign:
        path = root / place / name
        if any(one.is_file() for one in (path, *path.parents)) or path.exists():
            continue
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
    kinds.pop("link", None)
    foreign = [(place, name) for place, name in foreign if place != "link"]
    root = Path(tempfile.mkdtemp(dir=MEMORY))
    home, fsync = Path.cwd(), os.fsync
    os.fsync = lambda _file: None  # a real disk takes most of the time
    try:
        theirs = plant(root, kinds, foreign, link)
        inputs = [root / one for one in given_inputs]
        read = {
            path: what for one in inputs for path, what in contents(os.path.realpath(one)).items()
        }
        if verb == "together":  # may add to what it reads, and lists that in a manifest of ours
            read.pop(Path(os.path.realpath(root / out)) / NAME, None)
        before = contents(root)
        if (root / working).is_dir():
            os.chdir(root / working)
        event(f"{verb} {'existing' if (root / out).exists() else 'new'}")
        refused = not attempt(root / out, verb, inputs)
        after = contents(root)
        for path, what in {**theirs, **read}.items():
            assert after.get(path) == what, (path, "is lost")
        event("refused" if refused else "made")
        if refused:
            assert after == before
        new = after.keys() - theirs.keys()
        assert not [path for path in new if path.name.endswith((".lock", ".partial", MARK))]
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
            names = ["map.json", "tables/a.csv"]
            with (
                output_folder(out, names, force=True, inputs=inputs),
                files_together(out, names) as staged,
            ):
                put(staged, map_0json="new", tables__a_0csv="new")
        else:
            with atomic_dir(out, force=True, inputs=inputs) as folder:
                WRITERS[verb](folder)
    except InputError:
        return False
    return True


# Kills


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
    with claimed(out):
        if (out / "part0").exists():
            return
        with output_folder(following):
            following.mkdir(exist_ok=True)
            for part in (following / "part0", following / "part1"):
                if not part.exists():
                    with atomic_dir(part, claim=False, part_of=following) as folder:
                        put(folder, a="new")
            with files_together(following, ["index"]) as staged:
                put(staged, index="new")
        replace_dir(following, out)


def one_file(out):
    with output_file(out / "a.xml", force=True, listed=True) as place:
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
    *product(KILLED, ("nothing",)),
]


@pytest.mark.parametrize(("call", "before"), often(OFTEN, [*OFTEN, *SELDOM]))
def test_killed_at_any_step_it_ends_with_the_same_bytes(memory, call, before):
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

    def check(step):
        assert strangers(out) in ([], ["mine.txt"]) if (out / NAME).exists() else True
        make(out)
        assert contents(memory) == expected, step
        start()

    start()
    make(out)
    expected = contents(memory)
    start()
    assert killed_at_every_step(lambda: make(out), check) > 5
    assert contents(memory) == expected


def test_a_kill_between_old_and_new_gives_the_old_one_back(tmp_path):
    out, hidden = tmp_path / "out", tmp_path / ".out.abcdefgh.partial"
    write_map(hidden / "replaced")
    before = contents(hidden / "replaced").keys()
    (hidden / MARK).touch()
    with pytest.raises(InputError, match="exists"), atomic_dir(out):
        pass
    assert {path.relative_to(out) for path in contents(out)} == {
        path.relative_to(hidden / "replaced") for path in before
    }
    assert not hidden.exists()


def test_what_somebody_put_into_an_output_that_was_replaced_stays(tmp_path):
    hidden = tmp_path / ".out.abcdefgh.partial"
    write_map(hidden / "replaced")
    put(hidden, replaced__thesis="mine")
    (hidden / MARK).touch()
    write_map(tmp_path / "out")
    for _ in range(2):
        with atomic_dir(tmp_path / "out", force=True):
            pass
        assert (hidden / "replaced" / "thesis").read_text() == "mine"


# Files beside others


def test_a_file_of_the_same_name_is_not_ours_for_that(tmp_path):
    put(tmp_path, b="somebody's")
    refused(r"holds b, which eventsweep did not write", check_files, tmp_path, ["b"], force=True)
    refused("did not write", written_new, tmp_path, "b")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("b", "somebody's")]


def test_what_is_listed_and_unchanged_is_written_anew(tmp_path):
    for text in ("one", "two"):
        with files_together(tmp_path, ["a/b"]) as staged:
            (staged / "a" / "b").write_text(text)
        assert (tmp_path / "a" / "b").read_text() == text
    facts = output_manifest.read(tmp_path).files["a/b"]
    assert facts == (3, sha256("two"))
    assert strangers(tmp_path) == []
    (tmp_path / "a" / "b").write_text("own")
    refused("a/b", written_new, tmp_path, "a/b")
    assert (tmp_path / "a" / "b").read_text() == "own"


def test_a_part_belongs_to_the_output_that_made_it(tmp_path):
    write_map(tmp_path / "out")
    for listed in (False, True):
        with atomic_dir(
            tmp_path / "out" / f"part{listed}", part_of=tmp_path / "out" if listed else None
        ) as folder:
            put(folder, a="a")
    assert strangers(tmp_path / "out") == [f"partFalse/{NAME}", "partFalse/a"]


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
    assert list(tmp_path.iterdir()) == []


def test_other_faults_of_the_system_stay_what_they_are(tmp_path):
    with pytest.raises(IsADirectoryError), atomic_dir(tmp_path / "out") as folder:
        folder.write_text("x")


def test_hdf5s_word_for_a_full_disk_is_understood(tmp_path):
    words = "Can't write data (file write failed: errno = 28, 'No space left on device')"
    with pytest.raises(DiskFull, match="out: no space left"), atomic_dir(tmp_path / "out"):
        raise OSError(words)


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 bytes"), (999, "999 bytes"), (1000, "1 kB"), (4096, "4.1 kB"), (999_400, "999 kB"),
     (999_600, "1 MB"), (3.2e6, "3.2 MB"), (1.05e9, "1.05 GB"), (10**18, "1 EB")],
)  # fmt: skip
def test_sizes_are_said_in_the_unit_that_suits_them(count, text):
    assert bytes_text(count) == text
