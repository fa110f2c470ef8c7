"""`eventsweep track`: a folder with poses, facts, cloud and page; nothing overwritten."""

import json
import signal
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

import line_world
from eventsweep.emvs.data.poses import read_poses, write_tum
from eventsweep.eval.cli.main import main
from eventsweep.eval.progress import SILENT
from eventsweep.plugins.track import (
    folder as odometry,
)  # before what it opens recordings by is patched
from places import HELPER_FOLDERS
from programs import python
from refusals import command_refused


@pytest.fixture(scope="module")
def recording():
    return line_world.swaying(450_000)


def test_the_folder_holds_poses_facts_cloud_and_page(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("eventsweep.emvs.datasets.open_recording", lambda _path: recording)
    start = recording.trajectory.times(np.eye(4))
    write_tum(tmp_path / "start.txt", start)
    out = tmp_path / "out"
    command = ["track", str(tmp_path / "recording"), "--out", str(out), "--planes", "40"]
    command += ["--map-s", "0.2", "--map-rate-hz", "8"]
    monkeypatch.setattr("sys.argv", ["eventsweep", "track", "recording", "--out", "out"])
    assert main([*command, "--start", str(tmp_path / "start.txt"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    poses = read_poses(out / "trajectory.txt")
    assert len(poses) == facts["poses"] > 15
    np.testing.assert_allclose(poses.at(poses.t_us[0]), start.at(start.t_us[0]), atol=1e-9)
    stored = json.loads((out / "track.json").read_text())
    assert (stored["changes"], stored["config"]["planes"]) == (facts["changes"], 40)
    assert [change["status"] for change in stored["changes"]] == ["starting", "tracking"]
    rows = np.loadtxt(out / "covariances.txt")
    np.testing.assert_allclose(rows[:, 0], poses.t_us / 1e6)
    covariances = np.zeros((len(rows), 6, 6))
    covariances[:, *np.triu_indices(6)] = rows[:, 1:]
    covariances += np.triu(covariances, 1).swapaxes(1, 2)
    assert (np.linalg.eigvalsh(covariances) > 0).all()
    assert (out / "cloud.ply").read_bytes().startswith(b"ply")
    page = (out / "report.html").read_text()
    assert "from above" in page or "path and map" in page
    assert "eventsweep track recording --out out" in page
    assert "exists" in command_refused(capsys, *command)


class View:
    """Remembers what it is shown."""

    def __init__(self):
        self.bodies, self.spans, self.maps = [], [], []

    def body(self, _case, _recording, t_us, T_world_body):
        self.bodies.append((t_us, T_world_body))

    def events(self, _case, _recording, t0_us, t1_us):
        self.spans.append((t0_us, t1_us))

    def window(self, _case, result):
        self.maps.append(result)


def test_a_view_is_shown_poses_the_events_between_them_and_maps(recording, tmp_path):
    view = View()
    tracked = odometry.track_recording(
        recording, tmp_path / "recording", tmp_path / "out", line_world.CONFIG, SILENT, view=view
    ).tracked
    assert len(view.maps) == tracked.maps > 0
    assert all(result.slices.values for result in view.maps)
    times_us = [t_us for t_us, _ in view.bodies]
    assert times_us == [end_us for _, end_us in view.spans]
    assert min(np.diff(times_us)) >= 33_333
    assert len(times_us) > 5
    assert all(0 < end - begin <= 33_333 for begin, end in view.spans)
    t_us, T_world_body = view.bodies[-1]
    found = tracked.trajectory.at([t_us])[0]
    np.testing.assert_allclose(T_world_body[:3, 3], found[:3, 3], atol=0.02)


class InterruptedRecording(line_world.Wrapped):
    """A recording in whose reading an interrupt comes."""

    def events(self, camera, t0_us, t1_us):
        if t0_us >= 150_000:
            raise KeyboardInterrupt
        return self._recording.events(camera, t0_us, t1_us)


@pytest.mark.parametrize("stage", ["reading", "writing"])
def test_an_interrupt_leaves_nothing_and_the_same_command_starts_again(
    recording, tmp_path, monkeypatch, capsys, stage
):
    out = tmp_path / "out"
    command = ["track", str(tmp_path / "recording"), "--out", str(out), "--quiet"]
    opened = InterruptedRecording(recording) if stage == "reading" else recording
    with monkeypatch.context() as patched:
        patched.setattr("eventsweep.emvs.datasets.open_recording", lambda _path: opened)
        if stage == "writing":  # the poses are in the hidden folder then
            patched.setattr(odometry, "track", line_world.tracked_truly)
            interrupted = mock.Mock(side_effect=KeyboardInterrupt)
            patched.setattr(odometry, "track_page", interrupted)
        assert main(command) == 130
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("eventsweep.emvs.datasets.open_recording", lambda _path: recording)
    monkeypatch.setattr(odometry, "track", line_world.tracked_truly)
    assert main(command) == 0
    assert len(read_poses(out / "trajectory.txt")) == len(recording.trajectory)


KILLED = """
import os, signal, sys
import line_world
from eventsweep.emvs import datasets
from eventsweep.plugins.track import folder as odometry
from eventsweep.eval.cli.main import main
from eventsweep.eval.progress import SILENT
recording, out, kill_us = line_world.swaying(600_000), sys.argv[1], int(sys.argv[2])
class Deadly(line_world.Wrapped):
    def events(self, camera, t0_us, t1_us):
        print(t0_us, flush=True)
        if t0_us >= kill_us:
            os.kill(os.getpid(), signal.SIGKILL)
        return recording.events(camera, t0_us, t1_us)
datasets.open_recording = lambda _path: Deadly(recording)
odometry._KEEP_EVERY_S, odometry._KEEP_SHARE = 0.0, 1e9
odometry.content_hash = lambda *_arguments, **_stretch: "the same"  # which reads all
main(["track", "recording", "--out", out, "--planes", "40", "--map-s", "0.2", "--quiet"])
"""


@pytest.mark.slow
def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(tmp_path):
    folders = [Path(line_world.__file__).parent, *HELPER_FOLDERS]

    def run(out, kill_us):
        words = ["-c", KILLED, tmp_path / out, kill_us]
        done = python(*words, path=folders, cwd=tmp_path, timeout=None)
        return done.returncode, int(done.stdout.split()[0])

    assert run("whole", 1 << 40) == (0, 7)
    code, _ = run("out", 400_000)  # recordings are read 0.2 s at a time
    assert code == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    code, began_us = run("out", 1 << 40)
    assert code == 0
    assert began_us >= 250_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "whole"]
    for name in ("trajectory.txt", "cloud.ply", "track.json"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_first_map_that_is_none_is_refused(tmp_path, capsys):
    out = tmp_path / "out"
    command_refused(capsys, "track", tmp_path, "--out", out, "--first-map", tmp_path)
    assert not out.exists()
