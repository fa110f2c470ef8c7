"""Windows of events and depth: what they hold, as a data set and as files."""

import json
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import dataset_world as world
import eventsweep as es
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.training import TrainingWindows, write_windows
from eventsweep.emvs.geometry.warp import reproject_depth, undistort_depth
from eventsweep.eval.cli.main import main
from made_events import assert_same_events
from refusals import refused


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return world.write_sequence(tmp_path_factory.mktemp("training") / "ours", "kb4")


@pytest.mark.parametrize("camera", [0, 1])
def test_a_window_holds_the_events_before_its_depth(ours, camera):
    windows, sequence = (
        TrainingWindows(str(ours), window_s=0.04, camera=camera),
        Sequence.open(ours),
    )
    times_us = sequence.truth_times_us(camera)
    first_us, last_us = sequence.event_span_us(camera)
    expected = [t for t in times_us if t - 40_000 >= first_us and t <= last_us]
    assert [window["t1_us"] for window in windows] == expected
    assert len(windows) == len(expected) > 1
    for window, t_us in zip(windows, expected, strict=True):
        events = sequence.events(camera, t_us - 40_000, t_us)
        assert_same_events(SimpleNamespace(**window), events)
        assert len(events) > 0
        truth_m = sequence.truth_depth_m(camera, t_us)
        known = np.isfinite(truth_m)
        np.testing.assert_array_equal(window["depth_m"][known], truth_m[known])
        assert np.isnan(window["depth_m"][~known]).all()
        T = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[camera]
        np.testing.assert_array_equal(window["T_world_cam"], T)
        np.testing.assert_array_equal(window["K"], sequence.rig.cameras[camera].K)
        assert tuple(window["distortion"]) == sequence.rig.cameras[camera].distortion
        assert window["lens"] == "kb4"


def test_it_is_a_map_style_data_set(ours):
    windows = es.TrainingWindows(ours, window_s=0.04, transform=lambda window: len(window["x"]))
    assert windows[-1] == windows[len(windows) - 1] > 0
    with pytest.raises(IndexError):
        windows[len(windows)]
    assert list(windows) == [windows[k] for k in range(len(windows))]
    assert "TrainingWindows('" in repr(windows)


def test_worker_processes_get_it_by_pickling(ours):
    windows = TrainingWindows(ours, window_s=0.04)
    assert_same(pickle.loads(pickle.dumps(windows))[0], windows[0])
    _ = windows[0]
    assert_same(pickle.loads(pickle.dumps(windows))[1], windows[1])


def test_torch_loads_it(ours):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    windows = TrainingWindows(ours, window_s=0.04)
    loader = torch.utils.data.DataLoader(windows, batch_size=2, collate_fn=list)
    found = [window for batch in loader for window in batch]
    assert len(found) == len(windows)
    assert_same(found[1], windows[1])


def assert_same(one, other):
    assert set(one) == set(other)
    for name in other:
        np.testing.assert_array_equal(one[name], other[name])


def test_a_stride_leaves_windows_out(ours):
    every = [window["t1_us"] for window in TrainingWindows(ours, window_s=0.04)]
    step_s = 2.5 * (every[1] - every[0]) / 1e6
    some = [window["t1_us"] for window in TrainingWindows(ours, window_s=0.04, stride_s=step_s)]
    assert some[0] == every[0]
    assert set(some) < set(every)
    assert min(np.diff(some), default=step_s * 1e6) >= step_s * 1e6


@pytest.mark.parametrize("kind", ["dsec", "mvsec"])
def test_a_data_set_s_truth_lies_where_the_events_do(ours, tmp_path, kind):
    """Its depth is stored for a view without the lens, and is brought to the sensor's pixels."""
    theirs = open_recording(world.rewritten(ours, tmp_path / kind, kind))
    exact = {window["t1_us"]: window for window in TrainingWindows(ours, window_s=0.04)}
    compared = 0
    for window in TrainingWindows(theirs, window_s=0.04):
        truth_m = exact[window["t1_us"]]["depth_m"]
        both = np.isfinite(window["depth_m"]) & np.isfinite(truth_m)
        assert np.median(np.abs(window["depth_m"] - truth_m)[both]) < 0.02
        compared += np.count_nonzero(both)
    assert compared > 1000
    refused("no ground truth for camera 1", TrainingWindows, theirs, window_s=0.04, camera=1)


def test_depth_goes_to_the_view_and_back(ours):
    camera = Sequence.open(ours).rig.cameras[0]
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px]
    depth_m = (1 + 0.01 * rows + 0.02 * columns).astype(np.float32)
    back = reproject_depth(undistort_depth(depth_m, camera), camera.undistorted(), camera)
    known = np.isfinite(back)
    assert known.mean() > 0.5
    assert np.abs(back - depth_m)[known].max() < 0.04  # at most a pixel each way


def test_files_hold_the_same(ours, tmp_path):
    out = tmp_path / "windows"
    words = ["convert", str(ours), str(out), "--to", "windows", "--window-s", "0.04"]
    assert main([*words, "--stream", "cam1", "--quiet"]) == 0
    windows = TrainingWindows(ours, window_s=0.04, camera=1)
    manifest = json.loads((out / "windows.json").read_text())
    assert manifest["camera"] == "cam1"
    assert len(manifest["windows"]) == len(windows)
    for row, window in zip(manifest["windows"], windows, strict=True):
        with np.load(out / row["file"]) as stored:
            assert_same(dict(stored), window)
        assert (row["t0_us"], row["t1_us"]) == (window["t0_us"], window["t1_us"])
        assert row["events"] == len(window["x"])
    assert main([*words, "--quiet"]) == 2  # it is there
    assert main([*words, "--quiet", "--force"]) == 0
    before = (out / "000000.npz").read_bytes()
    write_windows(TrainingWindows(ours, window_s=0.04), out, force=True)
    assert (out / "000000.npz").read_bytes() == before


@pytest.mark.parametrize(("settings", "message"), [
    ({"window_s": 0}, "window_s"), ({"window_s": float("nan")}, "window_s"),
    ({"stride_s": -1}, "stride_s"), ({"camera": 2}, "no camera 2, there are 2"),
    ({"window_s": 100}, "shorter window_s"),
])  # fmt: skip
def test_windows_that_cannot_be_are_refused(ours, settings, message):
    refused(message, TrainingWindows, ours, **settings)


def test_no_truth_no_windows(ours, tmp_path, capsys):
    theirs = world.rewritten(ours, tmp_path / "a", "npz")
    assert main(["convert", str(theirs), str(tmp_path / "out"), "--to", "windows", "--quiet"]) == 2
    assert "no ground truth" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    words = ["convert", str(ours), str(tmp_path / "out"), "--to", "npz", "--window-s", "0.1"]
    assert main([*words, "--quiet"]) == 2
    assert "--window-s and --stride-s have no effect with --to npz" in capsys.readouterr().err
