"""Miniatures with lenses and turned rigs: every layout maps to the same depth map as our own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dataset_files
import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.windows import choose_window

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


def mapped(path: Path, ours: Path):
    window = choose_window(Sequence.open(ours), CONFIG)
    return map_window(open_recording(path), CONFIG, window=window).depth_maps["Alg1/H"]


@pytest.mark.parametrize("model", world.LENSES)
def test_our_own_layout_maps_to_the_plane(sequences, model):
    """Else the comparisons below would say little: the lens and the rig count."""
    sequence, found = Sequence.open(sequences[model]), mapped(sequences[model], sequences[model])
    truth_m = sequence.truth_view_depth_m(0, 250_000)
    off = np.abs(found.depth_m - truth_m)[found.mask] / truth_m[found.mask]
    assert found.mask.sum() > 100
    assert np.median(off) < 0.03


@pytest.mark.parametrize(("model", "kind"), PAIRS)
def test_lenses_and_turned_rigs_map_to_the_same_depth(sequences, tmp_path, model, kind):
    ours = sequences[model]
    theirs = rewritten(ours, tmp_path / kind, kind)
    expected, got = mapped(ours, ours), mapped(theirs, ours)
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.depth_m[got.mask], expected.depth_m[got.mask], rtol=1e-5)


@pytest.mark.parametrize("model", world.LENSES)
@pytest.mark.parametrize("kind", dataset_files.WRITERS)
def test_what_publishers_write_maps_to_the_same_depth(sequences, tmp_path, model, kind):
    """Written beside the product: bags, mocap of the rig's body, EVT 2.1, M3ED, VECtor, EVIMO2."""
    ours = sequences[model]
    theirs = dataset_files.WRITERS[kind](Sequence.open(ours), tmp_path / kind)
    expected, got = mapped(ours, ours), mapped(theirs, ours)
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.depth_m[got.mask], expected.depth_m[got.mask], rtol=1e-5)


@pytest.mark.parametrize("model", ["pinhole", "radtan"])
@pytest.mark.parametrize("kind", dataset_files.SINGLE)
def test_what_has_one_camera_maps_to_the_same_depth(tmp_path, model, kind):
    """EMVS of the same events."""
    ours = world.write_sequence(tmp_path / "ours", model, cameras=1)
    theirs = dataset_files.SINGLE[kind](Sequence.open(ours), tmp_path / kind)
    config = CONFIG.model_copy(update={"methods": ("EMVS/cam0",)})
    window = choose_window(Sequence.open(ours), config)
    expected, got = (
        map_window(open_recording(path), config, window=window).depth_maps["EMVS/cam0"]
        for path in (ours, theirs)
    )
    assert expected.mask.sum() > 100
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.depth_m[got.mask], expected.depth_m[got.mask], rtol=1e-5)
