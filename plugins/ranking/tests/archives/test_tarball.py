"""Archives are the same bytes each time, and nothing inside them is believed."""

import hashlib
import io
import sys
import tarfile

import pytest

from eventsweep.plugins.ranking.archives.manifest import PackedFile
from eventsweep.plugins.ranking.archives.tarball import first_member, pack, unpack
from refusals import line_of

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

CONTENT = {"a.txt": b"first", "cam0/events.h5": b"second" * 1000}
ONE = {"a.txt": PackedFile(sha256=hashlib.sha256(b"first").hexdigest(), bytes=5)}


def listed(content):
    return {
        name: PackedFile(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data))
        for name, data in content.items()
    }


def files(folder, content=CONTENT):
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def entry(name, data=b"first", kind=tarfile.REGTYPE, link=""):
    member = tarfile.TarInfo(name)
    member.size, member.type, member.linkname = len(data), kind, link
    return member, data


def archived(path, *members):
    with zstd.open(path, "wb") as stream, tarfile.open(fileobj=stream, mode="w") as tar:
        for member, data in members:
            tar.addfile(member, io.BytesIO(data))
    return path


def test_what_was_packed_comes_out_and_nothing_else(tmp_path):
    pack(tmp_path / "one.tar.zst", files(tmp_path / "in"), CONTENT)
    out = tmp_path / "out"
    out.mkdir()
    unpack(tmp_path / "one.tar.zst", out, listed(CONTENT))
    found = {p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()}
    assert found == CONTENT


def test_the_same_files_give_the_same_bytes(tmp_path):
    """Whenever, by whoever, with whatever rights and in whatever order they were written."""
    turned = dict(reversed(CONTENT.items()))
    first, second = files(tmp_path / "one"), files(tmp_path / "two", turned)
    (second / "a.txt").chmod(0o600)
    (second / "a.txt").touch()
    facts = [
        pack(tmp_path / f"{folder.name}.tar.zst", folder, names)
        for folder, names in ((first, CONTENT), (second, turned))
    ]
    whole, other = ((tmp_path / f"{name}.tar.zst").read_bytes() for name in ("one", "two"))
    assert whole == other
    assert facts[0] == facts[1] == (hashlib.sha256(whole).hexdigest(), len(whole))


HOSTILE = {
    "a name that leads out": ([entry("../a.txt")], "does not belong there"),
    "an absolute name": ([entry("/tmp/a.txt")], "does not belong there"),
    "a name that leads out and back": ([entry("x/../a.txt")], "does not belong there"),
    "another file": ([entry("b.txt")], "does not belong there"),
    "a symbolic link": ([entry("a.txt", b"", tarfile.SYMTYPE, "/etc/passwd")],
     "not a regular file"),
    "a hard link": ([entry("a.txt", b"", tarfile.LNKTYPE, "/etc/passwd")], "not a regular file"),
    "a device": ([entry("a.txt", b"", tarfile.CHRTYPE)], "not a regular file"),
    "a folder": ([entry("a.txt", b"", tarfile.DIRTYPE)], "not a regular file"),
    "too large": ([entry("a.txt", b"firsts")], "has 6 bytes, should be 5"),
    "too small": ([entry("a.txt", b"firs")], "has 4 bytes, should be 5"),
    "another content": ([entry("a.txt", b"tsrif")], "was changed"),
    "a name twice": ([entry("a.txt"), entry("a.txt")], "appears twice"),
    "nothing": ([], "a.txt is missing"),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_archive_is_one_line_and_writes_nothing_outside(tmp_path, kind):
    members, words = HOSTILE[kind]
    out = tmp_path / "deep" / "out"
    out.mkdir(parents=True)
    assert words in line_of(unpack, archived(tmp_path / "bad.tar.zst", *members), out, ONE)
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["out"]


def test_nothing_is_written_through_a_link_that_is_there(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "precious").write_bytes(b"mine!")
    (tmp_path / "out" / "a.txt").symlink_to(tmp_path / "precious")
    line_of(unpack, archived(tmp_path / "one.tar.zst", entry("a.txt")), tmp_path / "out", ONE)
    assert (tmp_path / "precious").read_bytes() == b"mine!"


@pytest.mark.parametrize("where", ["a file", "a name"])
def test_a_bomb_is_stopped_by_the_sizes_in_the_manifest(tmp_path, where):
    """A gigabyte of zeros is 30 kB of zstd: no more is unpacked than was promised."""
    zeros = bytes(1 << 20)
    path = tmp_path / "bomb.tar.zst"
    member, _ = entry("a.txt")
    with zstd.open(path, "wb") as stream:
        if where == "a file":
            member.size = 1 << 30
            stream.write(member.tobuf())
        if where == "a name":
            name = tarfile.TarInfo("././@LongLink")
            name.type, name.size = tarfile.GNUTYPE_LONGNAME, 1 << 30
            stream.write(name.tobuf())
        for _ in range(256):
            stream.write(zeros)
    (tmp_path / "out").mkdir()
    line_of(unpack, path, tmp_path / "out", ONE)
    assert sum(p.stat().st_size for p in (tmp_path / "out").rglob("*")) <= 5


@pytest.mark.parametrize("spoil", [lambda d: d[:-20], lambda d: b"no archive", lambda d: b""])
def test_a_damaged_archive_is_one_line(tmp_path, spoil):
    path = tmp_path / "one.tar.zst"
    pack(path, files(tmp_path / "in"), CONTENT)
    path.write_bytes(spoil(path.read_bytes()))
    (tmp_path / "out").mkdir()
    line_of(unpack, path, tmp_path / "out", listed(CONTENT))


def test_the_first_file_can_be_read_alone(tmp_path):
    path = archived(tmp_path / "one.tar.zst", entry("a.txt"), entry("b.txt", bytes(1 << 20)))
    assert first_member(path, "a.txt", 100) == b"first"
    for name, most, words in (("b.txt", 100, "needs b.txt first"), ("a.txt", 4, "at most 4")):
        assert words in line_of(first_member, path, name, most)
