"""Flags only where they mean something: what a verb would ignore it does not take, or refuses."""

import pytest

from eventsweep.eval.cli.main import main
from program import COMMANDS, command

REPLACE = {
    "archive make",
    "archive unpack",
    "calibrate",
    "check",
    "run",
    "score",
    "simulate",
    "map",
    "convert",
    "events",
    "fit",
    "realism",
    "submission enter",
    "submission make",
    "suite",
    "gate",
    "info",
    "track",
}
NO_FACTS = {"archive unpack", "convert", "report", "completion"}


def takes(verb, flag):
    return any(flag in one.names for one in command(verb).assemble_argument_collection())


def test_force_json_and_quiet_are_taken_by_those_that_heed_them():
    assert {verb for verb in COMMANDS if takes(verb, "--force")} == REPLACE
    assert {verb for verb in COMMANDS if not takes(verb, "--json")} == NO_FACTS
    assert {verb for verb in COMMANDS if not takes(verb, "--quiet")} == {"list"}


IGNORED = {
    "one window": (["map", "x", "--out", "o", "--allow-skipped"], "--allow-skipped without"),
    "one window in a run": (["run", "planes", "--out", "o", "--allow-skipped"], "without sliding"),
    "no picture": (["info", "x", "--force"], "--force without --picture"),
    "no mesh": (["fuse", "x", "--mesh-part", "5"], "without --mesh"),
    "no cluster": (["suite", "quick", "--out", "o", "--remote"], "without --scheduler"),
    "no cluster's key": (
        ["study", "planes", "--out", "o", "--tls-key", "k"],
        "without --scheduler",
    ),
    "a cluster": (
        ["suite", "quick", "--out", "o", "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"],
        "--workers with --scheduler",
    ),
    "nothing run": (
        ["gate", "--baseline", "b", "--result", "r", "--workers", "2"],
        "--result runs nothing",
    ),
    "nothing run of a suite": (
        ["gate", "--baseline", "b", "--result", "r", "--suite", "quick"],
        "--result runs nothing",
    ),
    "two shifts": (
        ["convert", "x", "o", "--to", "npz", "--shift-us", "5", "--from-zero"],
        "--shift-us and --from-zero",
    ),
    "a unit of events": (["convert", "x", "o", "--to", "npz", "--unit", "ms"], "--unit"),
    "a shift of a depth map": (
        ["convert", "x", "o", "--to", "depth-png", "--shift-us", "5"],
        "--shift-us",
    ),
    "a stream of a rig": (["convert", "x", "o", "--to", "kalibr", "--stream", "cam0"], "--stream"),
    "a size of poses": (["convert", "x", "o", "--to", "tum", "--width-px", "5"], "--width-px"),
    "a baseline of events": (
        ["convert", "x", "o", "--to", "npz", "--baseline-m", "0.1"],
        "--baseline-m",
    ),
    "no pictures": (
        ["run", "planes", "--out", "o", "--sim.frames.gain", "2"],
        "--sim.frames.gain 2.0 has no effect without --sim.frames.rate-hz",
    ),
    "no pictures in one of two scenes": (
        ["run", "hdr-window", "planes", "--out", "o", "--sim.frames.bits", "6"],
        "without --sim.frames.rate-hz",
    ),
    "no inertial samples": (
        ["simulate", "planes", "--out", "o", "--sim.imu.rate-hz", "0", "--sim.imu.gyro-walk", "0"],
        "--sim.imu.gyro-walk 0.0 has no effect without --sim.imu.rate-hz",
    ),
    "no recorded motion": (
        ["simulate", "planes", "--out", "o", "--sim.replay.scale", "2"],
        "--sim.replay.scale 2.0 has no effect without --sim.replay.trajectory",
    ),
    "nothing to list": (["list", "cars"], "scenes"),
}


@pytest.mark.parametrize("case", IGNORED)
def test_a_flag_that_would_be_ignored_is_refused(tmp_path, monkeypatch, capsys, case):
    words, told = IGNORED[case]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    assert main(words) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert not (tmp_path / "o").exists()
