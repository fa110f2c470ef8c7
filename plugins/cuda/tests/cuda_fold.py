"""Fusion, maxima and focus on a GPU, or its simulator: run by `test_cuda.py`, which says how."""

import numpy as np
import pytest

import naive_methods
from eventsweep.emvs.dsi.focus_measures import MEASURES
from eventsweep.emvs.dsi.fusion import FusionTables, Target
from eventsweep.emvs.dsi.maxima import FocusMaxima, RunningMaxima
from eventsweep.emvs.methods import ALG2, known_methods, methods_by_name
from eventsweep.plugins.cuda import arrays, device, fusion_kernels, maxima
from eventsweep.plugins.cuda.maxima import DeviceMaxima
from tiers import often

if device.missing():
    pytest.skip(device.missing(), allow_module_level=True)

W, H, PLANES = 6, 5, 5


def random_votes(seed, volumes, planes=PLANES, zeros=0.3):
    rng = np.random.default_rng(seed)
    votes = rng.gamma(1, 2, (volumes, planes, H * W)).astype(np.float32)
    votes[rng.random(votes.shape) < zeros] = 0
    return np.ascontiguousarray(np.rint(votes * 4) / 4, np.float32)  # with ties


def fused_there(fusion, votes, polarities=1):
    tables = FusionTables.of((fusion,), len(votes), polarities)
    out = arrays.empty(votes.shape[1:], np.float32)
    fusion_kernels.fuse[device.strided(votes.shape[2])](
        *map(arrays.up, (tables.codes, tables.sizes, tables.which)), 0, arrays.up(votes),
        votes.shape[1], out,
    )  # fmt: skip
    return arrays.down(out)


@pytest.mark.parametrize("cameras", [2, 3])
def test_every_fusion_equals_the_slow_twin(cameras):
    votes = random_votes(0, cameras, 1)
    for method in known_methods(cameras):
        if method.family == "Focus":
            continue
        twin = [
            naive_methods.fuse(method.name, [[v] for v in votes[:, 0, c]]) for c in range(H * W)
        ]
        np.testing.assert_allclose(
            fused_there(method.fusion, votes)[0], twin, rtol=1e-5, err_msg=str(method)
        )


@pytest.mark.parametrize(
    "name", ["Alg2/AtHc@2", "Alg2/HtGc@3", "Alg2/RMScmint@2", "Alg2/maxtHc@4~"]
)
def test_fusions_of_fusions_equal_the_slow_twin(name):
    fusion = ALG2.build(name, False).fusion
    n = fusion.split.intervals
    votes = random_votes(1, 2 * n, 1, zeros=0.1)
    twin = [naive_methods.fuse(name, votes[:, 0, c].reshape(2, n).tolist()) for c in range(H * W)]
    np.testing.assert_allclose(fused_there(fusion, votes)[0], twin, rtol=1e-5)


def test_polarities_are_fused_apart_and_summed():
    fusion = known_methods(2)[1].fusion
    votes = random_votes(2, 4, 1)
    apart = [fused_there(fusion, np.ascontiguousarray(part)) for part in votes.reshape(2, 2, 1, -1)]
    np.testing.assert_allclose(fused_there(fusion, votes, 2), sum(apart), rtol=1e-6)


@pytest.mark.parametrize("batch", often([4], [1, 4, PLANES]))
def test_maxima_and_their_neighbours_equal_those_of_the_cpu(batch):
    votes = random_votes(3, 2)
    chosen = [Target(m.name, m.fusion) for m in known_methods(2) if m.family != "Focus"]
    fusions = [target.fusion for target in chosen]
    there = DeviceMaxima(FusionTables.of(fusions, 2), W, H, PLANES)
    here = RunningMaxima(fusions, W, H, planes=PLANES)
    for first in range(0, PLANES, batch):
        part = np.ascontiguousarray(votes[:, first : first + batch])
        there.update(arrays.up(part), part.shape[1])
        here.update(part, part.shape[1])
    for m, method in enumerate(chosen):
        mine, its = there.of(m), here.of(m)
        np.testing.assert_allclose(mine.value, its.value, rtol=1e-6)
        np.testing.assert_array_equal(mine.plane, its.plane, err_msg=method.name)
        np.testing.assert_allclose(mine.left, its.left, rtol=1e-6)
        np.testing.assert_allclose(mine.right, its.right, rtol=1e-6)
        np.testing.assert_allclose(mine.position(), its.position(), atol=1e-4)
        assert mine.plane.dtype == its.plane.dtype


@pytest.mark.parametrize("measure", often(["variance"], MEASURES))
def test_focus_equals_that_of_the_cpu(measure):
    methods = methods_by_name(("Alg1/H", "EMVS/cam1"), 2)
    compare_focus([Target(m.name, m.fusion, measure) for m in methods], random_votes(4, 2), 2)


def test_camera_maxima_sum_polarities_and_sub_intervals():
    fusion = ALG2.build("Alg2/AtHc@2", False).fusion
    compare_focus(
        [Target("Focus/x", fusion, "variance", per_camera=True)],
        random_votes(5, 8),
        2,
        polarities=2,
    )


def compare_focus(chosen, votes, cameras, polarities=1):
    here = FocusMaxima(chosen, cameras, W, H, 0.7, planes=PLANES, polarities=polarities)
    there = maxima.DeviceFocusMaxima(
        chosen, cameras, len(votes), 4, W, H, 0.7, planes=PLANES, polarities=polarities
    )
    for first in range(0, PLANES, 4):
        part = np.ascontiguousarray(votes[:, first : first + 4])
        here.update(part.reshape(*part.shape[:2], H, W))
        there.update(arrays.up(part), part.shape[1])
    mine, its = there.result(), here.result()
    assert list(mine) == list(its)
    for name, found in its.items():
        assert len(mine[name].camera_maxima) == len(found.camera_maxima)
        pairs = zip(
            (mine[name].maximum, *mine[name].camera_maxima), (found.maximum, *found.camera_maxima),
            strict=True,
        )  # fmt: skip
        for one, other in pairs:
            np.testing.assert_allclose(one.value, other.value, rtol=1e-4, atol=1e-4)
            same = one.plane == other.plane
            assert same.mean() > 0.95  # ties within rounding
            np.testing.assert_allclose(
                one.position()[same], other.position()[same], atol=2e-2, err_msg=name
            )


def test_large_arrays_go_up_and_down_in_turns(monkeypatch):
    monkeypatch.setattr(arrays, "_BUFFER_BYTES", 64)
    for dtype in (np.uint8, np.float32, np.int64):
        array = np.arange(301 * 2).reshape(2, 301).astype(dtype)
        np.testing.assert_array_equal(arrays.down(arrays.up(array)), array)
    assert arrays.down(arrays.up(np.empty(0, np.float32))).shape == (0,)
