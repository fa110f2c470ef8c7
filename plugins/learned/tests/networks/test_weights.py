"""Files of weights: what ships is whole and small; damaged and foreign ones get one line each."""

import hashlib
import json
import pickle
import shutil
import zipfile

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window
from eventsweep.plugins.learned.networks.network import NAME, Architecture
from eventsweep.plugins.learned.networks.weights import packaged, read_weights, write_weights
from point_world import fronto_parallel
from refusals import refused

SHAPES = Architecture().shapes()


@pytest.fixture
def weights(tmp_path):
    """A copy of the weights that ship."""
    for suffix in (".npz", ".json"):
        shutil.copy(packaged("learned").with_suffix(suffix), tmp_path / f"mine{suffix}")
    return tmp_path / "mine.npz"


def test_what_ships_is_small_and_says_where_it_comes_from():
    assert sum(packaged(name).stat().st_size for name in ("learned", "derd")) < 1 << 20
    manifest = read_weights(packaged("learned"), NAME, SHAPES).manifest
    assert manifest["licence"] == "MIT"
    assert manifest["sequences"]["training"]
    assert manifest["code"]
    assert manifest["calibration_errors"]["all_beyond_1px"] < 1
    assert "Learned/H" in manifest["precision"]


def test_what_was_written_is_read(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {name: rng.normal(size=size).astype(np.float32) for name, size in SHAPES.items()}
    write_weights(tmp_path / "a.npz", NAME, arrays, {"note": "mine"})
    found = read_weights(tmp_path / "a.npz", NAME, SHAPES)
    assert found.manifest["note"] == "mine"
    for name, one in arrays.items():
        np.testing.assert_array_equal(found.arrays[name], one)


def test_a_changed_byte_is_noticed(weights):
    content = bytearray(weights.read_bytes())
    content[len(content) // 2] ^= 1
    weights.write_bytes(content)
    refused("not the file that mine.json describes", read_weights, weights, NAME, SHAPES)


class Evil:
    """Executed by whoever unpickles it."""

    def __reduce__(self):
        return (pytest.fail, ("executed",))


@pytest.mark.parametrize(("content", "words"), [
    (None, "cannot be read as weights"), (pickle.dumps(Evil()), r"mine\.npz"),
    (bytes(1 << 25), "unpacks to"),
], ids=["cut-short", "pickle", "bomb"])  # fmt: skip
def test_damaged_and_hostile_archives_with_their_hash_are_refused(weights, content, words):
    if content is None:
        weights.write_bytes(weights.read_bytes()[:5000])
    else:
        with zipfile.ZipFile(weights, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("patch.weight.npy", content)
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    manifest = {"network": NAME, "arrays_sha256": digest}
    weights.with_suffix(".json").write_text(json.dumps(manifest))
    refused(words, read_weights, weights, NAME, SHAPES)


@pytest.mark.parametrize(("changed", "words"), [
    ({"patch.bias": None}, "arrays differ from what the network needs: patch.bias"),
    ({"patch.bias": np.zeros(3, np.float32)}, "patch.bias"),
    ({"more": np.zeros(3, np.float32)}, "more"),
    ({"patch.bias": np.full(8, np.nan, np.float32)}, "patch.bias must be float32 and finite"),
])  # fmt: skip
def test_other_arrays_are_named(weights, changed, words):
    with np.load(weights) as archive:
        arrays = {name: archive[name] for name in archive.files} | changed
    known = {name: array for name, array in arrays.items() if array is not None}
    write_weights(weights, NAME, known, {})
    refused(words, read_weights, weights, NAME, SHAPES)


@pytest.mark.parametrize(("text", "words"), [
    (None, "cannot be read"), ("{", "cannot be read"), ("[1]", "weights for None"),
    (json.dumps({"network": "derd"}), "but 'eventsweep-learned-1' is needed"),
])  # fmt: skip
def test_a_manifest_that_is_missing_damaged_or_of_another_network(weights, text, words):
    manifest = weights.with_suffix(".json")
    manifest.unlink()
    if text is not None:
        manifest.write_text(text)
    refused(words, read_weights, weights, NAME, SHAPES)


def test_the_mapper_refuses_weights_before_it_reads_an_event(weights, monkeypatch):
    weights.unlink()
    recording = fronto_parallel(1.5)
    monkeypatch.setattr(type(recording), "events", lambda *_: pytest.fail("events were read"))
    config = MapperConfig(methods=("Learned/H",), learned_weights=weights)
    refused(r"mine\.npz", map_window, recording, config)
