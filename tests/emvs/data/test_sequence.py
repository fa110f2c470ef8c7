"""Sequences on disk: what goes in comes out, whole or not at all."""

import json
from pathlib import Path

import numpy as np
import pytest

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.outputs import atomic_dir
from made_events import assert_same_events, random_events
from point_world import stereo_rig
from refusals import all_bytes, refused

CAMERA = Camera(20, 10, 15, 15, 9.5, 4.5)


RIG = stereo_rig(CAMERA, 0.1, cameras=3)
TRAJECTORY = Trajectory(np.array([0, 10_000]), np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1)))


def packet(seed: int, start_us: int) -> Events:
    return random_events(np.random.default_rng(seed), 50, 20, 10, start_us, start_us + 1000)


def write(path: Path, *, force: bool = False, fail: BaseException | None = None) -> None:
    facts = {"config": {"a": 1}, "seed": 7, "depth_range_m": (0.5, 4.0), "force": force}
    with SequenceWriter(path, name="s", rig=RIG, trajectory=TRAJECTORY, **facts) as writer:
        for camera in range(3):
            writer.append_events(camera, packet(camera, 0))
            writer.append_events(camera, packet(camera + 10, 1000))
            depth_m = np.full((10, 20), 1.5 + camera, np.float32)
            writer.append_truth(camera, 500, depth_m, np.full((10, 20), camera, np.uint8))
        if fail:
            raise fail


def test_what_goes_in_comes_out(tmp_path):
    write(tmp_path / "s")
    sequence = open_recording(tmp_path / "s")
    assert isinstance(sequence, Sequence)
    assert (sequence.name, sequence.depth_range_m, sequence.manifest.seed) == ("s", (0.5, 4.0), 7)
    for camera in range(3):
        expected = Events.concat([packet(camera, 0), packet(camera + 10, 1000)])
        assert_same_events(sequence.events(camera, -(10**9), 10**9), expected)
        assert sequence.event_span_us(camera) == TRAJECTORY.span_us
        assert (sequence.truth_depth_m(camera, 500) == 1.5 + camera).all()
        assert (sequence.truth_intensity(camera, 500) == camera).all()
    sequence.verify()
    refused("nearest: 500", sequence.truth_depth_m, 0, 501)
    write(tmp_path / "b")
    assert all_bytes(tmp_path / "s") == all_bytes(tmp_path / "b")


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_broken_off_write_leaves_nothing(tmp_path, error):
    with pytest.raises(error):
        write(tmp_path / "s", fail=error())
    assert list(tmp_path.iterdir()) == []


def test_an_existing_sequence_is_kept_unless_forced(tmp_path):
    write(tmp_path / "s")
    before = all_bytes(tmp_path / "s")
    refused("force=True", write, tmp_path / "s")
    with pytest.raises(RuntimeError):
        write(tmp_path / "s", force=True, fail=RuntimeError())
    assert all_bytes(tmp_path / "s") == before
    write(tmp_path / "s", force=True)
    assert all_bytes(tmp_path / "s") == before
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


@pytest.mark.parametrize("name", ["rig.json", "poses.txt", "cam1/events.h5", "cam2/truth.h5"])
def test_missing_truncated_and_changed_files_are_noticed(tmp_path, name):
    write(tmp_path / "s")
    path = tmp_path / "s" / name
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    refused("create the sequence again", Sequence.open, tmp_path / "s")
    path.unlink()
    if name != "poses.txt":
        refused("missing", Sequence.open, tmp_path / "s")
    path.write_bytes(bytes([content[0] ^ 1]) + content[1:])
    refused("", lambda: Sequence.open(tmp_path / "s").verify())
    manifest = tmp_path / "s" / "manifest.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "schema_version": 99}))
    refused("schema version 99", Sequence.open, tmp_path / "s")
    manifest.write_text("{")
    refused("damaged manifest", Sequence.open, tmp_path / "s")


def test_atomic_file_is_whole_or_absent(tmp_path):
    target = tmp_path / "f.txt"

    def break_off() -> None:
        with atomic_path(target) as partial:
            partial.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert list(tmp_path.iterdir()) == []
    with atomic_path(target) as partial:
        partial.write_text("whole")
    assert target.read_text() == "whole"
    assert [path.name for path in tmp_path.iterdir()] == ["f.txt"]


KILLED_WRITER = """
import os, pathlib, signal, sys
from eventsweep.emvs.utils.outputs import atomic_dir
with atomic_dir(pathlib.Path(sys.argv[1])) as folder:
    (folder / "half").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_holds_is_not(tmp_path):
    import subprocess
    import sys

    target, other = tmp_path / "out", tmp_path / "out2"
    for path in (target, other):
        subprocess.run([sys.executable, "-c", KILLED_WRITER, str(path)], check=False)
    assert {path.name for path in tmp_path.iterdir()} == {".out.partial", ".out2.partial"}
    with atomic_dir(target) as first:
        (first / "kept").write_text("kept")
        assert first.is_relative_to(tmp_path / ".out.partial")
        refused("another process", atomic_dir(target, force=True).__enter__)
    assert sorted(path.name for path in target.iterdir()) == [".eventsweep.json", "kept"]
    # Of the other target a folder is left, which the next run into it removes.
    assert [p.name for p in tmp_path.iterdir() if p != target] == [".out2.partial"]
    with atomic_dir(other):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {"out", "out2"}


def test_folders_that_only_look_alike_are_left_alone(tmp_path):
    alike = [
        "._out.12345678.partial", ".out.1234567.partial", ".out.12345678.old", ".outer.partial",
    ]  # fmt: skip
    for name in alike:
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis").write_text("mine")
    (tmp_path / ".out.12345678.partial").write_text("a file")
    with atomic_dir(tmp_path / "out"):
        pass
    assert {p.name for p in tmp_path.iterdir()} == {*alike, ".out.12345678.partial", "out"}
