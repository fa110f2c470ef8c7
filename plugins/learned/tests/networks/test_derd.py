"""DERD-Net: the compiled network against its definition and torch, its columns, and the method."""

import numba
import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import confidence_mask, without_border
from eventsweep.emvs.depth.kept_votes import LANES, KeptVotes
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, named, overview
from eventsweep.emvs.reference_view import inverse_depth_planes, linear_planes, mcemvs_planes
from eventsweep.plugins.learned.methods.derd import DERD
from eventsweep.plugins.learned.networks import derd
from eventsweep.plugins.learned.networks.derd import (
    LAYERS,
    NAME,
    PLANES,
    SIDE_PX,
    DepthRange,
    DerdNet,
    columns_of,
    derd_net,
    selecting,
    shapes,
)
from eventsweep.plugins.learned.networks.weights import Weights, packaged, write_weights
from lanes import in_blocks
from naive_derd import place
from point_world import fronto_parallel
from refusals import refused

CONFIG = MapperConfig(
    min_depth_m=0.5, max_depth_m=4.0, derd={"threshold_c": 7}, methods=("DERD/H",)
)


def random_arrays(seed, models=1):
    rng = np.random.default_rng(seed)
    return {
        name: rng.normal(0, 0.15, size).astype(np.float32) for name, size in shapes(models).items()
    }


def random_net(seed, models=1, uniform_in="linear"):
    return DerdNet(Weights(random_arrays(seed, models), {}, None), models, uniform_in)


def random_columns(seed, count):
    columns = np.random.default_rng(seed).gamma(0.5, 0.5, (count, PLANES, SIDE_PX, SIDE_PX))
    return (columns / columns.max(axis=(1, 2, 3), keepdims=True)).astype(np.float32)


def of_model(arrays, k):
    return {name: arrays[f"{k}.{name}"] for name in LAYERS}


def test_it_has_as_many_parameters_as_published():
    assert sum(int(np.prod(shape)) for shape in LAYERS.values()) == 70_913


@pytest.mark.parametrize("count", [1, LANES - 1, LANES + 3])
def test_the_compiled_network_is_its_definition(count):
    net, columns = random_net(count), random_columns(count + 1, count)
    found = net.places(in_blocks(columns), count)
    wanted = [place(of_model(net.weights.arrays, 0), column) for column in columns]
    np.testing.assert_allclose(found, wanted, atol=2e-4)
    assert np.ptp(wanted) > 1e-3 or count == 1


def test_of_two_models_the_mean_counts():
    net, columns = random_net(3, models=2), random_columns(4, 5)
    one, other = (
        [place(of_model(net.weights.arrays, k), column) for column in columns] for k in (0, 1)
    )
    assert np.abs(np.subtract(one, other)).min() > 1e-3
    found = net.places(in_blocks(columns), 5)
    np.testing.assert_allclose(found, np.mean([one, other], axis=0), atol=2e-4)


def test_torch_trains_the_network_that_runs():
    torch = pytest.importorskip("torch", reason="torch is an extra, [train]")
    from eventsweep.plugins.learned.training.network import DerdNetwork

    torch.manual_seed(0)
    trained, columns = DerdNetwork(), random_columns(5, 50)
    arrays = trained.arrays()
    assert {name: one.shape for name, one in arrays.items()} == shapes(1)
    with torch.no_grad():
        wanted = trained(torch.from_numpy(columns))
    found = DerdNet(Weights(arrays, {}, None), 1, "linear").places(in_blocks(columns), 50)
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_threads_and_neighbours_do_not_change_a_bit():
    net, columns, found = random_net(7), random_columns(8, 96), []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        found.append(net.places(in_blocks(columns), len(columns)))
    np.testing.assert_array_equal(found[0], found[1])
    assert net.places(in_blocks(columns[40:41]), 1)[0] == found[0][40]


@pytest.mark.parametrize("planes", [inverse_depth_planes, mcemvs_planes])
def test_the_range_of_planes_is_the_one_that_made_them(planes):
    """Also of the authors' planes, which run far to near and leave out the near end."""
    span = DepthRange.of(planes(0.6, 6.0, PLANES))
    assert span.near_m == pytest.approx(0.6, rel=1e-4)
    assert span.far_m == pytest.approx(6.0, rel=1e-4)


@pytest.mark.parametrize("uniform_in", ["linear", "inverse"])
def test_places_and_depths_are_each_others_inverse(uniform_in):
    span, depth_m = DepthRange(0.5, 4.0), np.array([0.5, 0.9, 2.2, 4.0])
    place_of = span.place(depth_m, uniform_in)
    assert (place_of[0], place_of[-1]) == (0, 1)
    np.testing.assert_allclose(span.depth_m(place_of, uniform_in), depth_m, rtol=1e-5)
    beyond = span.place(np.array([0.1, 9.0]), uniform_in)
    np.testing.assert_array_equal(beyond, [0, 1])
    np.testing.assert_allclose(span.depth_m(np.float32([-3, 2]), uniform_in), [0.5, 4.0])


def test_linear_places_are_even_in_depth_and_inverse_ones_in_inverse_depth():
    span, half = DepthRange(1.0, 3.0), np.float32([0.5])
    assert span.depth_m(half, "linear")[0] == pytest.approx(2.0)
    assert span.depth_m(half, "inverse")[0] == pytest.approx(1.5)


def with_derd(config, **values):
    return config.model_copy(update={"derd": config.derd.model_copy(update=values)})


class View:
    def __init__(self, rho):
        self.rho = rho


@pytest.mark.parametrize("far_first", [False, True])
def test_columns_are_all_planes_near_to_far_as_shares_of_their_largest(far_first):
    """Against the fused volume, whichever way its planes run."""
    rng, kept = np.random.default_rng(2), KeptVotes(2, PLANES, 12, 15)
    votes = rng.integers(1, 16, (2, PLANES, 12, 15)).astype(np.float32)
    kept.take(0, votes)
    fused = 2 / (1 / votes[0] + 1 / votes[1])
    rho = inverse_depth_planes(0.5, 4, PLANES)
    fusion, view = DERD.build("DERD/H").fusion, View(rho[::-1] if far_first else rho)
    rows, columns = np.array([3, 8, 5]), np.array([3, 11, 7])
    ((found, count),) = columns_of(fusion, kept, view, rows, columns)
    assert count == 3
    for lane, (y, x) in enumerate(zip(rows, columns, strict=True)):
        column = fused[:: -1 if far_first else 1, y - 3 : y + 4, x - 3 : x + 4]
        np.testing.assert_allclose(found[0, ..., lane], column / column.max(), rtol=1e-5)


def test_many_pixels_are_read_a_part_at_a_time(monkeypatch):
    kept = KeptVotes(2, PLANES, 12, 15)
    kept.take(0, np.ones((2, PLANES, 12, 15), np.float32))
    rows, columns = np.full(7, 5), np.arange(3, 10)
    monkeypatch.setattr(derd, "BATCH", 3)
    view = View(inverse_depth_planes(0.5, 4, PLANES))
    fusion = DERD.build("DERD/H").fusion
    assert [count for _, count in columns_of(fusion, kept, view, rows, columns)] == [3, 3, 1]


def test_the_method_selects_pixels_as_published_and_reads_them(tmp_path):
    """Its mask is the adaptive threshold of its own C, its depth the network's, without median."""
    path = tmp_path / "mine.npz"
    write_weights(path, NAME, random_arrays(11), {"uniform_in": "linear"})
    config = with_derd(CONFIG, weights=path).model_copy(update={"save_dsi": True})
    result = map_window(fronto_parallel(1.23), config, dsi_dir=tmp_path)
    found = result.depth_maps["DERD/H"]
    wanted = without_border(confidence_mask(found.confidence, selecting(config)), SIDE_PX // 2)
    np.testing.assert_array_equal(found.mask, wanted)
    assert found.points > 50
    fused = np.load(tmp_path / "DERD-H.npy")
    arrays = of_model(derd_net(path).weights.arrays, 0)
    for y, x in np.argwhere(found.mask)[:: found.points // 5]:
        column = fused[:, y - 3 : y + 4, x - 3 : x + 4]
        inside = np.clip(place(arrays, column / column.max()), 0, 1)
        # Votes are kept in 8 bits: a sixteenth of them at most.
        assert found.depth_m[y, x] == pytest.approx(0.5 + 3.5 * inside, abs=0.1)
    fewer = map_window(fronto_parallel(1.23), with_derd(config, threshold_c=25.0),
                       dsi_dir=tmp_path)  # fmt: skip
    assert 0 < fewer.depth_maps["DERD/H"].points < found.points


@pytest.mark.parametrize("depth_m", [0.8, 1.23, 2.1])
def test_the_network_that_ships_reads_a_plane(depth_m):
    """Within a tenth of the depth range's width at worst: it was trained on other ranges."""
    found = map_window(fronto_parallel(depth_m), CONFIG).depth_maps["DERD/H"]
    assert abs(np.median(found.depth_m[found.mask]) - depth_m) < 0.35


@pytest.mark.slow
def test_threads_and_company_do_not_change_a_bit():
    recording = fronto_parallel(1.5)
    alone = map_window(recording, CONFIG.model_copy(update={"threads": 1})).depth_maps["DERD/H"]
    names = ("Alg1/H", "Focus/H", "Learned/H", "DERD/H")
    many = map_window(recording, CONFIG.model_copy(update={"methods": names, "threads": 2}))
    without = map_window(recording, CONFIG.model_copy(update={"methods": names[:2]}))
    for one, other in ((many.depth_maps["DERD/H"], alone), *(
        (many.depth_maps[name], without.depth_maps[name]) for name in names[:2]
    )):  # fmt: skip
        np.testing.assert_array_equal(one.depth_m, other.depth_m)
        np.testing.assert_array_equal(one.mask, other.mask)


def test_the_compatibility_setting_gives_what_the_published_weights_know():
    """The authors' planes and their H: far to near, and still the right depth."""
    config = CONFIG.model_copy(update={"compatibility": "mcemvs"})
    found = map_window(fronto_parallel(1.23), config).depth_maps["DERD/H"]
    assert abs(np.median(found.depth_m[found.mask]) - 1.23) < 0.35


def test_a_window_without_candidates_has_no_points():
    config = with_derd(CONFIG, threshold_c=250.0)
    assert map_window(fronto_parallel(1.5), config).depth_maps["DERD/H"].points == 0


@pytest.mark.parametrize(("changed", "words"), [
    ({"planes": 60}, "60 planes of inverse spacing: the network reads 100 planes"),
    ({"spacing": "linear"}, "100 planes of linear spacing"),
])  # fmt: skip
def test_planes_that_it_cannot_read_are_refused_before_any_work(changed, words, monkeypatch):
    recording = fronto_parallel(1.5)
    monkeypatch.setattr(type(recording), "events", lambda *_: pytest.fail("events were read"))
    refused(words, map_window, recording, CONFIG.model_copy(update=changed))
    assert linear_planes(1, 2, 3).shape == (3,)


@pytest.mark.parametrize(("learnt", "models", "words"), [
    ({}, 1, "uniform_in is None, must be linear or inverse"),
    ({"uniform_in": "linear"}, 3, "arrays differ from what the network needs: 1.conv3d.0.bias"),
])  # fmt: skip
def test_weights_that_say_too_little_or_hold_too_much(learnt, models, words, tmp_path):
    write_weights(tmp_path / "a.npz", NAME, random_arrays(0, models), learnt)
    refused(words, derd_net, tmp_path / "a.npz")


def test_weights_of_our_own_network_are_refused():
    config = with_derd(CONFIG, weights=packaged("learned"))
    refused("but 'derd-net' is needed", map_window, fronto_parallel(1.5), config)


def test_a_precision_is_refused_for_it_has_no_reliability_that_means_something():
    config = CONFIG.model_copy(update={"min_precision": 0.9})
    words = "min_precision: DERD/H has no calibrated reliability"
    refused(words, map_window, fronto_parallel(1.5), config)


def test_it_is_in_the_registry_and_not_in_all():
    assert named("DERD/H") == DERD.build("DERD/H")
    assert "DERD/H" in overview()
    assert "DERD/H" not in {method.name for method in methods_by_name(("all",), 2)}
    for name, cameras in (("DERD/A", 2), ("DERD/H", 1)):
        refused(f"unknown method '{name}'", methods_by_name, (name,), cameras)


def test_what_ships_says_where_it_comes_from():
    manifest = derd_net().weights.manifest
    assert manifest["licence"] == "MIT"
    assert manifest["sequences"]["training"]
    assert manifest["training"]["network"] == "derd"
