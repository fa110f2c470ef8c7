"""Recordings that someone else made: nothing hangs, nothing is read that is not theirs."""

import json
import os
import shutil
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from cost_stream import MovingEdges
from dataset_world import rewritten, write_sequence
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.hdf5 import open_hdf5
from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.custom import read_descriptor
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.calibration_values import parsed
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.maps.folder import read_info
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.windows import MOST_WINDOWS, plan_windows
from eventsweep.eval import config as settings
from eventsweep.eval.gate.baseline import read_baseline
from eventsweep.eval.report.study_page import find_studies
from eventsweep.eval.scoring.predictions import read_description
from eventsweep.eval.suite import definition
from eventsweep.sim.sensor_presets import read_preset
from refusals import refused
from sockets import plug

DEEP = "[" * 100_000


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "edges"
    MovingEdges((64, 48), 3000).write(folder)
    return folder


@pytest.fixture
def sequence(made, tmp_path):
    return shutil.copytree(made, tmp_path / "edges")


def refused_soon(words, call, *arguments):
    began = time.process_time()
    assert len(refused(words, call, *arguments)) < 1000
    assert time.process_time() - began < 10


def external_storage(file, path):
    file.create_dataset("events/x", (16,), np.uint16, external=[(path, 0, 32)])


def external_link(file, path):
    file["events"] = h5py.ExternalLink(path, "/")


def virtual(file, path):
    layout = h5py.VirtualLayout((16,), np.uint16)
    layout[:] = h5py.VirtualSource(path, "x", (16,))
    file.create_virtual_dataset("events/x", layout)


@pytest.mark.parametrize("lead", [external_storage, external_link, virtual])
@pytest.mark.parametrize("call", [open_events, lambda path: open_hdf5(path).__enter__()])
def test_hdf5_that_leads_into_another_file_is_refused(tmp_path, lead, call):
    (tmp_path / "secret").write_bytes(bytes(32))
    with h5py.File(tmp_path / "events.h5", "w") as file:
        lead(file, str(tmp_path / "secret"))
    refused_soon("another file", call, tmp_path / "events.h5")


def pipe(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


READERS = {
    "poses": read_poses, "calibration": parsed, "recording.toml": read_descriptor,
    "events": open_events,
    "hdf5": lambda path: open_hdf5(path).__enter__(),
    "baseline": read_baseline, "suite": definition.read,
    "settings": lambda path: settings.load(path), "prediction.toml": read_description,
    "preset": read_preset,
}  # fmt: skip


@pytest.mark.parametrize("plant", [pipe, device, plug])
@pytest.mark.parametrize("name", READERS)
def test_only_regular_files_are_opened(tmp_path, name, plant):
    plant(tmp_path / name)
    refused_soon("is a (pipe|device|socket|link)", READERS[name], tmp_path / name)


@pytest.mark.parametrize("plant", [pipe, device, plug])
@pytest.mark.parametrize("name", ["manifest.json", "rig.json", "poses.txt", "cam0/events.h5"])
def test_only_regular_files_are_opened_in_a_sequence(sequence, name, plant):
    (sequence / name).unlink()
    plant(sequence / name)
    refused_soon("is a (pipe|device|socket)|not a file in this folder", Sequence, sequence)


@pytest.mark.parametrize("name", ["/etc/hostname", "../secret", "cam0/../../secret", "a\0b", ""])
def test_a_manifest_names_only_what_is_inside(sequence, name):
    (sequence.parent / "secret").write_text("x")
    index = sequence / "manifest.json"
    content = json.loads(index.read_text())
    content["files"][name] = {"sha256": "0" * 64, "bytes": 1}
    index.write_text(json.dumps(content))
    refused_soon("not a file in this folder", Sequence, sequence)


def test_a_link_that_leaves_a_sequence_is_refused_and_one_that_stays_is_followed(sequence):
    poses = sequence / "poses.txt"
    poses.rename(sequence / "kept.txt")
    poses.symlink_to("kept.txt")
    assert len(Sequence(sequence).trajectory.t_us)
    (sequence / "kept.txt").rename(sequence.parent / "kept.txt")
    for target, words in (
        (sequence.parent / "kept.txt", "not a file in this folder.*replace the link"),
        ("poses.txt", "missing"),  # in a circle
    ):
        poses.unlink()
        poses.symlink_to(target)
        refused_soon(words, Sequence, sequence)


@pytest.mark.parametrize("name", ["manifest.json", "poses.txt", "rig.json", "cam0", "sensor.json"])
@pytest.mark.parametrize("listed", [True, False])
def test_no_link_in_a_sequence_leads_out_of_it(sequence, name, listed):
    """Whether or not the manifest names it: `cam0` is a folder, and nobody listed `sensor.json`."""
    index, place, outside = sequence / "manifest.json", sequence / name, sequence.parent / "outside"
    content = json.loads(index.read_text())
    if not listed:
        content["files"] = {k: v for k, v in content["files"].items() if not k.startswith(name)}
        index.write_text(json.dumps(content))
    place.rename(outside) if place.exists() else outside.write_text("[]")
    place.symlink_to(outside)
    refused_soon(f"{name} is not a file in this folder.*replace the link", Sequence, sequence)


@pytest.mark.parametrize("kind", ["dsec", "tumvie", "mvsec", "rosbag1", "npz"])
def test_links_in_a_data_set_are_followed(tmp_path, kind):
    """People keep large files on another disk."""
    ours = write_sequence(tmp_path / "ours", "radtan" if kind == "rosbag1" else "kb4", steps=60)
    folder, disk = rewritten(ours, tmp_path / kind, kind), tmp_path / "disk"
    before = open_recording(folder).events(0, 0, 10**6)
    for k, path in enumerate([path for path in folder.rglob("*") if path.is_file()]):
        disk.mkdir(exist_ok=True)
        path.rename(disk / f"{k}{path.suffix}")
        path.symlink_to(disk / f"{k}{path.suffix}")
    (tmp_path / "linked").symlink_to(folder)
    after = open_recording(tmp_path / "linked").events(0, 0, 10**6)
    np.testing.assert_array_equal(after.t_us, before.t_us)
    assert len(after) > 0


@pytest.mark.parametrize("name", ["manifest.json", "rig.json"])
def test_deep_nesting_in_a_sequence_is_one_line(sequence, name):
    text = DEEP.ljust((sequence / name).stat().st_size)
    index = json.loads((sequence / "manifest.json").read_text())
    (sequence / name).write_text(text)
    if name in index["files"]:
        index["files"][name]["bytes"] = len(text)
        (sequence / "manifest.json").write_text(json.dumps(index))
    refused_soon("damaged|nested", Sequence, sequence)


@pytest.mark.parametrize(
    "name",
    ["baseline", "suite", "settings", "prediction.toml", "calibration", "preset", "recording.toml"],
)
@pytest.mark.parametrize("text", [
    DEEP, "a = " + DEEP, '{"a":' * 30_000, "a = " + "1" * 9000, "a" + ".a" * 20_000 + " = 1",
    "[sim]\na" + ".a" * 900 + " = 1", '{"a":' * 900 + "1" + "}" * 900,
    "a = " + "[" * 900 + "]" * 900, "a = " + "{a = " * 90 + "1" + "}" * 90,
])  # fmt: skip
def test_deep_nesting_and_long_numbers_are_one_line(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    refused_soon(".", READERS[name], tmp_path / name)


@pytest.mark.parametrize("name", ["recording.toml", "preset", "settings"])
@pytest.mark.parametrize("head", ["", "[poses]\n", "[sensor]\n", "[map]\n"])
def test_a_long_key_is_shortened(tmp_path, name, head):
    (tmp_path / name).write_text(f"{head}{'9' * 5000} = 1\n")
    refused_soon(".", READERS[name], tmp_path / name)


def test_deep_nesting_in_a_map_and_a_study(tmp_path):
    (tmp_path / "map.json").write_text(DEEP)
    refused_soon("nested too deeply", read_info, tmp_path)
    assert find_studies(tmp_path) == []


@pytest.mark.parametrize("text", ["1" * 5_000_000, "1:" * 100_000 + "1", "1" * 200_000])
def test_a_calibration_of_digits_is_refused_soon(tmp_path, text):
    (tmp_path / "chain.yaml").write_text(f"cam0: {text}\n")
    refused_soon("bytes|digits", parsed, tmp_path / "chain.yaml")


@pytest.mark.parametrize("value", [10**30, 1e30, 10**400, float("inf"), float("nan")])
@pytest.mark.parametrize("key", ["fx_px", "cx_px", "distortion"])
def test_impossible_intrinsics_are_one_line(key, value):
    values = {"width_px": 4, "height_px": 3, "fx_px": 5.0, "fy_px": 5.0, "cx_px": 2, "cy_px": 1}
    given = (0, 0, 0, value) if key == "distortion" else value
    values |= {"model": "radtan", "distortion": (0, 0, 0, 0), key: given}
    refused_soon("must be finite", Camera.from_json, values)


def depth_range_of(near, far):
    edges = MovingEdges((64, 48), 3000)
    return depth_range_m(edges, MapperConfig(min_depth_m=near, max_depth_m=far))


@pytest.mark.parametrize(("words", "call", "values"), [
    ("at most 65536", Camera, (10**30, 3, 5, 5, 2, 1)),
    ("at most 65536", Camera, (4, 10**400, 5, 5, 2, 1)),
    *(("a..?x?0*b", call, (Path("a\0b"),)) for call in (read_poses, parsed, open_events)),
    ("must lie within", depth_range_of, (1e-300, 1e300)),
    ("must lie within", depth_range_of, (1e-320, 5)),
    ("must lie within", depth_range_of, (0.1, 1e12)),
    (rf"\d+ windows, at most {MOST_WINDOWS}", plan_windows,
     (MovingEdges((64, 48), 3000), MapperConfig(window_s=1e-6))),
])  # fmt: skip
def test_values_beyond_reason_are_one_line(words, call, values):
    refused_soon(words, call, *values)
