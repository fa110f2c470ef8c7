"""Recordings for the Rerun viewer: what is logged, where and when; with the library, a file."""

import importlib.util
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.maps.folder import read_map
from eventsweep.emvs.utils.release import install_extra
from eventsweep.eval.config import EvalConfig, Settings
from eventsweep.eval.pipeline import map_recording, score_folder
from eventsweep.eval.report.rerun import write_rerun
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from mujoco_scenes import tiny_rig
from refusals import command_refused


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of two windows of one small case."""
    out = tmp_path_factory.mktemp("run")
    config = SimConfig(duration_s=0.1, truth_times_s=(0.025, 0.075))
    simulate(scenes.load("planes"), tiny_rig(), config, 0, out / "planes" / "sequence")
    settings = Settings(
        map=MapperConfig(planes=20, window_s=0.05, methods=("Alg1/H", "EMVS/cam0"), threshold_c=1)
    )
    map_recording(out / "planes" / "sequence", out / "planes" / "map", settings)
    return out


class Stream:
    """Stands for a recording, and remembers."""

    def __init__(self, name, recording_id):
        self.logged, self.time_s, self.name = [], None, recording_id

    def save(self, path):
        path.write_bytes(b"RRF2")

    def set_time(self, timeline, duration):
        self.time_s = duration

    def log(self, entity, *what, static=False):
        self.logged.append((self.time_s, entity, what))

    def flush(self):
        self.flushed = True

    def disconnect(self):
        assert self.flushed


@pytest.fixture
def stream(monkeypatch):
    """The stream that is made by a library which has only what is needed."""
    made = []

    def record(name):
        return lambda *args, **kwargs: SimpleNamespace(kind=name, args=args, **kwargs)

    library = SimpleNamespace(
        RecordingStream=lambda *args, **kwargs: made.append(Stream(*args, **kwargs)) or made[-1],
        ViewCoordinates=SimpleNamespace(RDF="RDF", RIGHT_HAND_Z_UP="Z"),
        Radius=SimpleNamespace(ui_points=lambda px: -px),
        **{n: record(n) for n in ("Transform3D", "Pinhole", "Image", "DepthImage", "Points3D")},
    )
    monkeypatch.setitem(sys.modules, "rerun", library)
    return made


def test_every_window_is_logged_at_its_reference_time(folder, stream):
    path = write_rerun(folder)
    assert path == folder / "recording.rrd"
    assert path.exists()
    (made,) = stream
    windows = read_map(folder / "planes" / "map").windows
    assert len(windows) == 2
    for window in windows:
        at = {e: what for t, e, what in made.logged if t == 1e-6 * window.info.t_ref_us}
        assert set(at) == {
            "planes/camera", "planes/camera/frame", "planes/camera/true_depth",
            *(f"planes/camera/depth/{m}" for m in ("Alg1-H", "EMVS-cam0")),
            *(f"planes/cloud/{m}" for m in ("Alg1-H", "EMVS-cam0")),
        }  # fmt: skip
        found = window.depth_map("Alg1/H")
        (depth,) = at["planes/camera/depth/Alg1-H"]
        np.testing.assert_array_equal(depth.args[0] > 0, found.mask)
        np.testing.assert_array_equal(depth.args[0][found.mask], found.depth_m[found.mask])
        place, pinhole = at["planes/camera"]
        np.testing.assert_array_equal(place.translation, found.T_world_rv[:3, 3])
        np.testing.assert_array_equal(place.mat3x3, found.T_world_rv[:3, :3])
        np.testing.assert_array_equal(pinhole.image_from_camera, found.camera.K)
        (truth,) = at["planes/camera/true_depth"]
        assert truth.meter == 1.0
        assert np.count_nonzero(truth.args[0]) > found.mask.sum()


def test_a_prediction_is_logged_beside_the_maps(folder, stream, tmp_path):
    run = shutil.copytree(folder, tmp_path / "run")
    windows = read_map(run / "planes" / "map").windows
    for window in windows:
        depth_map = window.depth_map("EMVS/cam0")
        (tmp_path / "theirs").mkdir(exist_ok=True)
        depth_m = np.where(depth_map.mask, depth_map.depth_m, np.nan)
        np.save(tmp_path / "theirs" / f"{depth_map.t_us}.npy", depth_m)
    score_folder(run, EvalConfig(), [tmp_path / "theirs"])
    write_rerun(run)
    for window in windows:
        at = {e: what for t, e, what in stream[0].logged if t == 1e-6 * window.info.t_ref_us}
        assert "planes/cloud/Given-theirs" in at
        ours, theirs = (at[f"planes/camera/depth/{m}"][0] for m in ("EMVS-cam0", "Given-theirs"))
        np.testing.assert_array_equal(theirs.args[0], ours.args[0])


def test_a_recording_that_is_gone_leaves_the_maps(folder, stream, tmp_path):
    write_rerun(shutil.copytree(folder / "planes" / "map", tmp_path / "map"))
    logged = {entity for _, entity, _ in stream[0].logged}
    assert {"planes/camera", "planes/cloud/Alg1-H"} < logged
    assert not logged & {"planes/camera/frame", "planes/camera/true_depth"}


def test_without_the_library_one_line_says_how_to_get_it(folder, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    (folder / "recording.rrd").unlink(missing_ok=True)  # another test's, which no library wrote
    assert install_extra("rerun") in command_refused(capsys, "report", folder, "--rrd")


@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="no rerun-sdk installed")
def test_the_library_writes_a_file(folder):
    path = write_rerun(folder)
    assert path.read_bytes()[:3] == b"RRF"
    assert path.stat().st_size > 10_000
