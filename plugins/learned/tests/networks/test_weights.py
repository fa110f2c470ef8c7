"""Files of weights: what ships is whole and small; damaged and foreign ones get one line each."""

import json
import pickle
import shutil
import zipfile

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.plugins.learned.networks.network import NAME, Architecture
from eventsweep.plugins.learned.networks.weights import packaged, read_weights, write_weights
from point_world import fronto_parallel

SHAPES = Architecture().shapes()


@pytest.fixture
def weights(tmp_path):
    """A copy of the weights that ship."""
    for suffix in (".npz", ".json"):
        shutil.copy(packaged("learned").with_suffix(suffix), tmp_path / f"mine{suffix}")
    return tmp_path / "mine.npz"


def refused(path):
    with pytest.raises(InputError) as error:
        read_weights(path, NAME, SHAPES)
    assert "\n" not in str(error.value)
    return str(error.value)


def rewritten(path, **changed):
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files} | changed
    write_weights(path, NAME, {name: one for name, one in arrays.items() if one is not None}, {})


def test_what_ships_is_small_and_says_where_it_comes_from():
    path = packaged("learned")
    assert path.stat().st_size < 1 << 20
    manifest = read_weights(path, NAME, SHAPES).manifest
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
    assert "not the file that mine.json describes" in refused(weights)


def test_a_file_cut_short_with_its_hash_is_refused(weights):
    weights.write_bytes(weights.read_bytes()[:5000])
    _rehash(weights)
    assert "cannot be read as weights" in refused(weights)


def test_a_pickle_is_never_opened(weights, tmp_path):
    class Evil:
        def __reduce__(self):
            return (tmp_path.joinpath("executed").touch, ())

    with zipfile.ZipFile(weights, "w") as archive:
        archive.writestr("patch.weight.npy", pickle.dumps(Evil()))
    _rehash(weights)
    refused(weights)
    assert not (tmp_path / "executed").exists()


def test_a_bomb_is_not_unpacked(weights):
    with zipfile.ZipFile(weights, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("patch.weight.npy", bytes(1 << 25))
    _rehash(weights)
    assert "unpacks to" in refused(weights)


@pytest.mark.parametrize(("changed", "words"), [
    ({"patch.bias": None}, "arrays differ from what the network needs: patch.bias"),
    ({"patch.bias": np.zeros(3, np.float32)}, "patch.bias"),
    ({"more": np.zeros(3, np.float32)}, "more"),
    ({"patch.bias": np.full(8, np.nan, np.float32)}, "patch.bias must be float32 and finite"),
])  # fmt: skip
def test_other_arrays_are_named(weights, changed, words):
    rewritten(weights, **changed)
    assert words in refused(weights)


@pytest.mark.parametrize(("text", "words"), [
    (None, "cannot be read"), ("{", "cannot be read"), ("[1]", "weights for None"),
    (json.dumps({"network": "derd"}), "but 'eventsweep-learned-1' is needed"),
])  # fmt: skip
def test_a_manifest_that_is_missing_damaged_or_of_another_network(weights, text, words):
    manifest = weights.with_suffix(".json")
    manifest.unlink()
    if text is not None:
        manifest.write_text(text)
    assert words in refused(weights)


def test_the_mapper_refuses_weights_before_it_reads_an_event(weights, monkeypatch):
    weights.unlink()
    recording = fronto_parallel(1.5)
    monkeypatch.setattr(type(recording), "events", lambda *_: pytest.fail("events were read"))
    with pytest.raises(InputError, match=r"mine\.npz"):
        map_window(recording, MapperConfig(methods=("Learned/H",), learned_weights=weights))


def _rehash(path):
    import hashlib

    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".json").write_text(json.dumps({"network": NAME, "arrays_sha256": digest}))
