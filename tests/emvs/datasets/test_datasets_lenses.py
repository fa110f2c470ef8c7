"""Miniatures with lenses and turned rigs: every layout maps to the same depth map as our own."""

from pathlib import Path

import numpy as np
import pytest

import dataset_files
import dataset_world as world
from dataset_world import rewritten
from depth_maps import mapped_like
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence

PAIRS = [
    ("kb4", "tumvie"), ("kb4", "mvsec"), ("kb4", "dsec"), ("kb4", "rosbag1"), ("kb4", "evt3"),
    ("radtan", "dsec"), ("radtan", "mvsec"), ("radtan", "rosbag1"), ("radtan", "aedat4"),
    ("pinhole", "dsec"), ("pinhole", "esim-text"),
]  # fmt: skip
CONFIG = MapperConfig(min_depth_m=1.0, max_depth_m=4.0, planes=40, methods=("Alg1/H",))


@pytest.fixture(scope="module")
def sequences(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("ours")
    return {model: world.write_sequence(folder / model, model) for model in world.LENSES}


def assert_alike(theirs, ours, config=CONFIG):
    """The same pixels at the same depths; whether there are many."""
    expected, got = mapped_like(ours, ours, config), mapped_like(theirs, ours, config)
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.depth_m[got.mask], expected.depth_m[got.mask], rtol=1e-5)
    assert expected.mask.sum() > 100


@pytest.mark.parametrize("model", world.LENSES)
def test_our_own_layout_maps_to_the_plane(sequences, model):
    """Else the comparisons below would say little: the lens and the rig count."""
    sequence = Sequence.open(sequences[model])
    found = mapped_like(sequence.path, sequence.path, CONFIG)
    truth_m = sequence.truth_view_depth_m(0, 250_000)
    off = np.abs(found.depth_m - truth_m)[found.mask] / truth_m[found.mask]
    assert found.mask.sum() > 100
    assert np.median(off) < 0.03


@pytest.mark.parametrize(("model", "kind"), PAIRS)
def test_lenses_and_turned_rigs_map_to_the_same_depth(sequences, tmp_path, model, kind):
    ours = sequences[model]
    assert_alike(rewritten(ours, tmp_path / kind, kind), ours)


@pytest.mark.parametrize("model", world.LENSES)
@pytest.mark.parametrize("kind", dataset_files.WRITERS)
def test_what_publishers_write_maps_to_the_same_depth(sequences, tmp_path, model, kind):
    """Written beside the product: bags, mocap of the rig's body, EVT 2.1, M3ED, VECtor, EVIMO2."""
    ours = sequences[model]
    assert_alike(dataset_files.WRITERS[kind](Sequence.open(ours), tmp_path / kind), ours)


@pytest.mark.parametrize("model", ["pinhole", "radtan"])
@pytest.mark.parametrize("kind", dataset_files.SINGLE)
def test_what_has_one_camera_maps_to_the_same_depth(tmp_path, model, kind):
    """EMVS of the same events."""
    ours = world.write_sequence(tmp_path / "ours", model, cameras=1)
    theirs = dataset_files.SINGLE[kind](Sequence.open(ours), tmp_path / kind)
    assert_alike(theirs, ours, CONFIG.model_copy(update={"methods": ("EMVS/cam0",)}))
