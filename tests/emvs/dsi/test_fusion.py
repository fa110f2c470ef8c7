import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_sweep
from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.dsi.fusion import Fusion, fuse
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.methods import known_methods, methods_by_name
from refusals import refused
from volumes import FUSIONS

ORDER = ("min", "H", "G", "A", "RMS", "max")


def votes(seed, cameras=2, planes=3, height=4, width=9):
    rng = np.random.default_rng(seed)
    values = rng.exponential(5, (cameras, planes, height, width)).astype(np.float32)
    values[rng.random(values.shape) < 0.2] = 0
    return values


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), cameras=st.integers(1, 5))
def test_kernels_equal_twin(seed, cameras):
    volumes = votes(seed, cameras)
    for name, function in FUSIONS.items():
        expected = np.apply_along_axis(lambda x, n=name: naive_sweep.fuse(n, x), 0, volumes)
        np.testing.assert_allclose(function(volumes), expected, rtol=2e-6, err_msg=name)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), cameras=st.integers(1, 5))
def test_order_law(seed, cameras):
    """Law (paper, Eq. 1): min <= H <= G <= A <= RMS <= max, to a rounding."""
    fused = [FUSIONS[name](votes(seed, cameras)) for name in ORDER]
    for smaller, larger in itertools.pairwise(fused):
        assert np.all(smaller <= larger * np.float32(1 + 1e-6))


def test_permuting_cameras_changes_nothing():
    volumes = votes(7, 3)
    for name, function in FUSIONS.items():
        for order in itertools.permutations(range(3)):
            np.testing.assert_allclose(
                function(volumes[list(order)]), function(volumes), rtol=1e-6, err_msg=name
            )


def test_reference_harmonic_mean_has_its_eps():
    volumes = votes(3)
    a, b = volumes
    np.testing.assert_allclose(
        fuse(Fusion(fusion_kernels.HARMONIC_EPS), volumes),
        2 * a * b / (a + b + np.float32(0.1)),
        rtol=1e-6,
    )


@pytest.mark.parametrize("code", [42, -1, len(fusion_kernels.CODES)])
def test_an_unknown_code_is_refused(code):
    for codes in ({"code": code}, {"outer": code}):
        refused(f"fusion code {code}: needs 0 to 6", Fusion, **codes)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), planes=st.integers(2, 9), batch=st.integers(1, 4))
def test_fold_equals_twin_whatever_the_batches(seed, planes, batch):
    volumes = np.round(votes(seed, 2, planes))  # rounding makes ties
    chosen = known_methods(2)
    maxima = fold(volumes, [method.fusion for method in chosen], batch)
    for k, method in enumerate(chosen):
        fused = fuse(Fusion(method.fusion.code), volumes)
        got = maxima.of(k)
        position = got.position()
        for y, x in np.ndindex(fused.shape[1:]):
            value, plane, expected = naive_sweep.maximum(fused[:, y, x])
            assert (got.value[y, x], got.plane[y, x]) == (value, plane)
            assert position[y, x] == pytest.approx(expected, abs=1e-4)


def fold(volumes, chosen, batch):
    cameras, planes, height, width = volumes.shape
    flat = volumes.reshape(cameras, planes, height * width)
    maxima = RunningMaxima(chosen, width, height)
    for first in range(0, planes, batch):
        part = np.zeros((cameras, batch, height * width + 5), np.float32)
        count = min(batch, planes - first)
        part[:, :count, : height * width] = flat[:, first : first + count]
        maxima.update(part, count)
    return maxima


def test_the_shared_volume_takes_the_place_of_the_first_and_nothing_else_changes():
    votes = np.random.default_rng(4).gamma(0.5, 9, (2, 3, 35)).astype(np.float32)
    shared = Fusion(fusion_kernels.HARMONIC)
    every = (shared, *(Fusion(fusion_kernels.CAMERA + camera) for camera in (0, 1)))
    alone, sharing = (RunningMaxima(every, 6, 5, shared_volume=s) for s in (None, shared))
    left = votes.copy()
    alone.update(votes.copy(), 3)
    sharing.update(left, 3)
    fused = fuse(shared, votes[:, :, :30].reshape(2, 3, 5, 6))
    np.testing.assert_array_equal(left[0, :, :30].reshape(3, 5, 6), fused)
    np.testing.assert_array_equal(left[0, :, 30:], votes[0, :, 30:])
    np.testing.assert_array_equal(left[1], votes[1])
    for k in range(len(every)):
        np.testing.assert_array_equal(alone.of(k).value, sharing.of(k).value)
        np.testing.assert_array_equal(alone.of(k).plane, sharing.of(k).plane)


def test_method_names():
    two = ["Alg1/min", "Alg1/H", "Alg1/G", "Alg1/A", "Alg1/RMS", "Alg1/max", "EMVS/cam0",
           "EMVS/cam1"]  # fmt: skip
    assert [method.name for method in methods_by_name(("all",), 2)] == [*two, "Focus/H"]
    assert [method.name for method in methods_by_name(("all",), 2, mcemvs=True)] == two
    assert [method.name for method in methods_by_name(("EMVS/cam1", "Alg1/H", "Alg1/H"), 2)] == [
        "Alg1/H", "EMVS/cam1",
    ]  # fmt: skip
    assert [method.name for method in methods_by_name(("all",), 1)] == [
        "EMVS/cam0", "Focus/cam0",
    ]  # fmt: skip
    assert file_name("Alg1/H") == "Alg1-H"
    assert "harmonic" in methods_by_name(("Alg1/H",), 2)[0].summary


@pytest.mark.parametrize("spoil", ["negative", "nan", "shape"])
def test_a_users_function_must_return_votes(spoil):
    """Votes are 0 or more; what is not would win or lose every maximum unseen."""

    def function(volumes):
        fused = volumes.mean(axis=(0, 1))  # cameras, intervals
        if spoil == "shape":
            return fused[:1]
        fused[1, 2, 3] = {"negative": -0.5, "nan": np.nan}[spoil]
        return fused

    right = Fusion(function=lambda volumes: volumes.mean(axis=(0, 1)), owner="mine")
    np.testing.assert_allclose(fuse(right, votes(1)), votes(1).mean(axis=0), rtol=1e-6)
    with pytest.raises(InputError, match=r"function of mine .* at least 0 and none NaN"):
        fuse(Fusion(function=function, owner="mine"), votes(1))
