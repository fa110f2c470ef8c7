"""Flags only where they mean something: what a verb would ignore it does not take, or refuses."""

import pytest

from programs import COMMANDS, command
from refusals import command_refused

REPLACE = {
    "archive make", "archive unpack", "calibrate", "check", "run", "score", "simulate", "map",
    "convert", "events", "fit", "realism", "submission enter", "submission make", "suite", "gate",
    "info", "track", "compare", "paper", "align", "submission score",
}  # fmt: skip
NO_FACTS = {"archive unpack", "convert", "report", "completion"}


def takes(verb, flag):
    return any(flag in one.names for one in command(verb).assemble_argument_collection())


def test_force_json_and_quiet_are_taken_by_those_that_heed_them():
    assert {verb for verb in COMMANDS if takes(verb, "--force")} == REPLACE & set(COMMANDS)
    assert {verb for verb in COMMANDS if not takes(verb, "--json")} == NO_FACTS & set(COMMANDS)
    assert {verb for verb in COMMANDS if not takes(verb, "--quiet")} == {"list"}


IGNORED = [
    ("map x --out o --allow-skipped", "--allow-skipped without"),
    ("run planes --out o --allow-skipped", "without sliding"),
    ("info x --force", "--force without --picture"), ("fuse x --mesh-part 5", "without --mesh"),
    ("suite mvsec-table-v1 --out o --remote", "without --scheduler"),
    ("study planes --out o --tls-key k", "without --scheduler"),
    ("suite mvsec-table-v1 --out o --scheduler tcp://127.0.0.1:1 --workers 2",
     "--workers with --scheduler"),
    ("gate --baseline b --result r --workers 2", "--result runs nothing"),
    ("gate --baseline b --result r --suite quick", "--result runs nothing"),
    ("convert x o --to npz --shift-us 5 --from-zero", "--shift-us and --from-zero"),
    ("convert x o --to npz --unit ms", "--unit"),
    ("convert x o --to depth-png --shift-us 5", "--shift-us"),
    ("convert x o --to kalibr --stream cam0", "--stream"),
    ("convert x o --to tum --width-px 5", "--width-px"),
    ("convert x o --to npz --baseline-m 0.1", "--baseline-m"),
    ("run planes --out o --sim.frames.gain 2",
     "--sim.frames.gain 2.0 has no effect without --sim.frames.rate-hz"),
    ("run hdr-window planes --out o --sim.frames.bits 6", "without --sim.frames.rate-hz"),
    ("simulate planes --out o --sim.imu.rate-hz 0 --sim.imu.gyro-walk 0",
     "--sim.imu.gyro-walk 0.0 has no effect without --sim.imu.rate-hz"),
    ("simulate planes --out o --sim.replay.scale 2",
     "--sim.replay.scale 2.0 has no effect without --sim.replay.trajectory"),
    ("list cars", "scenes"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "told"), IGNORED)
def test_a_flag_that_would_be_ignored_is_refused(tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    assert told in command_refused(capsys, *words.split())
    assert not (tmp_path / "o").exists()
