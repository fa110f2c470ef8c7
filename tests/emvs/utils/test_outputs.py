"""Outputs: nothing that was there is lost, and nothing is left of what was refused."""

import json
import os
import re
import shutil
import tempfile
import threading
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import outputs
from eventsweep.emvs.utils.files import DiskFull, atomic_path, bytes_text, free_bytes
from eventsweep.emvs.utils.outputs import (
    atomic_dir,
    check_output,
    files_together,
    inputs_of,
    output_file,
    output_folder,
)
from eventsweep.emvs.utils.ownership import MARKER, mark, remove_ours, strangers
from killed import killed_at_every_step

PAGE = "<!doctype html>\n<title>eventsweep · x</title>"
RESULTS = '{"rows": [], "configuration": {}}'
INDEX = {
    "schema_version": 1, "recording": {}, "config": {},
    "windows": [{"name": "w000", "methods": ["Alg1/H"]}],
}  # fmt: skip


def put(folder, **files):
    """Writes files, whose names have `__` for slashes and `_0` for dots."""
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_0", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_sequence(folder):
    manifest = {"schema_version": 1, "event_counts": [1], "files": {"cam0/events.h5": {}}}
    put(folder, cam0__events_0h5="events", manifest_0json=json.dumps(manifest))


def write_map(folder):
    put(folder, map_0json=json.dumps(INDEX), report_0html=PAGE, overview_0png="png")
    put(folder / "w000", events_0npz="n", slices_0npz="n", window_0json='{"methods": ["Alg1/X"]}')
    put(folder / "w000" / "Alg1-H", depth_0npz="d", cloud_0ply="c")
    put(folder / "w000" / "dsi", **{"Alg1-H_0npy": "v"})
    put(folder / "global" / "Alg1-H", fuse_0json="{}", cloud_0ply="c")


def write_run(folder):
    write_sequence(folder / "desk" / "sequence")
    write_map(folder / "desk" / "map")
    put(folder, config_0toml="", results_0json=RESULTS, results_0csv="", report_0html=PAGE)
    put(folder / "tables", ranking_0csv="r")
    mark(folder / "tables")


def write_converted(folder):
    put(folder, events__left__events_0h5="e", poses_0txt="p")
    mark(folder)


def write_fused(folder):
    put(folder, fuse_0json='{"method": "m", "window_points": 1}', cloud_0ply="c", mesh_0ply="m")


def write_suite(folder):
    put(folder, suite_0json='{"suite": "quick", "samples": []}', suite_0csv="case")


def write_study(folder):
    put(folder, noise_0json='{"study": "noise", "breaks_at": {}}', noise_0csv="", noise_0svg="")


def write_comparison(folder):
    put(folder, compare_0html=PAGE, tables__changes_0csv="c")
    mark(folder / "tables")


WRITERS = {
    "simulate": write_sequence, "map": write_map, "run": write_run, "convert": write_converted,
    "fuse": write_fused, "suite": write_suite, "study": write_study, "compare": write_comparison,
}  # fmt: skip


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
    assert contents(tmp_path) == {out: "folder", out / "new": b"new"}


FOREIGN = [
    "thesis.tex", "figs/a.svg", "w000/notes.txt", "w000/mine/depth.npz", "tables/mine.csv",
    "desk/map/w000/mine.txt", "cam0/events.h5.bak", "empty/",
]  # fmt: skip


@pytest.mark.parametrize("verb", WRITERS)
@pytest.mark.parametrize("name", FOREIGN)
def test_what_others_put_into_an_output_is_named_and_kept(tmp_path, verb, name):
    out = tmp_path / "out"
    WRITERS[verb](out)
    path = out / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.mkdir() if name.endswith("/") else path.write_text("precious")
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
    (out / "w000" / "events.npz").unlink()
    put(tmp_path, precious="p")
    (out / "w000" / "events.npz").symlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match=r"w000/events\.npz"):
        check_output(out, force=True)
    assert remove_ours(out) == ["w000/events.npz"]
    assert (tmp_path / "precious").read_text() == "p"


@pytest.mark.parametrize(
    ("out", "given", "words"),
    [
        ("rec", "rec", "is the input itself"),
        ("rec", "link", "is the input itself"),
        ("parent", "parent/rec", "holds the input"),
        ("parent", "parent/rec/poses.txt", "holds the input"),
        ("rec/map", "rec", "is part of the input"),
    ],
)
def test_an_input_is_never_replaced(tmp_path, out, given, words):
    write_sequence(tmp_path / "rec")
    write_run(tmp_path / "parent")
    write_map(tmp_path / "rec" / "map")
    put(tmp_path / "parent" / "rec", poses_0txt="p")
    (tmp_path / "link").symlink_to("rec")
    before = contents(tmp_path)
    for force in (True, False):
        with pytest.raises(InputError, match=words) as caught:
            check_output(tmp_path / out, force=force, inputs=[tmp_path / given])
        assert "force" not in str(caught.value)
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
        with pytest.raises(InputError, match="the working directory: choose another output"):
            check_output(path, force=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(out / "w000"))
    with pytest.raises(InputError, match="holds the home folder"):
        check_output(out, force=True)
    monkeypatch.undo()
    monkeypatch.setattr(outputs, "_mounts", lambda: [out / "w000"])
    with pytest.raises(InputError, match="mounted file system"):
        check_output(out, force=True)


def test_the_name_of_the_working_directory_leaves_nothing(tmp_path, monkeypatch):
    write_sequence(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    before = contents(tmp_path)
    with (
        pytest.raises(InputError, match=r"^\. is the working directory"),
        atomic_dir(Path(), force=True),
    ):
        pass
    assert contents(tmp_path) == before


def test_files_and_folders_never_take_each_others_place(tmp_path):
    put(tmp_path, file="f")
    write_map(tmp_path / "map")
    (tmp_path / "gone").symlink_to("nowhere")
    os.mkfifo(tmp_path / "pipe")
    before = contents(tmp_path)
    for name, folder, words in (
        ("file", True, "is a file, the output is a folder"),
        ("map", False, "is a folder, the output is a file"),
        ("pipe", False, "is no plain file"),
        ("gone", True, "which is not there"),
        ("file/below", True, "cannot make the folder"),
        ("a\0b", True, "not a valid file name"),
    ):
        with pytest.raises(InputError, match=words):
            check_output(tmp_path / name, force=True, folder=folder)
    assert contents(tmp_path) == before


def test_a_link_to_an_output_stays_a_link(tmp_path):
    write_map(tmp_path / "disk" / "map")
    (tmp_path / "out").symlink_to("disk/map")
    with atomic_dir(tmp_path / "out", force=True) as folder:
        put(folder, new="n")
    assert contents(tmp_path / "disk") == {
        tmp_path / "disk" / "map": "folder", tmp_path / "disk" / "map" / "new": b"n"
    }  # fmt: skip
    assert (tmp_path / "out").readlink() == Path("disk/map")


# Races


def test_a_folder_that_appears_meanwhile_is_kept_and_so_is_the_work(tmp_path):
    out = tmp_path / "out"

    def work():
        with atomic_dir(out) as folder:
            put(folder, new="n")
            put(out, precious="p")

    with pytest.raises(InputError, match=r"finished output is in .*out\.finished"):
        work()
    assert (out / "precious").read_text() == "p"
    assert (tmp_path / "out.finished" / "new").read_text() == "n"
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.finished"}


def test_what_somebody_adds_meanwhile_is_kept_and_so_is_the_work(tmp_path):
    out = tmp_path / "out"
    write_map(out)

    def work():
        with atomic_dir(out, force=True) as folder:
            put(folder, new="n")
            put(out, notes="p")

    with pytest.raises(InputError, match=r"\(notes\) *: .*out\.finished"):
        work()
    assert (out / "notes").read_text() == "p"
    assert (out / "map.json").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out.finished"}


def test_what_comes_between_the_last_check_and_the_swap_is_kept(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_map(out)
    swap = outputs._swap

    def late(made, place):
        put(place, notes="p")
        swap(made, place)

    monkeypatch.setattr(outputs, "_swap", late)
    with pytest.raises(InputError, match=r"now holds .*notes"), atomic_dir(out, force=True):
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
            with pytest.raises(InputError, match="another process is writing it"), second(out):
                pass
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_killed_run_leaves_no_claim(tmp_path):
    put(tmp_path, **{"_0out_0lock": outputs._LOCK.decode()})
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

    with pytest.raises(InputError, match=r"finished output is in .*out\.finished\.npz"):
        work()
    assert (tmp_path / "out.npz").read_text() == "precious"
    assert (tmp_path / "out.finished.npz").read_text() == "new"


def test_an_error_about_a_file_names_it_and_not_where_it_is_made(tmp_path):
    path = tmp_path / "out.npz"
    with pytest.raises(InputError) as caught, output_file(path) as place:
        raise InputError(f"{place}: too large")
    assert str(caught.value) == f"{path}: too large"


# Anything at all

MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
ENTRY = st.sampled_from(["thesis.tex", "w000/Alg1-H/depth.npz", "map.json", "tables/a.csv", "w/"])
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
        path.mkdir() if name.endswith("/") else path.write_text(f"precious {place}/{name}")
    if link is not None and not os.path.lexists(root / "link"):
        (root / "link").symlink_to(root / link)
    return {path: what for path, what in contents(root).items() if path not in ours}


ANYTHING = given(
    kinds=st.dictionaries(SPOT, st.sampled_from(sorted(WRITERS)), max_size=3),
    foreign=st.lists(st.tuples(SPOT, ENTRY), max_size=4),
    link=st.none() | SPOT,
    out=SPOT,
    given_inputs=st.lists(SPOT, max_size=2),
    verb=st.sampled_from([*sorted(WRITERS), "file"]),
    working=st.sampled_from(["", "", "out", "parent"]),
)


@settings(max_examples=400, deadline=None)
@ANYTHING
def test_whatever_lies_where_nothing_of_others_is_lost(**drawn):
    check_nothing_is_lost(**drawn)


@pytest.mark.slow
@settings(max_examples=10_000, deadline=None)
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
        assert not [path for path in after if path.name.endswith((".lock", ".partial", ".old"))]
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
        else:
            with atomic_dir(out, force=True, inputs=inputs) as folder:
                WRITERS[verb](folder)
    except InputError:
        return False
    return True


# --- files that belong together


def put_together(folder, text, index=""):
    names = ["b", "c", index or MARKER]
    with files_together(folder, names, index=index) as staged:
        for name in names[:-1]:
            (staged / name).write_text(text)
        if index:
            (staged / index).write_text('{"study": "x", "breaks_at": {}}')
        else:
            mark(staged, folder)


@pytest.mark.parametrize("before", [False, True])
def test_files_that_belong_together_are_ours_wherever_a_kill_comes(tmp_path, before):
    folder = tmp_path / "out"

    def start():
        shutil.rmtree(folder, ignore_errors=True)
        put(folder, mine_0txt="mine")
        if before:
            put_together(folder, "old one")

    def check(step):
        assert strangers(folder) == ["mine.txt"] if (folder / MARKER).exists() else True
        assert strangers(folder, ["b", "c", MARKER]) == [], step
        put_together(folder, "a newer text")
        assert sorted(path.name for path in folder.iterdir()) == [MARKER, "b", "c", "mine.txt"]
        start()

    start()
    assert killed_at_every_step(lambda: put_together(folder, "new"), check) > 5
    assert (folder / "b").read_text() == "new"
    assert (folder / "mine.txt").read_text() == "mine"


def test_a_file_of_the_same_name_is_not_ours_for_that(tmp_path):
    put(tmp_path, b="a longer text of somebody's")
    with suppress(RuntimeError), files_together(tmp_path, ["b", MARKER]) as staged:
        (staged / "b").write_text("ours")
        mark(staged, tmp_path)
        assert strangers(tmp_path, ["b"]) == ["b"]
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["b"]
    assert (tmp_path / "b").read_text() == "a longer text of somebody's"


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
