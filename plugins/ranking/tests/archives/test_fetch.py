"""Fetching: from a folder or a server, resumed, verified; what is wrong is one line."""

import hashlib
import http.server
import json
import os
import socket
import threading
import time
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from eventsweep.emvs.utils.files import MARK
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.emvs.utils.outputs import claimed
from eventsweep.eval.progress import Silent
from eventsweep.plugins.ranking.archives import fetch as fetching
from eventsweep.plugins.ranking.archives.fetch import fetch, verify
from eventsweep.plugins.ranking.archives.manifest import (
    ArchiveManifest,
    PackedFile,
    PackedSequence,
    parse,
    read,
    write,
)
from refusals import line_of

CONTENT = {
    f"{case}-seed{seed}.tar.zst": bytes([seed]) * 5000 + case.encode()
    for case in ("desk", "wall")
    for seed in (0, 1)
}


def sequence(file, data, **changed):
    case, seed = file.removesuffix(".tar.zst").split("-seed")
    facts = {
        "case": case, "seed": int(seed), "file": file, "sha256": hashlib.sha256(data).hexdigest(),
        "bytes": len(data), "sequence": hashlib.sha256(file.encode()).hexdigest(), "scene": "s",
        "drawn_from": {}, "files": {"manifest.json": PackedFile(sha256="0" * 64, bytes=1)},
    }  # fmt: skip
    return PackedSequence(**{**facts, **changed})


@pytest.fixture
def published(tmp_path):
    """A folder as its maker publishes it; the content of its files is of no interest here."""
    folder = tmp_path / "published"
    folder.mkdir()
    for file, data in CONTENT.items():
        (folder / file).write_bytes(data)
    packed = tuple(sequence(file, data) for file, data in CONTENT.items())
    write(folder, ArchiveManifest(
        suite="tiny", digest="d", sequences=packed, subsets={"quick": (("desk",), (0, 1))},
    ))  # fmt: skip
    return folder


@contextmanager
def server(folder, *, ranges=True, breaks_after=None, lies=False):
    """A server on this machine; may send only a part of each answer, or know no ranges."""
    asked = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            path = folder / self.path.rpartition("/")[2]
            start = self.headers.get("Range")
            asked.append((path.name, start))
            if not path.is_file():
                self.send_error(404)
                return
            data = path.read_bytes()
            first = int(start.removeprefix("bytes=").rstrip("-")) if start and ranges else 0
            self.send_response(206 if first else 200)
            if first:
                self.send_header("Content-Range", f"bytes {first}-{len(data) - 1}/{len(data)}")
            rest = data[first:]
            if lies and path.suffix == ".zst":
                rest = rest + b"more" * 100_000
            self.send_header("Content-Length", str(len(rest)))
            self.end_headers()
            cut = path.suffix == ".zst" and breaks_after is not None
            self.wfile.write(rest[:breaks_after] if cut else rest)

        def log_message(self, *_):
            pass

    found = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=found.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{found.server_port}/data", asked
    finally:
        found.shutdown()
        found.server_close()


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(fetching, "_WAIT_S", 0.0)


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix == ".zst"}


def test_from_a_folder_and_from_a_server_the_same_comes(published, tmp_path):
    fetch(str(published), tmp_path / "a", Silent())
    with server(published) as (address, _):
        manifest, wanted = fetch(address, tmp_path / "b", Silent())
    assert files(tmp_path / "a") == files(tmp_path / "b") == CONTENT
    assert read(tmp_path / "a") == read(tmp_path / "b") == manifest
    assert len(wanted) == 4
    assert [one.file for one in verify(tmp_path / "b")[1]] == list(CONTENT)


def test_a_part_is_the_same_archive_and_the_rest_can_follow(published, tmp_path):
    with server(published) as (address, asked):
        fetch(address, tmp_path / "a", Silent(), subset="quick", seeds=[1])
        assert set(files(tmp_path / "a")) == {"desk-seed1.tar.zst"}
        fetch(address, tmp_path / "a", Silent(), cases=["desk", "wall"])
    assert files(tmp_path / "a") == CONTENT
    assert [name for name, _ in asked].count("desk-seed1.tar.zst") == 1
    assert read(tmp_path / "a").version == read(published).version


def test_a_broken_connection_is_taken_up_where_it_broke(published, tmp_path):
    with server(published, breaks_after=2000) as (address, asked):
        fetch(address, tmp_path / "a", Silent(), cases=["desk"], seeds=[0])
    starts = [start for name, start in asked if name == "desk-seed0.tar.zst"]
    assert starts == [None, "bytes=2000-", "bytes=4000-"]
    assert files(tmp_path / "a")["desk-seed0.tar.zst"] == CONTENT["desk-seed0.tar.zst"]


def partial_of(folder, content):
    """What a killed process left of a file."""
    work = folder / ".desk-seed0.tar.zst.unfinished"
    work.mkdir()
    (work / MARK).touch()
    (work / "desk-seed0.tar.zst").write_bytes(content)
    return work / "desk-seed0.tar.zst"


DESK = "desk-seed0.tar.zst"


@pytest.mark.parametrize(("part", "linked", "ranges", "asked_for"), [
    (CONTENT[DESK][:3000], False, True, "bytes=3000-"), (CONTENT[DESK][:3000], True, True, None),
    (b"x" * 3000, False, False, None),  # all of it is sent again
], ids=["taken up", "linked by somebody", "no ranges"])  # fmt: skip
def test_what_an_earlier_process_left_is_taken_up_if_it_can_be(
    published, tmp_path, part, linked, ranges, asked_for
):
    (tmp_path / "a").mkdir()
    left = partial_of(tmp_path / "a", part)
    if linked:
        os.link(left, tmp_path / "mine")
    with server(published, ranges=ranges) as (address, asked):
        fetch(address, tmp_path / "a", Silent(), cases=["desk"], seeds=[0])
    assert not ranges or (DESK, asked_for) in asked
    assert files(tmp_path / "a")[DESK] == CONTENT[DESK]
    assert linked or not left.parent.exists()
    assert not linked or (tmp_path / "mine").read_bytes() == part


PLANTED = {
    "file": lambda path: path.write_text("mine"), "pipe": os.mkfifo,
    "link": lambda path: path.symlink_to("nowhere"), "folder": Path.mkdir,
}  # fmt: skip


@pytest.mark.parametrize("kind", PLANTED)
@pytest.mark.parametrize("name", ["desk-seed0.tar.zst", "archive.json"])
def test_somebodys_file_in_the_place_of_the_archives_is_refused(published, tmp_path, kind, name):
    out = tmp_path / "a"
    out.mkdir()
    (out / "desk-seed0.tar.zst.partial").write_text("mine")
    PLANTED[kind](out / name)
    text = one_line(str(published), out)
    assert name in text
    assert {path.name for path in out.iterdir()} <= {name, "desk-seed0.tar.zst.partial", *CONTENT}
    assert (out / "desk-seed0.tar.zst.partial").read_text() == "mine"
    if kind == "file":
        assert (out / name).read_text() == "mine"


def test_two_at_once_into_one_folder(published, tmp_path):
    with server(published) as (address, _), claimed(tmp_path / "a"):
        assert "another process" in one_line(address, tmp_path / "a")


def one_line(place, out, **more):
    return line_of(fetch, str(place), out, Silent(), **more)


def test_a_connection_that_breaks_for_ever_is_one_line_and_keeps_what_came(published, tmp_path):
    with server(published, breaks_after=100) as (address, _):
        text = one_line(address, tmp_path / "a", cases=["desk"])
    assert "cannot be fetched" in text
    (left,) = (tmp_path / "a").glob(".desk-seed0.tar.zst.unfinished/desk-seed0.tar.zst")
    assert left.stat().st_size == 400
    assert not files(tmp_path / "a")


def test_a_damaged_file_is_not_kept(published, tmp_path):
    (published / "desk-seed0.tar.zst").write_bytes(b"y" * 5004)
    with server(published) as (address, _):
        assert "SHA-256" in one_line(address, tmp_path / "a")
    assert not list((tmp_path / "a").glob("desk-seed0*"))


def test_no_more_is_read_than_the_manifest_says(published, tmp_path):
    with server(published, lies=True) as (address, _):
        assert "sends 405004 bytes of" in one_line(address, tmp_path / "a")
    assert not (tmp_path / "a").exists()


@contextmanager
def answering(*answers):
    """A server that sends what it is given, an answer to each connection, the last to all others.

    Args:
        answers: bytes, or lists of bytes with pauses between them.
    """
    left = list(answers)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            with suppress(OSError):
                while True:
                    connection, _ = listening.accept()
                    answer = left.pop(0) if len(left) > 1 else left[0]
                    threading.Thread(target=send, args=(connection, answer), daemon=True).start()

        def send(connection, answer):
            with connection, suppress(OSError):
                connection.recv(65536)
                for part in [answer] if isinstance(answer, bytes) else answer:
                    connection.sendall(part)
                    time.sleep(0 if part is answer else 0.02)

        serving = threading.Thread(target=serve, daemon=True)
        serving.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/data"
        # A thread that still accepts would take what comes to the next socket of the same number.
        listening.shutdown(socket.SHUT_RDWR)
        serving.join()


def ok(content, *more):
    return b"\r\n".join([b"HTTP/1.1 200 OK", *more, b"", content])


def test_what_a_server_says_cannot_reach_the_terminal(tmp_path):
    with answering(b"HTTP/1.1 404 \x1b]0;owned\x07\x9b2J gone\r\n\r\n") as address:
        assert "HTTP 404" in one_line(address, tmp_path / "a")


SLOW = {
    "a status": [b"H", *[b"T"] * 1000],
    "headers": [b"HTTP/1.1 200 OK\r\n", *[b"X: y\r\n"] * 1000],
    "content": [ok(b"", b"Content-Length: 9000"), *[b"{"] * 1000],
    "chunks": [ok(b"", b"Transfer-Encoding: chunked"), *[b"1\r\n{\r\n"] * 1000],
}


@pytest.mark.parametrize("kind", SLOW)
def test_a_server_of_a_few_bytes_a_second_is_not_followed(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(fetching, "TIMEOUT_S", 0.2)
    began_s = time.monotonic()
    with answering(SLOW[kind]) as address:
        text = one_line(address, tmp_path / "a")
    assert "bytes/s came for" in text
    assert time.monotonic() - began_s < 5


PAGE = b"<html>come back later</html>"
PAGES = {
    "a page": ok(PAGE, b"Content-Type: text/html"),
    "a page of some length": ok(PAGE, b"Content-Length: %d" % len(PAGE)),
    "an error": b"HTTP/1.1 503 Busy\r\nContent-Length: 4\r\n\r\nbusy",
    "nothing known": ok(PAGE),
}


@pytest.mark.parametrize("kind", PAGES)
def test_a_page_in_the_place_of_a_file_leaves_the_next_fetch_whole(published, tmp_path, kind):
    out, index = tmp_path / "a", (published / "archive.json").read_bytes()
    out.mkdir()
    left = partial_of(out, CONTENT["desk-seed0.tar.zst"][:3000])
    with answering(ok(index), PAGES[kind]) as address:
        one_line(address, out, cases=["desk"], seeds=[0])
    if kind != "nothing known":
        assert left.read_bytes() == CONTENT["desk-seed0.tar.zst"][:3000]
    with server(published) as (address, asked):
        fetch(address, out, Silent(), cases=["desk"], seeds=[0])
    assert (("desk-seed0.tar.zst", "bytes=3000-") in asked) == (kind != "nothing known")
    assert files(out)["desk-seed0.tar.zst"] == CONTENT["desk-seed0.tar.zst"]
    assert not left.parent.exists()


def moved(place):
    return b"HTTP/1.1 302 Found\r\nLocation: " + place.encode() + b"\r\nContent-Length: 0\r\n\r\n"


@pytest.mark.parametrize("place", ["ftp://127.0.0.1/x", "file:///etc/passwd", "data:,x"])
def test_redirections_to_other_protocols_are_not_followed(tmp_path, place):
    with answering(moved(place)) as address:
        text = one_line(address, tmp_path / "a")
    assert "only http and https" in text or "not allowed" in text


def test_redirections_are_followed_but_never_out_of_encryption(published, tmp_path):
    with server(published) as (there, _), answering(moved(f"{there}/archive.json")) as address:
        assert "archive" in one_line(address, tmp_path / "a")  # all files lead to that one
    request = urllib.request.Request("https://a.example/archive.json")
    follow = fetching._Redirects().redirect_request
    said = line_of(follow, request, None, 302, "", {}, "http://a.example/b")
    assert "only https is followed" in said


def test_a_changed_file_is_found_and_fetched_again(published, tmp_path):
    out, name = tmp_path / "a", "wall-seed1.tar.zst"
    fetch(str(published), out, Silent())
    (out / name).write_bytes(b"z" * 5004)
    assert f"{name}: was changed" in line_of(verify, out)
    assert f"{name}: is not" in one_line(published, out)
    (out / name).unlink()
    fetch(str(published), out, Silent())
    assert (len(verify(out)[1]), strangers(out)) == (4, [])


def test_another_archive_is_not_mixed_in(published, tmp_path):
    fetch(str(published), tmp_path / "a", Silent())
    other = read(published)
    first = other.sequences[0].model_copy(update={"sequence": "1" * 64})
    write(published, other.model_copy(update={"sequences": (first, *other.sequences[1:])}))
    assert "choose another folder" in one_line(str(published), tmp_path / "a")
    assert "but 0123 was requested" in one_line(str(published), tmp_path / "b", version="0123")


@pytest.mark.parametrize(("place", "words"), [
    ("nowhere", "neither a folder nor an address"),
    ("ftp://example.org/data", "neither a folder nor an address"),
    ("file:///etc", "neither a folder nor an address"),
    ("http://127.0.0.1:9/data", "cannot be fetched"),
])  # fmt: skip
def test_a_place_that_is_none_is_one_line(tmp_path, place, words):
    assert words in one_line(place, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_what_is_not_there_is_one_line(published, tmp_path):
    with server(published) as (address, _):
        (published / "desk-seed0.tar.zst").unlink()
        assert "HTTP 404" in one_line(address, tmp_path / "a")
    for asked, words in (
        ({"subset": "slow"}, "no part 'slow'"), ({"cases": ["hall"]}, "no case 'hall'"),
        ({"seeds": [9]}, "none of the requested"),
    ):  # fmt: skip
        assert words in one_line(published, tmp_path / "a", **asked)
    assert "no archive.json" in line_of(read, tmp_path)


HOSTILE = {
    "a file elsewhere": {"file": "../desk.tar.zst"}, "an absolute file": {"file": "/etc/passwd"},
    "a hidden file": {"file": ".bashrc"}, "a case elsewhere": {"case": "../desk"},
    "names elsewhere": {"files": {"../x": {"sha256": "0" * 64, "bytes": 1}}},
    "names in a hidden folder": {"files": {"a/.ssh/x": {"sha256": "0" * 64, "bytes": 1}}},
    "a negative size": {"bytes": -1}, "no hash": {"sha256": ""}, "an unknown key": {"mode": 0o777},
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_manifest_is_one_line(published, tmp_path, kind):
    content = json.loads((published / "archive.json").read_text())
    content["sequences"][0].update(HOSTILE[kind])
    (published / "archive.json").write_text(json.dumps(content))
    assert "not an archive's manifest" in one_line(str(published), tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_a_manifest_lists_each_once():
    one = sequence("desk-seed0.tar.zst", b"")
    text = ArchiveManifest(suite="t", digest="d", sequences=(one,)).model_dump(mode="json")
    twice = {**text, "sequences": text["sequences"] * 2}
    newer = text | {"schema_version": 9}
    for content, words in ((twice, "listed twice"), (newer, "schema version 9")):
        assert words in line_of(parse, json.dumps(content), "here")
