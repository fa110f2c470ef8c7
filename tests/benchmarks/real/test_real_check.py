"""The check on real events: its truth, its second camera and its plane, where all are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from frame_depth import FrameDepth, depth_from_frames
from places import SHARED
from real_check import _BOARD_DEPTH_M, Sample, Scores, _held, board_residual, report, samples
from slid_pair import SlidPair

SLIDER = SHARED / "data" / "slider_depth"
CAMERA = Camera(64, 48, 80.0, 80.0, 31.5, 23.5)
POINTS_M = np.random.default_rng(3).uniform((-0.2, -0.2, 0.8), (0.8, 0.2, 1.6), (400, 3))


def texture(x_m, y_m):
    """Something that no two places share."""
    waves = np.random.default_rng(0).uniform(-60, 60, (30, 2))
    return 128 + 8 * sum(np.sin(a * x_m + b * y_m + k) for k, (a, b) in enumerate(waves))


def frame_at(x_m, depth_m):
    """A frame of a wall whose depth may grow with the column of its view at 0."""
    v, u = np.mgrid[:48, :64].astype(float)
    ray_x, ray_y = (u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px
    return texture(x_m + ray_x * depth_m, ray_y * depth_m).astype(np.float32)


@pytest.mark.parametrize("depth_m", [0.8, 1.0, 1.9])
def test_frames_of_a_wall_give_its_depth(depth_m):
    offsets_m = np.arange(-0.2, 0.21, 0.02) + 0.003
    found = depth_from_frames([frame_at(x, depth_m) for x in offsets_m], offsets_m, CAMERA.fx_px)
    assert found.known.mean() > 0.1
    error = np.abs(found.depth_m / depth_m - 1)[found.known]
    assert np.median(error) < 0.005
    assert error.max() < 0.03


class Slider:
    """One camera that slides past points, each of which makes an event wherever it is a pixel on.

    The motion is not even: it stands still, then gets faster.
    """

    name, depth_range_m = "slider", (0.5, 2.0)

    def __init__(self, begins_at_m=0.0, turned=0.0):
        t_us = np.arange(0, 1_000_001, 10_000)
        x_m = begins_at_m + 0.6 * np.maximum(t_us / 1e6 - 0.05, 0) ** 1.5
        quats = np.tile([0.0, np.sin(turned / 2), 0.0, np.cos(turned / 2)], (len(t_us), 1))
        positions = np.stack([x_m, 0 * x_m, 0 * x_m], axis=1)
        self.trajectory = Trajectory(t_us, positions, quats)
        self.rig = Rig("one", (CAMERA,), (np.eye(4),))
        self._events = self._seen(t_us, x_m)

    def _seen(self, t_us, x_m):
        found = []
        for px, py, pz in POINTS_M:
            row = round(CAMERA.fy_px * py / pz + CAMERA.cy_px)
            for column in range(64):
                at_m = px - (column - CAMERA.cx_px) / CAMERA.fx_px * pz
                if 0 <= row < 48 and x_m[6] < at_m < x_m[-1]:
                    found.append((round(float(np.interp(at_m, x_m[5:], t_us[5:]))), column, row))
        t, x, y = np.array(sorted(found)).T
        return Events(x.astype("u2"), y.astype("u2"), t.astype("i8"), np.zeros(len(t), "u1"))

    def event_span_us(self, camera):
        return int(self._events.t_us[0]), int(self._events.t_us[-1])

    def events(self, camera, t0_us, t1_us):
        return self._events.between(t0_us, t1_us)

    def frame(self, camera, t_us):
        return None


def test_the_second_camera_sees_what_a_true_one_would():
    """Law: restamped events of a camera at x + b are those of a slider that begins b farther."""
    pair, true = SlidPair(Slider(), 0.1), Slider(begins_at_m=0.1)
    t0_us, t1_us = 200_000, 700_000
    made, wanted = pair.events(1, t0_us, t1_us), true.events(0, t0_us, t1_us)
    rows = [np.stack([e.x, e.y, np.rint(e.t_us / 200)], 1).astype(int) for e in (made, wanted)]
    same = set(map(tuple, rows[0])) & {
        (x, y, t + k) for x, y, t in rows[1].tolist() for k in (-1, 0, 1)
    }
    assert len(made) > 500
    assert abs(len(made) - len(wanted)) <= 0.01 * len(wanted)
    assert len(same) > 0.97 * len(set(map(tuple, rows[0])))


def test_the_pair_maps_points_where_they_are():
    config = MapperConfig(methods=("Alg1/H",), start_s=0.3, duration_s=0.4, threshold_c=2)
    result = map_window(SlidPair(Slider(), 0.1), config)
    depth = result.depth_maps["Alg1/H"]
    x_m = result.view.T_world_rv[0, 3]
    error = []
    for v, u in np.argwhere(depth.mask):
        rho = [
            1 / pz for px, py, pz in POINTS_M
            if abs((px - x_m) / pz * 80 + 31.5 - u) < 1 and abs(py / pz * 80 + 23.5 - v) < 1
        ]  # fmt: skip
        if rho:
            error.append(min(abs(1 / depth.depth_m[v, u] - r) for r in rho))
    assert len(error) > 50
    assert np.median(error) < 0.1  # 1/m: 0.8 px of disparity


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_the_residual_of_a_tilted_board_is_its_noise(noise_m):
    result = map_window(SlidPair(Slider(), 0.1), MapperConfig(methods=("Alg1/H",), duration_s=0.3))
    camera = Camera(240, 180, 335.0, 335.0, 120.0, 90.0)
    v, u = np.mgrid[:180, :240].astype(float)
    rho = 1 / _BOARD_DEPTH_M + 0.05 * (u - 120) / 335 + 0.02 * (v - 90) / 335
    noise = np.random.default_rng(0).normal(0, noise_m, rho.shape)
    depth_m = (1 / rho + noise).astype(np.float32)
    board = replace(result.depth_maps["Alg1/H"], depth_m=depth_m, camera=camera)
    found = board_residual(board, np.ones(rho.shape, bool), 0.5)
    assert found == pytest.approx(0.6745 * noise_m / _BOARD_DEPTH_M, rel=0.1, abs=1e-4)


def test_tables_say_what_was_found():
    def scores(size):
        held = (float("nan"),) * 2 if size > 0.15 else (0.7, 0.8)
        return Scores(100, 90, size, 2 * size, 0.01, 3 * size, *held)

    names = "Alg1/H", "DERD/H", "EMVS/cam0", "Focus/H", "Learned/H", "Focus/cam0", "Learned/cam0"
    by_name = {name: scores(0.2 * 0.8**k) for k, name in enumerate(names)}
    text = report([Sample(0.45, 0.2, by_name), Sample(0.6, 0.4, by_name)])
    assert "| `Focus/H` | 0.51 | 0.51 | 1.00 | 30.72–30.72 | 70–70 | 80–80 |" in text
    assert "| `Alg1/H` | 1.00 | 1.00 | 1.00 | 60.00–60.00 | none stated | none stated |" in text
    assert len({line.count("|") for line in text.splitlines() if line}) == 1


@pytest.mark.parametrize("sigma", [0.002, 0.01])
def test_a_truth_that_errs_too_is_joined_to_the_band(sigma):
    """Law: with both errors normal, the joined band holds 68 %, the stated one alone fewer."""
    rng, shape = np.random.default_rng(1), (120, 160)
    left, right = rng.normal(0, np.sqrt(2) * sigma, (2, *shape))
    nothing, known = np.zeros(shape, np.float32), np.ones(shape, np.bool_)
    truth = FrameDepth(nothing + 1, known, np.abs(left - right).astype(np.float32), nothing)
    assert truth.own_error == pytest.approx(0.994 * sigma, rel=0.05)
    relative = np.abs(rng.normal(0, 0.005, shape) + (left + right) / 2).astype(np.float32)
    result = map_window(SlidPair(Slider(), 0.1), MapperConfig(methods=("Alg1/H",), duration_s=0.3))
    band = np.full(shape, 0.994 * 0.005, np.float32)
    stated = replace(result.depth_maps["Alg1/H"], depth_m=nothing + 1, error_m=band)
    within, both = _held(stated, relative[known], known, truth.own_error)
    assert both == pytest.approx(0.68, abs=0.02)
    assert within < both - 0.03


@pytest.mark.slow
def test_fusion_holds_on_real_events():
    if not SLIDER.is_dir():
        pytest.skip("needs ../shared/data, which is not part of the project")
    (sample, truth, _), *_ = samples(EventCameraDataset(SLIDER), (0.45,), (0.4,), 100)
    assert truth.known.mean() > 0.1
    for name in ("Focus/H", "Learned/H"):
        assert sample.ratio(name, "median") < 0.6, name
        assert sample.scores[name].over < 0.01, name
