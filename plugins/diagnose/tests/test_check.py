"""`eventsweep check` and what `map` says of itself: exit codes, outputs, one line per doubt."""

import json
import shutil

import pytest

from dataset_world import rewritten, write_sequence
from eventsweep.eval.cli.main import main
from refusals import command_refused

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("check") / "seq", "pinhole", steps=600)


@pytest.fixture
def in_mm(sequence, tmp_path):
    """The same recording as files, with positions in millimetres."""
    folder = rewritten(sequence, tmp_path / "mm", "npz")
    poses = folder / "poses.txt"
    lines = [line.split() for line in poses.read_text().splitlines() if line[0] != "#"]
    rows = [[w[0], *(repr(float(v) * 1000) for v in w[1:4]), *w[4:]] for w in lines]
    poses.write_text("".join(" ".join(row) + "\n" for row in rows))
    return folder


def test_a_good_recording_ends_with_0(sequence, capsys):
    assert main(["check", str(sequence), "--no-mapping"]) == 0
    out, err = capsys.readouterr()
    assert "poses-speed" in out
    assert " ".join(out.split()).count("wrong") == 1
    assert "not checked: mapping, because" in out
    assert "check" in err


def test_a_wrong_one_ends_with_1_and_says_what_is_odd_and_json_is_all_of_it(
    in_mm, tmp_path, capsys
):
    flags = [str(in_mm), "--out", str(tmp_path / "out"), "--quiet", "--no-mapping"]
    assert main(["check", *flags]) == 1
    assert capsys.readouterr().out == ""
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        ".eventsweep.json", "check.json", "report.html",
    ]  # fmt: skip
    report = json.loads((tmp_path / "out/check.json").read_text())
    assert report["suspects"] == ["impossible motion"]
    assert not any(finding["cure"] for finding in report["findings"])
    assert main(["check", *flags]) == 2
    assert main(["check", *flags, "--force"]) == 1
    assert main(["check", str(in_mm), "--json", "--no-mapping"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "wrong"
    assert {"name", "verdict", "value", "unit", "evidence", "cure"} <= report["findings"][0].keys()


def test_what_the_reader_refuses_is_a_finding(in_mm, capsys):
    poses = in_mm / "poses.txt"
    lines = poses.read_text().splitlines(keepends=True)
    poses.write_text("".join(lines[::-1]))
    assert main(["check", str(in_mm)]) == 1
    assert "sort the poses" in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.parametrize("arguments", [["nowhere"], ["nowhere", "--force"]])
def test_nothing_there_is_bad_input(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command_refused(capsys, "check", *arguments)
    assert list(tmp_path.iterdir()) == []


def _mapped(recording, out, capsys, *flags):
    shutil.rmtree(out, ignore_errors=True)
    code = main(["map", str(recording), "--out", str(out), "--map.planes", "10", "--method",
                 "EMVS/cam0", "--quiet", *flags])  # fmt: skip
    assert code == 0
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("check: ")]


def test_map_warns_in_one_line_each_and_maps_all_the_same(in_mm, sequence, tmp_path, capsys):
    lines = _mapped(in_mm, tmp_path / "out", capsys)
    assert any("poses-speed wrong: impossible motion" in line for line in lines)
    assert _mapped(in_mm, tmp_path / "out", capsys, "--no-check") == []
    assert _mapped(sequence, tmp_path / "out", capsys) == []
