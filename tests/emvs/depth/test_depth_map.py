import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_sweep
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth import neighbours_kernels
from eventsweep.emvs.depth.depth_map import (
    confidence_mask,
    eight_bits,
    extract,
    masked_median,
    without_border,
)
from eventsweep.emvs.dsi.maxima import Maximum
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_planes
from point_world import pinhole
from refusals import refused

CONFIG = MapperConfig()


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1), kernel_px=st.sampled_from([1, 3, 5, 15]),
    share=st.sampled_from([0.0, 0.1, 0.6, 1.0]), whole=st.booleans(),
)  # fmt: skip
def test_masked_median_equals_twin(seed, kernel_px, share, whole):
    rng = np.random.default_rng(seed)
    values = rng.uniform(0, 99, (11, 14)).astype(np.float32)
    values = np.round(values / 9) if whole else values
    mask = rng.random(values.shape) < share
    np.testing.assert_array_equal(
        masked_median(values, mask, kernel_px), naive_sweep.masked_median(values, mask, kernel_px)
    )


def test_confidence_is_scaled_by_its_maximum_or_as_told():
    confidence = np.array([[0, 5, 10]], np.float32)
    assert eight_bits(confidence, 0).tolist() == [[0, 128, 255]]
    assert eight_bits(confidence, 20).tolist() == [[0, 64, 128]]
    assert eight_bits(confidence, 5).tolist() == [[0, 128, 255]]
    assert not eight_bits(np.zeros((2, 2), np.float32), 0).any()


def test_a_peak_stands_out_and_a_plateau_does_not():
    confidence = np.ones((15, 15), np.float32)
    confidence[7, 7] = 10
    mask = confidence_mask(confidence, CONFIG)
    assert mask.sum() == 1
    assert mask[7, 7]


def test_threshold_is_strictly_monotone_in_c():
    confidence = np.random.default_rng(1).exponential(5, (40, 40)).astype(np.float32)
    kept = [confidence_mask(confidence, MapperConfig(threshold_c=c)).sum() for c in (-20, 0, 7, 30)]
    assert kept == sorted(kept, reverse=True)
    assert kept[0] > kept[-1] > 0


def test_no_votes_no_mask_even_with_a_negative_c():
    confidence = np.zeros((20, 20), np.float32)
    assert not confidence_mask(confidence, MapperConfig(threshold_c=-5)).any()


def test_border_is_removed_on_all_four_sides():
    mask = np.ones((6, 8), bool)
    inner = without_border(mask, 2)
    assert inner.sum() == 2 * 4
    assert inner[2:4, 2:6].all()
    assert without_border(mask, 0).all()
    assert not without_border(mask, 3).any()
    assert not without_border(mask, 99).any()
    assert mask.all()


def test_depth_is_finite_everywhere_and_interpolated_where_asked():
    camera = pinhole(20, 16)
    rho = inverse_depth_planes(0.5, 5, 10)
    shape = (16, 20)
    value = np.zeros(shape, np.float32)
    value[5:11, 5:15:3] = 9
    plane = np.full(shape, 4, np.int16)
    maximum = Maximum(value, plane, value * 0.5, value * 0.75, 10)
    view = ReferenceView(1, np.eye(4), camera, rho)
    step = (1 / 0.5 - 1 / 5) / 9
    for interpolate, shift in ((True, 0.5 * 0.25 / 0.75), (False, 0)):
        config = MapperConfig(interpolate=interpolate)
        depth = extract("Alg1/H", maximum, view, config)
        assert depth.points > 0
        assert np.isfinite(depth.depth_m).all()
        assert depth.depth_m.dtype == depth.confidence.dtype == np.float32
        np.testing.assert_allclose(1 / depth.depth_m[depth.mask], 2 - (4 + shift) * step, rtol=1e-5)
        np.testing.assert_array_equal(depth.argmax, plane)


@pytest.mark.parametrize("kernel_px", [1, 3, 5])
def test_the_scratch_of_the_median_holds_a_whole_window(monkeypatch, kernel_px):
    """Compiled, one that is too small is written past its end, which no number need show."""
    interpreted = neighbours_kernels.masked_median.py_func
    monkeypatch.setattr(neighbours_kernels, "masked_median", interpreted)
    values = np.arange(49, dtype=np.float32).reshape(7, 7)
    expected = naive_sweep.masked_median(values, values >= 0, kernel_px)
    np.testing.assert_array_equal(masked_median(values, values >= 0, kernel_px), expected)


@pytest.mark.parametrize(("values", "words"), [
    ({"planes": 1}, "planes"), ({"min_depth_m": 0}, "min_depth_m"),
    ({"min_depth_m": -1.0}, "min_depth_m"), ({"max_depth_m": float("nan")}, "max_depth_m"),
    ({"min_depth_m": 2, "max_depth_m": 1}, "depth range 2..1 m"),
    ({"min_depth_m": 2, "max_depth_m": 2}, "depth range"),
    ({"threshold_kernel_px": 4}, "odd"), ({"focus_threshold_kernel_px": 6}, "odd"),
    ({"threshold_kernel_px": 1}, "greater than or equal to 3"),
    ({"median_px": 6}, "odd"), ({"duration_s": 0}, "duration_s"), ({"methods": ()}, "methods"),
    ({"compatibility": "emvs"}, "mcemvs"), ({"plane": 100}, "plane"),
    ({"view_cx_px": float("nan")}, "view_cx_px"), ({"view_cy_px": float("inf")}, "view_cy_px"),
    ({"view_cx_px": 1e9}, "view_cx_px"), ({"view_focal_y_px": 0}, "view_focal_y_px"),
    ({"view_focal_y_px": -5}, "view_focal_y_px"), ({"view_width_px": 1}, "view_width_px"),
    ({"reference_shift": 1.5}, "reference_shift"), ({"spacing": "log"}, "spacing"),
    ({"reference": "end", "reference_s": 0.1}, "leave one of them out"),
    ({"compatibility": "mcemvs", "spacing": "linear"}, "set spacing inverse"),
    ({"compatibility": "mcemvs", "polarity": "separate"}, "set polarity both"),
    ({"compatibility": "mcemvs", "voting": "nearest"},
     "voting nearest is not supported: set voting bilinear"),
    ({"window_s": 0.1, "window_events": 100}, "leave one of them out"),
    ({"stride_s": 0.1}, "stride_s without window_s"),
    ({"window_s": 0.1, "stride_events": 100}, "stride_events without window_events"),
    ({"window_s": 0.1, "reference_s": 0.1}, "reference_s is for a single window"),
    ({"focus_measure": "dog", "focus": {"measure": "dog"}},
     r"focus_measure and focus\.measure are the same"),
])  # fmt: skip
def test_impossible_configurations_are_refused(values, words):
    refused(words, MapperConfig, **values)


def test_every_parameter_is_described_and_the_configuration_is_frozen():
    assert all(field.description for field in MapperConfig.model_fields.values())
    with pytest.raises(InputError, match="planes=3"):
        CONFIG.planes = 3


def test_one_method_may_stand_alone():
    assert MapperConfig(methods="Alg1/H").methods == ("Alg1/H",)
