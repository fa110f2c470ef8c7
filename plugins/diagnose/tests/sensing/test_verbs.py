"""`eventsweep fit` and `realism`: what they write, and what they refuse."""

import json
import tomllib

import numpy as np
import pytest

from dataset_world import write_sequence
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.formats import write_events
from eventsweep.eval.cli.main import main
from eventsweep.sim.config import SimConfig
from refusals import command_refused


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("fit") / "seq", "pinhole", steps=600)


def test_fit_writes_a_preset_that_a_simulation_takes(sequence, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["fit", str(sequence), "--out", str(out), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    names = {estimate["name"] for estimate in facts["estimates"]}
    assert {"contrast_threshold_pos", "refractory_period_us", "shot_rate_hz"} <= names
    assert sorted(p.name for p in out.iterdir()) == [
        ".eventsweep.json", "fit.json", "report.html", "sensor.toml",
    ]  # fmt: skip
    values = tomllib.loads((out / "sensor.toml").read_text())
    config = SimConfig(sensor={"preset": out / "sensor.toml"})
    for name, value in values["sensor"].items():
        assert getattr(config.sensor.resolved(), name) == value
    assert "refused" in (out / "report.html").read_text()
    assert main(["fit", str(sequence), "--out", str(out)]) == 2


def test_fit_names_its_files_and_each_reason_once(sequence, tmp_path, capsys):
    file = tmp_path / "e.npz"
    write_events(file, "npz", 96, 64, {"events": [Sequence.open(sequence).events(0, 0, 1 << 40)]})
    assert main(["fit", str(file), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    assert (shown.out + shown.err).count("needs frames: three or more") == 1
    assert f"wrote {tmp_path / 'out' / 'sensor.toml'}" in shown.out + shown.err


@pytest.mark.parametrize(("words", "line"), [
    ("fit {} --camera 7", "no camera 7, it has 0 to 1"),
    ("fit {} --start-s 1e9", "from 1e+09 s of a recording"),
    ("fit {} --duration-s -1", "from 0 s for -1 s of a recording"),
    ("fit nowhere", "no such file or folder; needs a recording or an event file"),
    ("realism {} {}", "take a longer recording"),
])  # fmt: skip
def test_a_part_that_is_not_there_is_refused_in_one_line(sequence, tmp_path, capsys, words, line):
    out = tmp_path / "out"
    words = [word.format(sequence) for word in words.split()]
    assert line in command_refused(capsys, *words, "--out", out, "--quiet")
    assert not out.exists()


def test_an_event_file_says_what_events_alone_can(sequence, tmp_path, capsys):
    """Of any format, by stated columns, too: the same as the recording without its frames."""
    file, table = tmp_path / "e.npz", tmp_path / "e.npy"
    events = Sequence.open(sequence).events(0, 0, 1 << 40)
    write_events(file, "npz", 96, 64, {"events": [events]})
    np.save(table, np.stack([events.x, events.y, events.p, events.t_us], 1).astype(np.int64))
    columns = ("--columns", "x=0,y=1,p=2,t=3", "--time-unit", "us")
    facts, out = [], str(tmp_path / "o")
    for path, words in ((file, ()), (table, columns)):
        assert main(["fit", str(path), "--out", out, "--json", "--force", *words]) == 0
        facts.append(json.loads(capsys.readouterr().out))
        by_name = {each["name"]: each for each in facts[-1]["estimates"]}
        assert "needs frames" in by_name["contrast_threshold_pos"]["refused"]
    assert facts[0] == facts[1]
    said = command_refused(capsys, "fit", file, "--out", tmp_path / "p", "--camera", "1", "--quiet")
    assert "no camera 1, it has 0 to 0" in said
