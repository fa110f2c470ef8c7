"""What the page's script reads is what the maps hold."""

import base64
import json
import zlib
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eventsweep.eval.figures.colormaps import depth_scale, error_scale
from eventsweep.eval.report.viewer import half, packed, window_json
from eventsweep.eval.scoring.outlier_causes import CAUSES
from report_data import METHODS, window_data


def _unpacked(text, dtype):
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype)


def _data(window):
    scales = error_scale(20.0), depth_scale((0.5, 4.0))
    return json.loads(window_json(window, list(METHODS), *scales))


@given(hnp.arrays(np.uint8, st.integers(0, 300)))
def test_packing_loses_nothing(values):
    np.testing.assert_array_equal(_unpacked(packed(values), np.uint8), values)


@given(st.floats(0.01, 5000.0))
def test_half_precision_is_finer_than_what_is_shown(depth_m):
    assert abs(float(half(np.array([depth_m]))[0]) - depth_m) <= 5e-4 * depth_m
    assert half(np.array([1e9, -1e9])).tolist() == [65504, -65504]  # its largest


def test_masks_depths_and_confidence_come_back():
    window = window_data("w000", 0)
    data = _data(window)
    assert [one["position"] for one in data["methods"]] == list(range(len(METHODS)))
    for method, one in zip(window.methods, data["methods"], strict=True):
        bits = np.unpackbits(_unpacked(one["mask"], np.uint8), bitorder="little")
        mask = bits[: method.mask.size].reshape(method.mask.shape).astype(bool)
        np.testing.assert_array_equal(mask, method.mask)
        np.testing.assert_allclose(_unpacked(one["depth"], "<f2"), method.depth_m[mask], rtol=5e-4)
        np.testing.assert_allclose(
            _unpacked(one["votes"], "<f2"), method.confidence[mask], rtol=5e-4, atol=1e-6
        )


def test_what_is_not_known_or_of_another_size_is_left_out():
    data = _data(replace(window_data("w000", 0, truth=False), camera=None))
    assert not {"truth", "frame", "camera"} & data.keys()
    assert "frame" not in _data(replace(window_data("w000", 0), frame=np.zeros((5, 5), np.uint8)))


def test_causes_of_bad_pixels_come_back():
    window = window_data("w000", 0)
    assert "causes" not in _data(window)
    causes = np.random.default_rng(0).integers(0, 1 + len(CAUSES), window.methods[0].mask.shape)
    first = replace(window.methods[0], causes=causes.astype(np.uint8))
    data = _data(replace(window, methods=(first, *window.methods[1:])))
    assert [name for name, _ in data["causes"]] == [name.replace("_", " ") for name in CAUSES]
    np.testing.assert_array_equal(
        _unpacked(data["methods"][0]["causes"], np.uint8), causes[first.mask]
    )
    assert "causes" not in data["methods"][1]
