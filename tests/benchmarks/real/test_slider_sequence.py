"""The real slider as a sequence: its truth lies where its pixels look, and its verbs run."""

import numpy as np
import pytest

import slider_sequence
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.cli.main import main

LENS = Camera(64, 48, 60.0, 61.0, 31.5, 23.5, "radtan", (-0.3, 0.1, 0.0, 0.0))


def test_a_pixel_of_the_sensor_has_the_depth_of_its_own_ray():
    """Of a slanted wall: depth is linear in the pixel of the view, and known on its left only."""
    v, u = np.mgrid[:48, :64].astype(float)
    slope = 0.01
    view_m = np.where(u < 40, 2 + slope * u + slope * v, np.nan).astype(np.float32)
    rays = LENS.unproject(np.stack([u, v], -1))
    exact = 2 + slope * (rays[..., 0] * 60 + 31.5 + rays[..., 1] * 61 + 23.5)
    seen = slider_sequence.in_sensor(view_m, LENS)
    known = np.isfinite(seen)
    assert known.mean() > 0.5
    assert np.abs(seen - exact)[known].max() <= slope * 1.001  # half a pixel each way
    assert not known[rays[..., 0] * 60 + 31.5 > 40].any()
    assert not known[0, 0]  # beyond the view


def test_places_are_whole_milliseconds_after_the_first_event():
    t_us, x_m = np.array([4_321, 3_004_321]), np.array([0.0, 1.0])
    places_us = slider_sequence.places_us(t_us, x_m, 4_321)
    assert (np.diff(places_us) > 0).all()
    np.testing.assert_array_equal((places_us - 4_321) % 1000, 0)
    np.testing.assert_allclose(np.interp(places_us, t_us, x_m), sorted(slider_sequence.VIEWS_M))


@pytest.mark.slow
def test_the_slider_maps_and_scores_against_its_frames(shared_data, tmp_path):
    out = tmp_path / "slider"
    lines = slider_sequence.write(EventCameraDataset(shared_data / "slider_depth"), out)
    sequence = Sequence.open(out)
    (times_us, first_us) = sequence.truth_times_us(0), sequence.event_span_us(0)[0]
    assert len(lines) == 1 + len(times_us) == 1 + len(slider_sequence.VIEWS_M)
    assert float(lines[1].split()[-1]) < 1  # %
    at_s = (times_us[1] - first_us) / 1e6
    window = "--map.start-s", f"{at_s - 0.1}", "--map.duration-s", "0.2"
    maps = "--out", str(tmp_path / "maps"), "--map.reference-s", f"{at_s}", "--method", "Alg1/H"
    assert main(["map", str(out), *maps, *window, "--quiet"]) == 0
    assert main(["score", str(tmp_path / "maps"), "--quiet"]) == 0
    assert "median_error" in (tmp_path / "maps" / "results.csv").read_text("utf-8")
