"""Recordings for the Rerun viewer: what is logged, where and when; with the library, a file."""

import importlib.util
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.maps.folder import read_map
from eventsweep.emvs.utils.release import install_extra
from eventsweep.eval.config import EvalConfig, Settings
from eventsweep.eval.pipeline import map_recording, score_folder
from eventsweep.eval.report.rerun import live_view, write_rerun
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

    def spawn(self, **_options):
        self.name = "a window"

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
        **{
            n: record(n)
            for n in (
                "Transform3D",
                "Pinhole",
                "Image",
                "DepthImage",
                "Points3D",
                "Tensor",
                "LineStrips3D",
            )
        },
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
            *(f"planes/{what}/{m}" for what in ("cloud", "dsi") for m in ("Alg1-H", "EMVS-cam0")),
        }  # fmt: skip
        found = window.depth_map("Alg1/H")
        (depth,) = at["planes/camera/depth/Alg1-H"]
        np.testing.assert_array_equal(depth.args[0] > 0, found.mask)
        np.testing.assert_array_equal(depth.args[0][found.mask], found.depth_m[found.mask])
        place, pinhole = at["planes/camera"]
        np.testing.assert_array_equal(place.translation, found.T_world_rv[:3, 3])
        np.testing.assert_array_equal(place.mat3x3, found.T_world_rv[:3, :3])
        np.testing.assert_array_equal(pinhole.image_from_camera, found.camera.K)
        (votes,) = at["planes/dsi/Alg1-H"]
        far_first = np.argsort(window.slices.rho)
        np.testing.assert_array_equal(votes.args[0], window.slices.values["Alg1/H"][far_first])
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


# --- while it works
def shown(stream, entity):
    """(time, what) of an entity, as it was logged."""
    return [(t, what) for t, name, what in stream.logged if name == entity]


def test_a_view_shows_events_path_and_maps_as_they_come(folder, stream, tmp_path):
    sequence = Sequence.open(folder / "planes" / "sequence")
    with live_view("run", tmp_path / "live.rrd") as view:
        view.sequence("planes", folder / "planes" / "sequence")
        view.maps("planes", folder / "planes" / "map")
        assert not (tmp_path / "live.rrd").exists(), "whole or not at all"
    (made,) = stream
    assert (tmp_path / "live.rrd").read_bytes() == b"RRF2"
    events = shown(made, "planes/sensor/events")
    times_s = [t for t, _ in events]
    assert times_s == sorted(times_s)
    assert len(times_s) >= 3
    first_us, last_us = sequence.event_span_us(0)
    assert times_s[-1] == pytest.approx(1e-6 * (last_us + 1))
    whole = sequence.events(0, first_us, round(1e6 * times_s[0]))
    fired = np.zeros(events[0][1][0].args[0].shape[:2], bool)
    fired[whole.y, whole.x] = True
    ground = events[0][1][0].args[0][~fired][0]
    np.testing.assert_array_equal((events[0][1][0].args[0] != ground).any(axis=-1) & fired, fired)
    paths = [what[0].args[0][0] for _, what in shown(made, "planes/path")]
    assert [len(path) for path in paths] == list(range(1, len(times_s) + 1))
    t_us = min(last_us, sequence.trajectory.span_us[1])
    np.testing.assert_allclose(paths[-1][-1], sequence.trajectory.at([t_us])[0][:3, 3])
    place, pinhole = shown(made, "planes/sensor")[-1][1]
    T_world_cam = sequence.trajectory.at([t_us])[0] @ sequence.rig.T_body_cam[0]
    np.testing.assert_allclose(place.translation, T_world_cam[:3, 3])
    np.testing.assert_array_equal(pinhole.image_from_camera, sequence.rig.cameras[0].K)
    windows = read_map(folder / "planes" / "map").windows
    for entity in ("camera/depth/Alg1-H", "cloud/Alg1-H", "dsi/Alg1-H", "camera/true_depth"):
        found = [t for t, _ in shown(made, f"planes/{entity}")]
        assert found == [1e-6 * window.info.t_ref_us for window in windows]


def test_a_view_that_is_cut_off_leaves_no_file(stream, tmp_path):
    with pytest.raises(KeyboardInterrupt), live_view("run", tmp_path / "live.rrd"):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_a_window_opens_where_there_is_a_display_and_is_refused_where_not(
    stream, monkeypatch, capsys, tmp_path
):
    monkeypatch.setenv("DISPLAY", ":0")
    with live_view("run"):
        pass
    assert stream[0].name == "a window"
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    out = tmp_path / "out"
    said = command_refused(capsys, "run", "planes", "--out", out, "--view")
    assert "no display" in said
    assert "--view-file" in said
    both = "--view", "--view-file", tmp_path / "live.rrd"
    assert "choose one" in command_refused(capsys, "run", "planes", "--out", out, *both)
    (tmp_path / "live.rrd").write_text("mine")
    there = "--view-file", tmp_path / "live.rrd"
    assert "live.rrd exists" in command_refused(capsys, "run", "planes", "--out", out, *there)
    assert [path.name for path in tmp_path.iterdir()] == ["live.rrd"]


def test_a_view_needs_the_library(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    words = "run", "planes", "--out", tmp_path / "out", "--view-file", tmp_path / "live.rrd"
    assert install_extra("rerun") in command_refused(capsys, *words)
    assert not list(tmp_path.iterdir())


def test_without_the_library_one_line_says_how_to_get_it(folder, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    (folder / "recording.rrd").unlink(missing_ok=True)  # another test's, which no library wrote
    assert install_extra("rerun") in command_refused(capsys, "report", folder, "--rrd")


@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="no rerun-sdk installed")
def test_the_library_writes_a_file(folder):
    path = write_rerun(folder)
    assert path.read_bytes()[:3] == b"RRF"
    assert path.stat().st_size > 10_000
