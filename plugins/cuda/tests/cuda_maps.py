"""Whole maps by a GPU, or its simulator: run by `test_cuda.py`, which says how."""

import dataclasses
import json
import re

import numpy as np
import pytest

import point_world
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.device import choose_device
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.maps.sliding import map_windows
from eventsweep.emvs.methods import (
    FAMILIES,
    known_methods,
    methods_by_name,
    register,
    unregister,
    with_volume,
)
from eventsweep.emvs.methods.method import Method
from eventsweep.plugins.cuda import backend as cuda_backend
from eventsweep.plugins.cuda import device, platform

if device.missing():
    pytest.skip(device.missing(), allow_module_level=True)

CAMERA = point_world.pinhole(8, 6, 7.0)
TRAJECTORY = point_world.sideways()


def recording(n=40, cameras=2):
    streams = tuple(point_world.edge_stream(CAMERA, TRAJECTORY, n, seed=k) for k in range(cameras))
    rig = point_world.stereo_rig(CAMERA, cameras=cameras)
    return point_world.Recorded(rig, TRAJECTORY, streams, (0.5, 3.2))


def config(**values):
    return MapperConfig(**{"planes": 3, "focus": {"sigma_px": 0.7}, "border_px": 0, **values})


def by_both(config, **more):
    given = recording(**more)
    there = map_window(given, config.model_copy(update={"device": "cuda"}))
    return map_window(given, config), there


def check_same(here, there):
    assert there.counts == here.counts
    assert list(there.depth_maps) == list(here.depth_maps)
    np.testing.assert_array_equal(there.event_image, here.event_image)
    for name, one in here.depth_maps.items():
        other = there.depth_maps[name]
        np.testing.assert_allclose(other.confidence, one.confidence, atol=1e-3, err_msg=name)
        np.testing.assert_array_equal(other.argmax, one.argmax, err_msg=name)
        np.testing.assert_array_equal(other.mask, one.mask, err_msg=name)
        np.testing.assert_allclose(other.depth_m, one.depth_m, rtol=1e-3, err_msg=name)
        assert other.argmax.dtype == one.argmax.dtype
    for name, row in here.slices.values.items():
        np.testing.assert_allclose(there.slices.values[name], row, atol=1e-3, err_msg=name)


def every_method():
    """One of each kind that sweeps, from the registry's own examples."""
    examples = [name for family in FAMILIES.values() for name in family.examples]
    names = [method.name for method in known_methods(2)] + examples
    # DERD-Net takes 100 planes and nothing else; its volume is that of Alg1/H
    swept = (m for m in with_volume(methods_by_name(names, 2)) if m.family != "DERD")
    return tuple(method.name for method in swept)


def test_every_method_of_the_registry_gives_the_map_of_the_cpu():
    names = every_method()
    assert {"Alg1/H", "Focus/H", "Late/union", "Alg2/AtHc@4"} <= set(names)
    here, there = by_both(config(methods=names))
    check_same(here, there)
    assert (here.device, there.device) == ("cpu", device.gpu().name)


@pytest.mark.parametrize(
    "values",
    [
        {"polarity": "separate"},
        {"voting": "nearest"},
        {"extraction": "dog"},
        {"view_width_px": 13, "view_height_px": 6, "reference_shift": 0.5, "spacing": "linear"},
    ],
    ids=lambda values: "-".join(values),
)
def test_every_setting_gives_the_map_of_the_cpu(values):
    check_same(*by_both(config(methods=("Alg1/H", "EMVS/cam1"), **values)))


def test_polarities_apart_in_sub_intervals_and_in_late_fusion():
    names = ("Alg2/AtHc@2", "Late/union", "Focus/H")
    check_same(*by_both(config(methods=names, polarity="separate", planes=2)))


def test_baselines_run_on_the_cpu_beside_the_sweep_and_a_line_says_so(tmp_path, caplog):
    about, windows = RecordingInfo(name="points", path="-"), {}
    for name in ("cpu", "cuda"):
        asked = config(methods=("Alg1/H", "SGM/ts"), planes=2, window_s=0.2, device=name)
        map_windows(recording(60), tmp_path / name, asked, about, clouds=False)
        windows[name] = read_map(tmp_path / name).windows
    assert caplog.messages == [
        "device cuda: baselines run on the CPU: SGM/ts"
    ]  # once, not per window
    for here, there in zip(windows["cpu"], windows["cuda"], strict=True):
        assert there.info.device == device.gpu().name
        one, other = here.depth_map("SGM/ts"), there.depth_map("SGM/ts")
        np.testing.assert_array_equal(other.depth_m, one.depth_m)


def test_a_map_by_baselines_alone_is_the_cpus(caplog):
    here, there = by_both(config(methods=("SGM/ts", "SGM/window")))
    check_same(here, there)
    assert (here.device, there.device) == ("cpu", "cpu")
    assert caplog.messages == ["device cuda: baselines run on the CPU: SGM/ts, SGM/window"]


def test_three_cameras_and_one():
    check_same(*by_both(config(methods=("Alg1/H", "Alg1/G")), cameras=3, n=30))
    check_same(*by_both(config(), cameras=1, n=30))


@pytest.mark.slow
def test_the_compatibility_setting():
    # 1 packet of 1024 events, its tail dropped
    setting = config(compatibility="mcemvs", methods=("Alg1/H",), planes=2)
    check_same(*by_both(setting, n=1030))


def test_functions_of_ones_own_are_folded_by_the_cpu():
    def middle(votes):
        return np.median(votes.sum(axis=1), axis=0)

    register(Method.from_function("Mine/median", middle, "the middle"))
    try:
        check_same(*by_both(config(methods=("Alg1/H", "Mine/median"), extraction="variance")))
    finally:
        unregister("Mine/median")


def test_whole_volumes_come_down_on_request(tmp_path):
    volumes = {}
    for name in ("cpu", "cuda"):
        asked = config(methods=("Alg1/H",), save_dsi=True, device=name)
        map_window(recording(), asked, dsi_dir=tmp_path / name)
        volumes[name] = np.load(tmp_path / name / "Alg1-H.npy")
    np.testing.assert_allclose(volumes["cuda"], volumes["cpu"], atol=1e-3)


def with_gpu(monkeypatch, **changes):
    """Pretends another GPU; notes how many planes are swept at a time."""
    found = dataclasses.replace(device.gpu(), **changes)
    monkeypatch.setattr(device, "gpu", lambda: found)
    planes = []
    init = cuda_backend.CudaBackend.__init__

    def noted(self, task, rays):
        init(self, task, rays)
        planes.append(self.planes_in_flight)

    monkeypatch.setattr(cuda_backend.CudaBackend, "__init__", noted)
    return planes


def test_planes_in_flight_fit_the_cache_and_change_no_bit(monkeypatch):
    asked = config(methods=("Alg1/H", "Focus/H"), device="cuda", threshold_c=-5)
    whole = map_window(recording(), asked)
    planes = with_gpu(monkeypatch, l2_bytes=800)
    parts = map_window(recording(), asked)
    assert planes == [1]
    for name, depth_map in whole.depth_maps.items():
        np.testing.assert_array_equal(parts.depth_maps[name].confidence, depth_map.confidence)
        np.testing.assert_array_equal(parts.depth_maps[name].depth_m, depth_map.depth_m)


def test_little_memory_means_fewer_planes_and_too_little_one_line(monkeypatch):
    asked = config(methods=("Alg1/H",), device="cuda")
    with_gpu(monkeypatch, memory_bytes=1.0)
    with pytest.raises(
        InputError, match=r"1e-09 GB of memory free, one plane .* device cpu"
    ) as said:
        map_window(recording(), asked)
    needed = float(re.search(r"needs (\S+) GB", str(said.value))[1]) * 1e9
    planes = with_gpu(monkeypatch, memory_bytes=1.2 * needed)
    check_same(map_window(recording(), config(methods=("Alg1/H",))), map_window(recording(), asked))
    assert 1 <= planes[0] < asked.planes
    with_gpu(monkeypatch, memory_bytes=needed)  # a tenth of it is never used
    with pytest.raises(InputError, match="one plane"):
        map_window(recording(), asked)


def test_auto_takes_the_gpu_and_says_so(caplog):
    assert choose_device("auto").kind == "cuda"
    assert f"device auto took the GPU {device.gpu().name}" in caplog.text


def test_sliding_windows_are_read_ahead_and_equal_those_of_the_cpu(tmp_path):
    about = RecordingInfo(name="points", path="-")
    maps = {}
    for name in ("cpu", "cuda"):
        asked = config(methods=("Alg1/H",), window_s=0.2, stride_s=0.1, device=name)
        map_windows(recording(150), tmp_path / name, asked, about, clouds=False)
        maps[name] = read_map(tmp_path / name)
    here, there = maps["cpu"].windows, maps["cuda"].windows
    assert len(here) == len(there) == 3
    for one, other in zip(here, there, strict=True):
        assert one.info.counts == other.info.counts
        assert (one.info.device, other.info.device) == ("cpu", device.gpu().name)
        np.testing.assert_allclose(
            other.depth_map("Alg1/H").depth_m, one.depth_map("Alg1/H").depth_m, rtol=1e-3
        )


def test_a_run_does_not_go_on_on_another_device(tmp_path, monkeypatch):
    about = RecordingInfo(name="points", path="-")
    asked = config(methods=("Alg1/H",), window_s=0.2, device="auto")
    map_windows(recording(60), tmp_path, asked, about, clouds=False)
    index = json.loads((tmp_path / "map.json").read_text())
    assert {window["device"] for window in index["windows"]} == {device.gpu().name}
    said = re.escape(f"was mapped on {device.gpu().name}, not cpu: choose")
    monkeypatch.setattr(platform, "missing", lambda: "it is gone")
    with pytest.raises(InputError, match=said):
        map_windows(recording(60), tmp_path, asked, about, clouds=False)
