"""`eventsweep calibrate`: a folder with a page, nothing overwritten, nothing half-written."""

import json
from unittest import mock

import pytest

from eventsweep.emvs.datasets import open_recording
from eventsweep.eval.cli.main import main
from eventsweep.plugins.diagnose import calibration
from head_world import written
from point_world import edge_points, pinhole, stereo_rig, swinging
from refusals import command_refused, untouched

pytestmark = pytest.mark.usefixtures("blank_figures")

SMALL = ["--windows", "5", "--window-s", "0.15", "--events", "3000"]


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    world = edge_points(swinging(), stereo_rig(pinhole(120, 90, 100.0), 0.1), points=500)
    return written(world, tmp_path_factory.mktemp("cli") / "world")


def test_a_folder_with_calibration_and_page_is_written_and_the_recording_kept(
    sequence, tmp_path, capsys
):
    out = tmp_path / "refined"
    asked = ["calibrate", str(sequence), "--out", str(out), *SMALL]
    with untouched(sequence):
        assert main([*asked, "--refine", "delay,focal"]) == 0
    printed = capsys.readouterr()
    assert "cam1 clock" in printed.out
    assert "note: calibration files cannot store clock" in printed.err
    named = {"rig.json", "poses.txt", "recording.toml", "refinement.json", "report.html"}
    assert named <= {path.name for path in out.iterdir()}
    assert len(open_recording(out / "recording.toml").rig) == 2
    page = (out / "report.html").read_text("utf-8")
    assert all(words in page for words in ("<svg", "as given", "Epipolar residuals"))
    again = [*asked, "--refine", "delay"]
    assert "force" in command_refused(capsys, *again)
    assert main([*again, "--force", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [estimate["parameter"] for estimate in facts["estimates"]] == ["cam1 clock"]


def test_an_interrupt_leaves_nothing(sequence, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(calibration, "write_refined", mock.Mock(side_effect=KeyboardInterrupt))
    asked = ["calibrate", str(sequence), "--refine", "delay", "--out", str(tmp_path / "refined")]
    assert main([*asked, *SMALL]) == 130
    assert not list(tmp_path.iterdir())
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize(("flags", "words"), [
    ("--refine yaw", "refine 'yaw' is unknown: choose from stereo"),
    ("--refine delay --windows 1", "at least 2 windows"),
    ("--refine delay --min-depth-m 5 --max-depth-m 2", "depth range"),
    ("--refine delay --min-depth-m 1e-9", "must lie within"),
])  # fmt: skip
def test_bad_requests_are_refused_in_one_line(sequence, tmp_path, capsys, flags, words):
    out = ["--out", tmp_path / "refined"]
    with untouched(sequence):
        assert words in command_refused(capsys, "calibrate", sequence, *out, *flags.split())
    assert not list(tmp_path.iterdir())
