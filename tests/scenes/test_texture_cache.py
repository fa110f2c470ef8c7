"""Kept textures: the bytes that would be drawn, never stale, and never in the way."""

import errno
import multiprocessing
import os
import shutil
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.emvs.utils import cache as cache_module
from eventsweep.emvs.utils.cache import Cache
from eventsweep.scenes.parts import texture_cache
from eventsweep.scenes.parts.texture_cache import kept
from places import ROOT
from tiers import often

QUICK = ("low-texture", "reflective", "repetitive", "thin-structures")
ALL = often(QUICK, scenes.names())
SHAPES = {"wall": (6, 4, 3), "ball": (12, 2, 3)}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Where the textures of a test are kept: nowhere yet."""
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    texture_cache._makers.cache_clear()
    yield tmp_path / "cache" / "textures"
    texture_cache._makers.cache_clear()


@pytest.fixture
def drawings():
    """A mark for every time that `textures` of this file draws."""
    return []


@pytest.fixture
def textures(drawings):
    """Textures as a scene has them, noise of always the same seed."""

    def draw():
        drawings.append(len(drawings))
        rng = np.random.default_rng(0)
        return {name: rng.integers(0, 256, shape, np.uint8) for name, shape in SHAPES.items()}

    return kept(draw)


def same(one, other):
    assert one.keys() == other.keys()
    for name in one:
        assert one[name].dtype == other[name].dtype == np.uint8
        np.testing.assert_array_equal(one[name], other[name])


def entries(folder):
    return sorted(folder.glob("??/*/entry.json"))


@pytest.mark.parametrize("name", ALL)
def test_kept_bytes_are_the_drawn_ones(name, folder):
    textures = scenes.load(name).textures
    drawn = textures.__wrapped__()
    same(textures(), drawn)
    assert len(entries(folder)) == 1
    same(textures(), drawn)


def test_what_is_kept_is_not_drawn(textures, drawings):
    first = textures()
    same(textures(), first)
    assert drawings == [0]


def copied(monkeypatch, tmp_path):
    """The package's files where a test may edit them."""
    package = shutil.copytree(ROOT / "scenes", tmp_path / "scenes")
    monkeypatch.setattr(texture_cache, "_PACKAGE", package)
    return package


@pytest.mark.parametrize("file", ["desk.py", "parts/stock.py", "textures/noise.py", "new.py"])
def test_an_edit_of_any_file_draws_anew(textures, drawings, file, tmp_path, monkeypatch):
    package = copied(monkeypatch, tmp_path)
    textures()
    with (package / file).open("a") as source:
        source.write("# another line\n")
    texture_cache._makers.cache_clear()
    textures()
    assert drawings == [0, 1]


def test_another_version_of_a_library_draws_anew(textures, drawings, monkeypatch):
    textures()
    now = texture_cache.versions()
    monkeypatch.setattr(texture_cache, "versions", lambda: now | {"opencv-python-headless": "0"})
    texture_cache._makers.cache_clear()
    textures()
    assert drawings == [0, 1]


@pytest.mark.parametrize("name", ALL)
def test_nothing_draws_but_what_is_in_the_hash(name):
    draw, files = scenes.load(name).textures.__wrapped__, set()
    sys.setprofile(lambda frame, event, _: files.add(frame.f_code.co_filename))
    try:
        draw()
    finally:
        sys.setprofile(None)
    ours = {file for file in files if file.startswith(f"{ROOT}{os.sep}")} - {__file__}
    drew = {Path(file).resolve().relative_to(ROOT).parts[0] for file in ours} - {".venv"}
    assert drew == {"scenes"}


def test_functions_of_one_name_in_two_modules_are_two():
    def draw():
        return {"one": np.zeros((2, 2, 3), np.uint8)}

    def other():
        return {"two": np.zeros((2, 2, 3), np.uint8)}

    other.__qualname__, other.__module__ = draw.__qualname__, "scenes.attic"
    assert set(kept(draw)()) == {"one"}
    assert set(kept(other)()) == {"two"}


def flip(file):
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(data)


@pytest.mark.parametrize("damage", [
    flip, Path.unlink, lambda file: file.write_bytes(b""),
    lambda file: os.truncate(file, file.stat().st_size - 1),
], ids=["flip", "unlink", "empty", "truncate"])  # fmt: skip
@pytest.mark.parametrize("name", ["data/textures.npz", "entry.json"])
def test_what_is_damaged_is_drawn_anew(textures, drawings, folder, damage, name):
    first = textures()
    (entry,) = entries(folder)
    damage(entry.parent / name)
    same(textures(), first)
    assert drawings == [0, 1]
    same(textures(), first)
    assert drawings == [0, 1]


def test_a_folder_that_cannot_be_made_costs_only_time(textures, drawings, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", "/proc/nowhere")
    assert set(textures()) == set(SHAPES)
    assert set(textures()) == set(SHAPES)
    assert drawings == [0, 1]


def test_what_is_kept_in_a_read_only_folder_is_used(textures, drawings, monkeypatch):
    first = textures()

    def refused(*_):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Cache, "get", refused)
    monkeypatch.setattr(os, "utime", refused)
    same(textures(), first)
    assert drawings == [0]


def test_a_full_disk_costs_only_the_keeping(textures, drawings, folder, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    assert set(textures()) == set(SHAPES)
    assert drawings == [0]
    assert entries(folder) == []
    assert list(folder.rglob("*.npz")) == []


def test_what_drawing_raises_passes_through():
    def draw():
        raise ValueError("no such colour")

    with pytest.raises(ValueError, match="no such colour"):
        kept(draw)()


def test_what_was_not_used_for_longest_goes_first(folder, monkeypatch):
    def of(name):
        def draw():
            return {name: np.zeros((100, 100, 3), np.uint8)}

        draw.__qualname__ = name
        return kept(draw)

    monkeypatch.setattr(texture_cache, "_KEEP_BYTES", 100_000)
    one, two, three = (of(name) for name in ("one", "two", "three"))
    one(), two()
    for age_s, entry in enumerate(entries(folder)):
        os.utime(entry, (age_s, age_s))
    oldest = entries(folder)[0].parent
    three()
    assert len(entries(folder)) == 2
    assert not oldest.exists()


def _drawn_by_one(marks):
    def draw():
        (marks / str(os.getpid())).touch()
        return {"wall": np.full((64, 64, 3), 7, np.uint8)}

    draw.__qualname__ = "draw"
    assert (kept(draw)()["wall"] == 7).all()


def test_processes_at_once_draw_once(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    context = multiprocessing.get_context("fork")
    team = [context.Process(target=_drawn_by_one, args=(marks,)) for _ in range(4)]
    for process in team:
        process.start()
    for process in team:
        process.join()
    assert [process.exitcode for process in team] == [0] * 4
    assert len(list(marks.iterdir())) == 1


def test_files_deleted_before_they_are_listed_are_no_entry(textures, folder, monkeypatch):
    """No texture may be missing from what is read later because it was gone when it was listed."""
    listed = cache_module._files

    def deleting(data):
        files = sorted(data.iterdir())
        files[0].unlink()
        return listed(data)

    monkeypatch.setattr(cache_module, "_files", deleting)
    first = textures()
    assert set(first) == set(SHAPES)
    monkeypatch.undo()
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(folder.parent))
    assert entries(folder) == []
    same(textures(), first)
    assert len(entries(folder)) == 1


def test_the_folder_may_be_deleted_at_any_time(textures, folder):
    first, stop = textures(), threading.Event()

    def delete():
        while not stop.is_set():
            shutil.rmtree(folder, ignore_errors=True)

    deleting = threading.Thread(target=delete)
    deleting.start()
    try:
        for _ in range(100):
            same(textures(), first)
    finally:
        stop.set()
        deleting.join()
