"""An output at an address takes another one's place: the old one whole, the new one, or neither."""

import re

import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import address, output_manifest
from eventsweep.eval.cli.replaced import check_free, replaced
from refusals import line_of

fsspec = pytest.importorskip("fsspec")
AT, BESIDE = "memory://lab/out", "memory://lab/.out.next/out"
OLD = {"map.json": "old", "w000/window.json": "old", "w000/depth.npz": "old", "gone.npz": "old"}
NEW = {"map.json": "newer", "w000/window.json": "newer", "w000/depth.npz": "newer", "w.npz": "new"}


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(address, "_PAUSE_S", 0.001)


@pytest.fixture
def memory():
    """An empty store in memory."""
    files = fsspec.filesystem("memory")
    files.store.clear()
    files.pseudo_dirs[:] = [""]
    return files


@pytest.fixture
def there(memory, tmp_path):
    """An output of this program at the address, and a function that says what is there now."""
    put(memory, tmp_path)
    return lambda: contents(memory, "/lab/out/")


def put(memory, tmp_path):
    memory.store.clear()
    memory.pseudo_dirs[:] = [""]
    fill(tmp_path / "old", OLD)
    memory.put(str(tmp_path / "old"), "/lab/out", recursive=True)


def fill(folder, texts):
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    output_manifest.complete(folder)


def contents(memory, start):
    """Text of every file, but for the manifest."""
    return {
        place.removeprefix(start): file.getvalue().decode()
        for place, file in memory.store.items()
        if place.startswith(start) and not place.endswith(output_manifest.NAME)
    }


def replace(*inputs):
    with replaced(AT, BESIDE, inputs) as place:
        assert not place.exists(), "a mirror of its own"
        fill(place, NEW)
    return place


def test_ours_is_replaced_by_the_new_one_and_nothing_is_left_beside(memory, there):
    place = replace("memory://lab/outside", "memory://lab/ou")
    assert there() == NEW
    assert contents(memory, "/lab/.out") == {}
    assert not place.exists()
    replace()
    assert there() == NEW


def test_where_nothing_is_it_is_made(memory):
    replace()
    assert contents(memory, "/lab/out/") == NEW
    assert "exists: choose another output, or add --force" in line_of(lambda: check_free(AT))
    check_free("memory://lab/other")


@pytest.mark.parametrize(("name", "text"), [
    ("thesis.tex", "mine"), ("w000/depth.npz", "changed"), ("w000/notes", ""),
    (".eventsweep.json", "{}"),
])  # fmt: skip
def test_what_is_not_ours_or_was_changed_is_never_replaced(memory, there, name, text):
    memory.pipe_file(f"/lab/out/{name}", text.encode())
    before = dict(there())
    line = line_of(replace)
    assert "which eventsweep did not write, or which was changed since" in line
    assert there() == before
    assert contents(memory, "/lab/.out") == {}


@pytest.mark.parametrize("source", ["memory://lab/out", "memory://lab/out/w000", "memory://lab"])
def test_what_is_read_is_not_replaced(there, source):
    assert f"is, holds or is part of the input {source}" in line_of(lambda: replace(source))
    assert there() == OLD


def test_an_error_of_the_command_leaves_the_old_one(memory, there):
    with pytest.raises(ZeroDivisionError), replaced(AT, BESIDE):
        raise ZeroDivisionError
    assert there() == OLD
    assert contents(memory, "/lab/.out") == {}


class Cut(Exception):
    """The program is killed here."""


def killed_at(memory, monkeypatch, step):
    """Replaces the output; the program is killed before a step of the store, if it has as many."""
    left = [step]

    def until_cut(name):
        call = getattr(type(memory), name)

        def cut(self, *arguments, **more):
            left[0] -= 1
            if left[0] < 0:
                raise Cut
            return call(self, *arguments, **more)

        monkeypatch.setattr(type(memory), name, cut)

    with monkeypatch.context() as monkeypatch:
        monkeypatch.setattr(address, "_FINAL", (*address._FINAL, Cut))
        for name in ("put_file", "cp_file", "rm_file", "pipe_file"):
            until_cut(name)
        try:
            replace()
        except InputError:
            return True
    return False


def test_whenever_it_is_killed_there_is_the_old_one_the_new_one_or_none_that_seems_whole(
    memory, tmp_path, monkeypatch
):
    """Then the same command makes it whole."""
    seen = []
    for step in range(99):
        put(memory, tmp_path)
        died, now = killed_at(memory, monkeypatch, step), contents(memory, "/lab/out/")
        whole = [name for name, kind in (("old", OLD), ("new", NEW)) if now == kind]
        assert whole or "map.json" not in now
        assert whole or contents(memory, "/lab/.out.next/out/") == NEW
        if died:
            replace()
        assert contents(memory, "/lab/out/") == NEW
        assert contents(memory, "/lab/.out") == {}
        seen += whole or ["neither"]
        if not died:
            break
    assert seen == sorted(seen, key=["old", "neither", "new"].index)
    assert set(seen) == {"old", "neither", "new"}


def test_a_lost_connection_says_where_the_finished_output_is(memory, there, monkeypatch):
    def cut(*_arguments, **_more):
        raise ConnectionError("cut")

    monkeypatch.setattr(type(memory), "cp_file", cut)
    assert re.search(r"finished output is in memory://lab/.out.next: repeat", line_of(replace))
    assert contents(memory, "/lab/.out.next/out/") == NEW
