"""Frames in an event camera's pixels on a simulated scene, whose every camera has exact depth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

import eventsweep as es
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.align.depths import depth_source
from eventsweep.plugins.align.rig import Mounted, set_up
from eventsweep.plugins.align.views import View, inverse, shown_in, view_places
from eventsweep.plugins.align.views_kernels import OCCLUDED, SEEN

EYE = Camera(173, 130, 112.9, 113.1, 86.2, 65.4, "radtan", (-0.1, 0.03, 0, 0))
GREY = Camera(240, 180, 150.3, 150.9, 122.1, 88.2, "radtan", (-0.17, 0.09, 4e-4, -3e-4))
SECONDS, T_US = 0.3, 150_000


def placed(*place_m):
    T_body_cam = np.eye(4)
    T_body_cam[:3, 3] = place_m
    return T_body_cam


T_BODY_GREY = placed(0.05, -0.03, 0.01)


@pytest.fixture(scope="module", params=["boxes", "desk"])
def recording(request, tmp_path_factory):
    """Two event cameras, a frame camera, and a third event camera in its place for exact depth."""
    T_body_cam = (np.eye(4), placed(0.1, 0, 0), T_BODY_GREY)
    frames = Rig("frames", (GREY,), (T_BODY_GREY,), ("grey",))
    rig = Rig("three", (EYE, EYE, GREY), T_body_cam, ("eye", "right", "grey events"), frames)
    config = es.SimConfig(
        duration_s=SECONDS, truth_times_s=(T_US / 1e6,), frames={"rate_hz": 20, "exposure_us": 2000}
    )
    out = tmp_path_factory.mktemp("simulated") / request.param
    es.simulate(request.param, out, config, seed=3, rig=rig)
    return es.open_recording(out)


@pytest.fixture
def setup(recording):
    """As a user has it: depth in the event cameras only."""
    truth = depth_source(recording, None)
    eyes = replace(truth, read=lambda t_us: truth.read(t_us)[:2])
    return set_up(recording, eyes)


def grey_at(setup):
    return setup.view(Mounted("grey", GREY, T_BODY_GREY), T_US)


@pytest.mark.slow
def test_what_the_scene_hides_from_the_frame_camera_is_marked(recording, setup):
    """By the exact depth of a camera in its place, where that is the same all around a pixel."""
    eye, grey = setup.view(setup.event_camera, T_US), grey_at(setup)
    rho, grey_rho = setup.carried(eye, T_US), setup.carried(grey, T_US)
    _, mask = shown_in(eye, rho, np.ones(grey.shape, np.float32), grey, grey_rho)
    uv_px, there_rho = view_places(eye, rho, grey)
    column, row = np.moveaxis(np.rint(np.nan_to_num(uv_px, nan=-9)).astype(int), -1, 0)
    inside = (column >= 1) & (column < GREY.width_px - 1) & (row >= 1) & (row < GREY.height_px - 1)
    exact = inverse(recording.truth_depth_m(2, T_US), sky=True)
    at = row.clip(0, GREY.height_px - 1), column.clip(0, GREY.width_px - 1)
    least, most = minimum_filter(exact, 3)[at], maximum_filter(exact, 3)[at]
    hidden = inside & (rho >= 0) & (there_rho < 0.95 * least)
    free = inside & (np.abs(there_rho / np.maximum(least, 1e-9) - 1) < 0.01) & (most < 1.01 * least)
    assert hidden.sum() > 50
    assert (mask[hidden] == OCCLUDED).mean() >= 0.99
    assert (mask[free] == SEEN).mean() >= 0.99


@pytest.mark.slow
def test_by_the_depth_of_focus_a_frame_falls_within_three_tenths_of_a_pixel(recording, setup):
    """Of its points, against their places by exact depth."""
    found = es.map_window(recording, es.MapperConfig(methods=("Focus/H",))).depth_maps["Focus/H"]
    assert found.t_us == T_US
    true_m = recording.truth_view_depth_m(0, T_US)
    known = found.mask & np.isfinite(true_m)
    view, grey = View(found.camera, found.T_world_rv), grey_at(setup)
    places_px = [
        view_places(view, inverse(np.where(known, depth_m, np.nan)), grey)[0][known]
        for depth_m in (found.depth_m, true_m)
    ]
    off_px = np.linalg.norm(places_px[0] - places_px[1], axis=-1)
    assert known.sum() > 300
    assert np.nanmedian(off_px) < 0.15
    assert np.nanquantile(off_px, 0.8) < 0.3
