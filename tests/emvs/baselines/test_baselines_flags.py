"""The baselines from the command line: flags reach them, impossible values are refused."""

import pytest

from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.cli.main import main
from point_world import fronto_parallel

pytestmark = pytest.mark.usefixtures("blank_figures")

PLANES = ["--map.planes", "25", "--map.border-px", "0"]


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder, made = tmp_path_factory.mktemp("baselines") / "plane", fronto_parallel(1.3, points=2000)
    with SequenceWriter(
        folder, name="plane", rig=made.rig, trajectory=made.trajectory, config={},
        depth_range_m=(0.5, 4),
    ) as writer:  # fmt: skip
        for camera, events in enumerate(made.streams):
            writer.append_events(camera, events)
    return folder


def points(sequence, folder, method, *flags):
    command = ["map", str(sequence), "--out", str(folder), "--method", method, "--quiet"]
    assert main([*command, *PLANES, *flags]) == 0
    return read_map(folder).windows[0].depth_map(method).points


@pytest.mark.parametrize(("method", "flag", "few", "many"), [
    ("SGM/ts", "--map.sgm.active-s", "0.003", "0.03"),
    ("ESVO/own-rate", "--map.esvo.clean-up.least-fusions", "4", "0"),
    ("ESVO/own-rate", "--map.esvo.matching.least-zncc", "0.99", "0.5"),
])  # fmt: skip
def test_a_flag_reaches_its_baseline(sequence, tmp_path, method, flag, few, many):
    fewer = points(sequence, tmp_path / "few", method, flag, few)
    assert 0 < fewer < points(sequence, tmp_path / "many", method, flag, many)


@pytest.mark.parametrize(("flag", "value", "words"), [
    ("--map.sgm.matcher.block-px", "8", "must be odd"),
    ("--map.esvo.refinement.dof", "2", "greater than 2"),
    ("--map.esvo.decay-s", "nan", "finite"), ("--map.gts.memory-s", "0", "greater than 0"),
])  # fmt: skip
def test_values_that_make_no_sense_are_refused_in_a_line(
    sequence, tmp_path, capsys, flag, value, words
):
    folder = tmp_path / "map"
    command = ["map", str(sequence), "--out", str(folder), "--method", "baselines", "--quiet"]
    assert main([*command, flag, value]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert not folder.exists()


def test_every_baseline_and_every_fusion_in_one_map(sequence, tmp_path):
    command = ["map", str(sequence), "--out", str(tmp_path / "map"), "--quiet"]
    assert main([*command, *PLANES, "--method", "everything"]) == 0
    found = read_map(tmp_path / "map").windows[0].info.methods
    assert {"Alg1/H", "Focus/H", "EMVS/cam1", "Late/union", "SGM/window"} <= set(found)
    assert {"ESVO/own-rate", "ESVO/window", "GTS/events"} <= set(found)
    assert len(found) == 15
