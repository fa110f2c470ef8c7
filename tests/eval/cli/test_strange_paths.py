"""What is no regular file, given where a command or a function reads one: one line, at once."""

import os
import time

import pytest

from dataset_world import write_sequence
from eventsweep.emvs.data.hdf5 import open_hdf5
from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.data.stamps import read_stamps
from eventsweep.emvs.data.tables import read_imu
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.custom import read_descriptor, read_hand_eye
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.calibration import read_imu_cam, read_rig
from eventsweep.emvs.formats.calibration_values import parsed
from eventsweep.emvs.formats.depth import read_depth, read_exr, read_grey, read_png
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval import config as settings
from eventsweep.eval.gate.baseline import read_baseline
from eventsweep.eval.results.results import read_results
from eventsweep.eval.scoring.predictions import read_description
from eventsweep.eval.studies.stored import read_study
from eventsweep.eval.suite import definition
from eventsweep.scoring import score_trajectory
from eventsweep.sim.mjcf import model_of
from eventsweep.sim.sensor_presets import read_preset
from refusals import command_refused

SOON_S = 10.0  # with what is imported first
PLANTS = {
    "pipe": os.mkfifo, "folder": os.mkdir,
    **{
        name: lambda path, to=to: path.symlink_to(to)
        for name, to in (
            ("device", "/dev/zero"), ("made up", "/proc/self/maps"), ("itself", "loop"),
        )
    },
}  # fmt: skip
READERS = {
    "poses.txt": read_poses, "times.txt": read_stamps, "imu.csv": read_imu, "c.yaml": read_rig,
    "c.json": parsed, "hand_eye.yaml": read_hand_eye, "imu_cam.json": read_imu_cam,
    "recording.toml": read_descriptor, "e.h5": lambda path: open_hdf5(path).__enter__(),
    "d.npy": read_depth, "d.npz": read_depth, "d.exr": read_exr, "d.png": read_png,
    "g.png": read_grey, "map": read_map, "s.toml": lambda path: settings.load(path),
    "baseline.json": read_baseline, "results.json": read_results, "suite.toml": definition.read,
    "prediction.toml": read_description, "study.json": read_study, "sensor.toml": read_preset,
    "m.xml": model_of, "m.urdf": model_of, "sequence": open_recording,
    "estimate.txt": lambda path: score_trajectory(path, path),
}  # fmt: skip
EVENTS = (
    "raw", "dat", "h5", "hdf5", "npz", "npy", "bag", "db3", "mcap", "aedat", "aedat4", "csv", "txt",
    "mat", "parquet", "any",
)  # fmt: skip
COMMANDS = (
    "info AT", "convert AT out.h5 --to v2e", "convert AT out.txt --to text", "map AT --out out",
    "map SEQUENCE --out out --config AT", "map AT.toml --out out", "score AT", "report AT",
    "score est.txt --truth AT", "score AT --truth SEQUENCE", "compare AT AT", "fuse AT",
    "run AT --out out", "run SEQUENCE --out out --config AT", "simulate AT.xml --out out",
    "simulate planes --out out --trajectory AT", "simulate planes --out out --config AT",
    "simulate planes --out out --sim.sensor.preset AT", "suite AT.toml", "gate --baseline AT",
    "gate --baseline base.json --result AT", "report AT/x", "suite AT.toml:quick",
    "map SEQUENCE --out AT", "simulate planes --out AT", "info SEQUENCE --picture AT",
    "compare AT AT --out out",
)  # fmt: skip


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("name", [*READERS, *(f"events.{suffix}" for suffix in EVENTS)])
def test_readers(tmp_path, name, plant):
    place = tmp_path / ("loop" if plant == "itself" else name)
    PLANTS[plant](place)
    began = time.monotonic()
    with pytest.raises((InputError, OSError) if plant == "itself" else InputError) as caught:
        READERS.get(name, open_events)(place)
    assert len(str(caught.value).splitlines()) == 1
    assert time.monotonic() - began < SOON_S


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("sound") / "sequence", "radtan", 1, steps=30)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("words", COMMANDS)
def test_commands(tmp_path, monkeypatch, capsys, sequence, words, plant):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    place = tmp_path / "loop"
    for suffix in ("", ".toml", ".xml"):
        PLANTS[plant](place.with_name(f"loop{suffix}"))
    began = time.monotonic()
    named = [word.replace("SEQUENCE", str(sequence)) for word in words.split()]
    named = [f"{place}{word[2:]}" if word.startswith("AT") else word for word in named]
    line = command_refused(capsys, *named, errno=True)
    assert time.monotonic() - began < SOON_S
    assert len(line) < 1000
    assert not (tmp_path / "out").exists()
