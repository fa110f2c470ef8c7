"""The compiled network against its definition, against torch, and for any number of threads."""

import numba
import numpy as np
import pytest

from eventsweep.emvs.depth.kept_votes import LANES
from eventsweep.plugins.learned.networks.network import (
    CHANNELS,
    CUES,
    DEPTH,
    SIDE_PX,
    Architecture,
    Network,
    network,
)
from eventsweep.plugins.learned.networks.weights import Weights
from lanes import as_rays
from naive_network import judged


def random_network(seed, shape):
    rng = np.random.default_rng(seed)
    arrays = {
        name: rng.normal(0, 0.2, size).astype(np.float32) for name, size in shape.shapes().items()
    }
    return Network(Weights(arrays, {}, None), shape)


def random_pixels(seed, count):
    rng = np.random.default_rng(seed)
    shares = rng.gamma(0.5, 0.5, (count, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX))
    return shares.astype(np.float32), rng.normal(size=(count, len(CUES))).astype(np.float32)


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, 3 * LANES + 5])
@pytest.mark.parametrize("shape", [Architecture(), Architecture(3, 5, 7, 1)])
def test_the_compiled_network_is_its_definition(count, shape):
    net = random_network(count, shape)
    shares, cues = random_pixels(count + 1, count)
    offset, log_error = net.judge(as_rays(shares), cues)
    expected = judged(net.weights.arrays, shares, cues, shape.peak)
    np.testing.assert_allclose(offset, expected[0], atol=2e-4)
    np.testing.assert_allclose(log_error, expected[1], atol=2e-4)


def test_torch_trains_the_network_that_runs():
    torch = pytest.importorskip("torch", reason="torch is an extra, [train]")
    from eventsweep.plugins.learned.training.network import Network as TorchNetwork

    torch.manual_seed(0)
    trained = TorchNetwork(Architecture())
    arrays = trained.arrays()
    assert {name: one.shape for name, one in arrays.items()} == Architecture().shapes()
    shares, cues = random_pixels(5, 50)
    with torch.no_grad():
        wanted = trained(torch.from_numpy(shares), torch.from_numpy(cues))
    offset, log_error = Network(Weights(arrays, {}, None)).judge(as_rays(shares), cues)
    np.testing.assert_allclose(offset, wanted.offset, atol=1e-4)
    np.testing.assert_allclose(log_error, wanted.log_error, atol=1e-4)


def test_threads_do_not_change_a_bit():
    shares, cues = random_pixels(7, 5 * LANES)
    found = []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        found.append(network().judge(as_rays(shares), cues))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_pixel_does_not_depend_on_its_neighbours_in_a_block():
    shares, cues = random_pixels(8, 48)
    offset, _ = network().judge(as_rays(shares), cues)
    alone, _ = network().judge(as_rays(shares[40:41]), cues[40:41])
    assert offset[40] == alone[0]
