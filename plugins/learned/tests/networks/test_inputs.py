"""What the network is shown of a pixel, against plain sums over the kept votes."""

import numpy as np
import pytest

from eventsweep.emvs.depth.kept_votes import LANES, KeptVotes, votes_of_codes
from eventsweep.emvs.methods import methods_by_name
from eventsweep.plugins.learned.networks.inputs import Candidates, as_patches, channels
from eventsweep.plugins.learned.networks.network import CHANNELS, CUES, DEPTH, SIDE_PX
from lanes import as_rays
from volumes import FUSIONS


def some_candidates(count, planes, height, width, seed=3, halved=0.0):
    rng, rim = np.random.default_rng(seed), SIDE_PX // 2
    rows, columns = rng.integers(rim, height - rim, count), rng.integers(rim, width - rim, count)
    nothing, strides = np.zeros(count, np.float32), rng.integers(1, 3, count)
    return Candidates(
        rows, columns, rng.integers(0, planes, count), np.where(halved > 0, 1, strides),
        rng.random(count) < halved, nothing, nothing, np.zeros((count, len(CUES)), np.float32),
    )  # fmt: skip


@pytest.mark.parametrize(("name", "cameras"), [
    ("Learned/H", 2), ("Learned/A", 3), ("Learned/cam1", 2), ("Learned/cam0", 1),
])  # fmt: skip
def test_channels_are_shares_of_the_largest_fused_votes(name, cameras):
    votes = np.random.default_rng(0).gamma(0.5, 9, (cameras, 12, 11, 17)).astype(np.float32)
    kept = KeptVotes(cameras, *votes.shape[1:])
    kept.take(0, votes)
    volumes = votes_of_codes()[kept.codes]
    (method,), alone = methods_by_name((name,), cameras), int(name[-1]) if "cam" in name else None
    used = volumes if alone is None else volumes[[alone]]
    fused = used[0] if alone is not None else FUSIONS[name[-1]](used)
    chosen = some_candidates(LANES + 3, *votes.shape[1:])
    found = channels(kept, method.fusion, chosen)
    assert found.shape == (2, len(CHANNELS), SIDE_PX, SIDE_PX, DEPTH + 2, LANES)
    assert not found[..., [0, -1], :].any()
    patches = as_patches(found, len(chosen))
    np.testing.assert_array_equal(as_rays(patches), found)
    for m in range(len(chosen)):
        at = [chosen.rows[m] - SIDE_PX // 2, chosen.columns[m] - SIDE_PX // 2]
        square = np.s_[..., at[0] : at[0] + SIDE_PX, at[1] : at[1] + SIDE_PX]
        planes = chosen.centres[m] + chosen.strides[m] * (np.arange(DEPTH) - DEPTH // 2)
        known = (planes >= 0) & (planes < len(fused))
        patch = np.zeros((len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX))
        others = used[1:].mean(0) if len(used) > 1 else used[0]
        for channel, volume in enumerate((fused, used[0], others)):
            patch[channel, known] = volume[square][planes[known]]
        patch /= max(patch[0].max(), 1e-6)
        np.testing.assert_allclose(patches[m], patch, rtol=2e-6, atol=1e-7)


@pytest.mark.parametrize("halved", [1.0, 0.5])
def test_between_sparse_planes_votes_are_interpolated(halved):
    """Law: of votes that are a cubic along the ray, samples at half planes are exact."""
    planes, depth = np.arange(24.0)[:, None, None], np.ones((24, 11, 17))
    left = depth * (40 + 3 * (planes - 12) + 0.5 * (planes - 12) ** 2 + 0.02 * (planes - 12) ** 3)
    votes = np.stack([left, 2 * left]).astype(np.float32)
    kept = KeptVotes(2, *votes.shape[1:])
    kept.take(0, votes)
    chosen = some_candidates(2 * LANES + 3, *votes.shape[1:], halved=halved)
    chosen.centres[:] = 12
    (method,) = methods_by_name(("Learned/H",), 2)
    found = as_patches(channels(kept, method.fusion, chosen), len(chosen))
    for m, patch in enumerate(found):
        step = 0.5 if chosen.halved[m] else 1.0
        at = 12 + step * (np.arange(DEPTH) - DEPTH // 2) - 12
        wanted = 40 + 3 * at + 0.5 * at**2 + 0.02 * at**3
        # the harmonic mean of a and 2 a is 4/3 a; votes are kept to 3 %
        np.testing.assert_allclose(patch[0, :, 3, 3], wanted / wanted.max(), rtol=0.07)
        np.testing.assert_allclose(patch[1] / patch[0], 0.75, rtol=0.09)
