"""The mapper in the compatibility setting against the method authors' implementation.

Golden numbers: `mcemvs_small.npz`, made by the core of dvs_mcemvs (main branch of June 2025), run
stand-alone on 160x120 events with 64 planes from 0.5 to 5 m.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.depth.depth_map import confidence_mask, eight_bits, masked_median
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.methods import methods_by_name
from eventsweep.emvs.reference_view import mcemvs_planes
from volumes import dsi, event_rays

CONFIG = MapperConfig(compatibility="mcemvs", planes=64, threshold_c=5)
# In the outermost pixels single votes are accepted or rejected by rounding.
INNER = np.s_[..., 2:-2, 2:-2]
NAMES = {"Alg1/min": "min", "Alg1/H": "HM", "Alg1/G": "GM", "Alg1/A": "AM", "Alg1/RMS": "RMS",
         "Alg1/max": "max"}  # fmt: skip


@dataclass(frozen=True)
class Swept:
    golden: dict
    volumes: np.ndarray
    counts: tuple[VoteCounts, ...]
    maxima: dict


@pytest.fixture(scope="module")
def swept(shared_reference):
    with np.load(shared_reference / "mcemvs_small.npz") as file:
        golden = dict(file)
    camera = Camera(160, 120, *(float(golden[name]) for name in ("fx", "fy", "cx", "cy")))
    rho = mcemvs_planes(0.5, 5, 64)
    volumes, counts = zip(
        *(dsi(side_rays(golden, side, camera), rho, 160, 120) for side in ("left", "right")),
        strict=True,
    )
    chosen = methods_by_name(tuple(NAMES), 2, mcemvs=True)
    maxima = RunningMaxima([method.fusion for method in chosen], 160, 120)
    stacked = np.stack(volumes)
    maxima.update(stacked.reshape(2, 64, -1), 64)
    return Swept(golden, stacked, counts, {m.name: maxima.of(k) for k, m in enumerate(chosen)})


def poses(golden, side):
    rows = golden[f"{side}_poses"]
    return Trajectory(np.round(rows[:, 0] * 1e6).astype(np.int64), rows[:, 1:4], rows[:, 4:8])


def side_rays(golden, side, camera):
    events = Events(*(golden[f"{side}_{column}"] for column in "xytp"))
    t_ref_us = round(float(golden["t_reference_s"]) * 1e6)
    T_world_rv = poses(golden, "left").at(t_ref_us)
    return event_rays(
        events, camera, np.eye(4), poses(golden, side), T_world_rv, camera, packets=True
    )


def test_planes(swept):
    np.testing.assert_allclose(1 / mcemvs_planes(0.5, 5, 64), swept.golden["depths_m"], rtol=1e-6)


def test_volumes(swept):
    golden = np.stack([swept.golden["dsi_left"], swept.golden["dsi_right"]])
    assert np.abs(swept.volumes - golden)[INNER].max() < 1e-3
    assert golden.max() > 80


def test_sum_of_a_volume_is_its_number_of_votes(swept):
    for volume, counts in zip(swept.volumes, swept.counts, strict=True):
        assert volume.sum(dtype=np.float64) == pytest.approx(counts.counted, abs=0.01)


@pytest.mark.parametrize("method", NAMES)
def test_argmax_and_confidence(swept, method):
    maximum, name = swept.maxima[method], NAMES[method]
    same = maximum.plane == swept.golden[f"argmax_{name}"]
    assert same[INNER].mean() >= 0.999
    confidence = swept.golden[f"confidence_{name}"]
    assert np.abs(maximum.value - confidence)[INNER].max() < 1e-3


def test_confidence_in_eight_bits(swept):
    confidence = swept.golden["confidence_HM"]
    grey = eight_bits(confidence, 0)
    grey[0, 0] = 0
    np.testing.assert_array_equal(grey, swept.golden["confidence8_HM"])


def test_mask(swept):
    mask = confidence_mask(swept.maxima["Alg1/H"].value, CONFIG)
    golden = swept.golden["mask_HM"].astype(bool)
    assert 1000 < golden.sum() < 5000
    assert (mask != golden).sum() <= 0.001 * golden.sum()


@pytest.mark.parametrize("kernel_px", [5, 15])
def test_median(swept, kernel_px):
    mask = confidence_mask(swept.maxima["Alg1/H"].value, CONFIG)
    plane = swept.maxima["Alg1/H"].plane.astype(np.float32)
    median = masked_median(plane, mask, kernel_px)
    both = mask & swept.golden["mask_HM"].astype(bool)
    assert (median == swept.golden[f"median{kernel_px}_HM"])[both].mean() >= 0.999


def test_the_maps_show_the_scene(swept):
    """Against the simulator's depth, not the other program: half the pixels within 1.5 planes."""
    rho = mcemvs_planes(0.5, 5, 64)
    mask = confidence_mask(swept.maxima["Alg1/H"].value, CONFIG)
    plane = masked_median(swept.maxima["Alg1/H"].plane.astype(np.float32), mask, 5)
    error = np.abs(rho[plane.astype(int)] - 1 / swept.golden["depth_gt_m"])[mask]
    assert np.median(error) < 1.5 * (rho[1] - rho[0])
