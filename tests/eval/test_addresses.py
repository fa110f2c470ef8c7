"""The whole chain with all data on object storage, of a server of S3 on this machine."""

import re
import socket
import subprocess
import sys
from typing import ClassVar

import numpy as np
import pytest

from dataset_world import write_sequence
from eventsweep.emvs.maps.folder import read_map
from eventsweep.emvs.utils.address import mirror_of
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from range_server import serving
from refusals import command_refused

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("s3fs")
pytest.importorskip("moto.server")
stores = pytest.importorskip("fsspec.registry")
MemoryFileSystem = fsspec.get_filesystem_class("memory")
pytestmark = pytest.mark.usefixtures("blank_figures")
SIMULATE = ("simulate", "planes", "--seconds", "0.04", "--quiet", "--out")
MAP = ("--method", "Alg1/H", "--map.planes", "10", "--no-check", "--quiet", "--out")


@pytest.fixture(scope="module")
def server():
    """Where a server of S3 listens, a process of its own."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        yield f"http://127.0.0.1:{port}"
        process.kill()


@pytest.fixture
def lab(server, tmp_path, monkeypatch):
    """A bucket `lab` on a server, empty; returns its client."""
    import boto3

    for name, value in {
        "AWS_ENDPOINT_URL": server, "AWS_ACCESS_KEY_ID": "made", "AWS_SECRET_ACCESS_KEY": "made",
        "AWS_DEFAULT_REGION": "us-east-1", "AWS_MAX_ATTEMPTS": "20",
        "EVENTSWEEP_CACHE": str(tmp_path / "cache"),
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    client = boto3.client("s3")
    client.create_bucket(Bucket="lab")
    yield client
    for key in keys(client):
        client.delete_object(Bucket="lab", Key=key)
    client.delete_bucket(Bucket="lab")


def keys(client):
    return {each["Key"] for each in client.list_objects_v2(Bucket="lab").get("Contents", [])}


def copied(client, start, folder):
    """Copies every object below a prefix into a folder, without this program."""
    for key in filter(lambda key: key.startswith(start), keys(client)):
        place = folder / key
        place.parent.mkdir(parents=True, exist_ok=True)
        client.download_file("lab", key, str(place))


def test_simulate_map_score_and_report_with_everything_on_object_storage(lab, tmp_path, capsys):
    here = tmp_path / "here"
    assert main([*SIMULATE, "s3://lab/seq"]) == 0
    copied(lab, "seq/", here)
    for seq, out in (("s3://lab/seq", "s3://lab/map"), (f"{here}/seq", f"{here}/map")):
        assert main(["map", seq, *MAP, out]) == 0
        assert main(["score", out, "--quiet"]) == 0
        assert main(["report", out]) == 0
    capsys.readouterr()
    assert main(["info", "s3://lab/seq", "--json"]) == 0
    assert '"path": "s3://lab/seq"' in capsys.readouterr().out
    assert keys(lab) == {
        path.relative_to(here).as_posix() for path in here.rglob("*") if path.is_file()
    }
    copied(lab, "map/", tmp_path / "back")
    theirs, ours = read_map(tmp_path / "back" / "map"), read_map(here / "map")
    assert theirs.info == ours.info
    depths = [one.windows[0].depth_map("Alg1/H").depth_m for one in (theirs, ours)]
    np.testing.assert_array_equal(*depths)
    scores = [read_results(one.path).rows for one in (theirs, ours)]
    assert scores[0].equals(scores[1])


def test_a_map_here_of_a_sequence_there_says_where_it_is(lab, tmp_path):
    write_sequence(tmp_path / "seq", "pinhole")
    for path in (tmp_path / "seq").rglob("*.*"):
        lab.upload_file(str(path), "lab", path.relative_to(tmp_path).as_posix())
    assert main(["map", "s3://lab/seq", *MAP, str(tmp_path / "map")]) == 0
    assert '"path": "s3://lab/seq"' in (tmp_path / "map" / "map.json").read_text()
    assert main(["score", str(tmp_path / "map"), "--quiet"]) == 0
    assert not re.search("cache.remote", (tmp_path / "map" / "report.html").read_text())


def test_with_force_an_output_on_object_storage_is_replaced_as_one_here(lab, tmp_path, capsys):
    here, there = f"{tmp_path}/here/seq", "s3://lab/seq"
    for out in (here, there):
        assert main([*SIMULATE, out]) == 0
    line = command_refused(capsys, *SIMULATE, there)
    assert "s3://lab/seq exists: choose another output, or add --force to replace it" in line
    longer = ("simulate", "planes", "--seconds", "0.06", "--force", "--out")
    for out in (here, there):
        assert main([*longer, out]) == 0
    said = capsys.readouterr().out
    assert "next" not in said
    assert said.count("events in 0.06 s, s3://lab/seq") == 1
    copied(lab, "seq/", tmp_path / "back")
    assert folder_bytes(tmp_path / "back") == folder_bytes(tmp_path / "here")
    assert {key.partition("/")[0] for key in keys(lab)} == {"seq"}


RUN = (
    "run", "planes", "--seconds", "0.04", "--method", "Alg1/H", "--map.planes", "10", "--workers",
    "2", "--quiet", "--out",
)  # fmt: skip


def test_a_run_on_object_storage_is_the_run_here(lab, tmp_path, capsys):
    here, mirror = tmp_path / "here", mirror_of("s3://lab/run")
    (mirror / "left").mkdir(parents=True)  # by a run that was killed before it sent anything
    for name in ("left/map.json", "report.html", "left.html"):
        (mirror / name).write_text("old")
    assert main([*RUN, "s3://lab/run"]) == 0
    assert main([*RUN, str(here / "run")]) == 0
    assert keys(lab) == {f"run/{name}" for name in folder_bytes(here / "run")}
    copied(lab, "run/", tmp_path / "back")
    assert folder_bytes(tmp_path / "back") == folder_bytes(here)
    line = command_refused(capsys, *RUN, "s3://lab/run")
    assert "s3://lab/run exists: choose another output, or add --force" in line
    assert main([*RUN, "s3://lab/run", "--force", "--seed", "1"]) == 0
    assert {key.partition("/")[0] for key in keys(lab)} == {"run"}


def folder_bytes(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_with_force_what_is_not_ours_or_is_read_stays_and_the_line_says_so(lab, capsys):
    assert main([*SIMULATE, "s3://lab/seq"]) == 0
    lab.put_object(Bucket="lab", Key="seq/thesis.tex", Body=b"mine")
    before = keys(lab)
    line = command_refused(capsys, *SIMULATE, "s3://lab/seq", "--force")
    assert "s3://lab/seq holds thesis.tex, which eventsweep did not write" in line
    line = command_refused(capsys, "map", "s3://lab/seq", *MAP, "s3://lab/seq", "--force")
    assert "is, holds or is part of the input s3://lab/seq" in line
    assert keys(lab) == before


class Elsewhere(MemoryFileSystem):
    """A store of another kind, in memory, as its library is asked."""

    store: ClassVar = {}
    pseudo_dirs: ClassVar = [""]

    @classmethod
    def _strip_protocol(cls, path):
        return MemoryFileSystem._strip_protocol(str(path).partition("://")[2] or path)


@pytest.mark.parametrize("scheme", ["gs", "gcs", "az", "abfs"])
def test_any_store_of_fsspec_takes_sequences_and_maps_once_its_library_is_there(
    scheme, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    seq, out = f"{scheme}://lab/a/seq", f"{scheme}://lab/a/map"
    line = command_refused(capsys, *SIMULATE, seq)
    library = {"g": "gcsfs", "a": "adlfs"}[scheme[0]]
    assert re.search(rf"{seq}: needs libraries \(.*{library}.* and fsspec's library for", line)
    kind = type(scheme, (Elsewhere,), {"protocol": scheme, "store": {}, "pseudo_dirs": [""]})
    monkeypatch.setitem(stores._registry, scheme, kind)
    assert main([*SIMULATE, seq]) == 0
    for force in ([], ["--force"]):
        assert main(["map", seq, *MAP, out, *force]) == 0
    assert main(["score", out, "--quiet"]) == 0
    assert any(name.endswith("/a/map/results.json") for name in kind.store)
    capsys.readouterr()
    assert main(["info", seq, "--json"]) == 0
    assert f'"path": "{seq}"' in capsys.readouterr().out


def test_a_web_server_takes_no_output(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    (tmp_path / "www").mkdir()
    with serving(tmp_path / "www") as server:
        for force in ([], ["--force"]):
            line = command_refused(capsys, *SIMULATE, f"{server.address}/seq", *force)
            assert "is only read from; choose an output at s3:// or in a folder" in line


@pytest.mark.parametrize(("words", "line"), [
    (["map", "s3://lab/none", "--out", "x"], "s3://lab/none: nothing is there"),
    ([*SIMULATE, "s3://lost/seq"], "s3://lost/seq: cannot be written|nothing is there"),
    (["fuse", "s3://lab/map"], "s3://lab/map: `fuse` takes no addresses: copy it"),
    (["study", "planes", "--out", "s3://lab/s"], "`study` takes no addresses: choose a folder"),
    (["map", "x", "--out", "y", "--config", "s3://lab/c.toml"],
     "s3://lab/c.toml: `map` takes addresses only for recording and out"),
])  # fmt: skip
def test_what_is_not_there_or_not_supported_is_one_line(
    lab, tmp_path, monkeypatch, capsys, words, line
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert re.search(line, command_refused(capsys, *words))
    assert keys(lab) == set()
