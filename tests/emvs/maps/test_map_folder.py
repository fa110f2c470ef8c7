import json

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import RecordingInfo, read_map, write_index, write_window
from point_world import fronto_parallel
from refusals import all_bytes, refused

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4, planes=20, methods=("Alg1/H", "EMVS/cam0"))
RECORDING = RecordingInfo(name="points", path="somewhere/points", manifest_sha256="ab12")


@pytest.fixture(scope="module")
def result():
    return map_window(fronto_parallel(1.5), CONFIG)


def write(directory, result, *, clouds=False):
    window = write_window(directory / "w000", result, CONFIG, ("cam0", "cam1"), clouds=clouds)
    write_index(directory, RECORDING, CONFIG, [window])


@pytest.fixture
def folder(tmp_path, result):
    write(tmp_path / "map", result)
    return tmp_path / "map"


def test_what_is_written_is_read(folder, result):
    stored = read_map(folder)
    assert stored.info.recording == RECORDING
    assert stored.info.config == CONFIG
    assert "numpy" in stored.info.versions
    (window,) = stored.windows
    assert window.info.methods == ("Alg1/H", "EMVS/cam0")
    assert window.info.t_ref_us == result.view.t_us
    assert window.info.counts["cam1"] == result.counts[1].to_json()
    for method, expected in result.depth_maps.items():
        depth = window.depth_map(method)
        for name in ("depth_m", "confidence", "mask", "argmax", "rho", "T_world_rv"):
            array = getattr(depth, name)
            np.testing.assert_array_equal(array, getattr(expected, name))
            assert array.dtype == getattr(expected, name).dtype
        assert (depth.method, depth.t_us, depth.camera) == (method, expected.t_us, expected.camera)
        np.testing.assert_array_equal(window.slices.values[method], result.slices.values[method])
    assert window.slices.row_px == result.slices.row_px
    np.testing.assert_array_equal(window.event_image, result.event_image)


def test_layout_is_the_documented_one(tmp_path, result):
    write(tmp_path / "map", result, clouds=True)
    files = {str(p.relative_to(tmp_path / "map")) for p in tmp_path.rglob("*") if p.is_file()}
    assert files == {
        "map.json", "w000/slices.npz", "w000/events.npz",
        "w000/Alg1-H/depth.npz", "w000/Alg1-H/cloud.ply",
        "w000/EMVS-cam0/depth.npz", "w000/EMVS-cam0/cloud.ply",
    }  # fmt: skip


def test_same_result_same_bytes(tmp_path, folder, result):
    write(tmp_path / "again", result)
    assert all_bytes(folder) == all_bytes(tmp_path / "again")


def read_everything(folder):
    (window,) = read_map(folder).windows
    return [window.depth_map("Alg1/H"), window.slices, window.event_image]


@pytest.mark.parametrize("name", ["w000/Alg1-H/depth.npz", "w000/slices.npz", "w000/events.npz"])
@pytest.mark.parametrize("damage", ["missing", "empty", "truncated", "noise", "flipped"])
def test_damaged_arrays_are_refused_with_name_and_cure(folder, name, damage):
    path = folder / name
    whole = path.read_bytes()
    path.unlink()
    if damage != "missing":
        path.write_bytes(damaged(whole, damage))
    refused([path, "eventsweep map"], read_everything, folder)


def damaged(whole, damage):
    middle = len(whole) // 2
    return {
        "empty": b"", "truncated": whole[:middle],
        "noise": bytes(np.random.default_rng(0).integers(0, 256, 999, np.uint8)),
        "flipped": whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :],
    }[damage]  # fmt: skip


def test_pickles_are_never_loaded(folder):
    np.savez(folder / "w000" / "events.npz", counts=np.array([{"a": 1}], dtype=object))
    refused(r"events\.npz", read_everything, folder)


@pytest.mark.parametrize(("name", "wrong"), [
    ("depth_m", lambda right: right[1:]), ("mask", lambda right: right.astype(np.uint8)),
    ("T_world_rv", lambda _: np.eye(3)), ("camera", lambda _: np.array("{}")),
    ("camera", lambda _: np.array("[")),
])  # fmt: skip
def test_arrays_of_another_shape_or_kind_are_refused(folder, name, wrong):
    path = folder / "w000" / "Alg1-H" / "depth.npz"
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **(arrays | {name: wrong(arrays[name])}))
    refused(r"depth\.npz", lambda: read_map(folder).windows[0].depth_map("Alg1/H"))


@pytest.mark.parametrize(("edit", "words"), [
    (lambda text: text[: len(text) // 2], "not the JSON"),
    (lambda text: "[]", "not the JSON"),
    (lambda text: text.replace('"schema_version": 1', '"schema_version": 99'), "99, needs 1"),
    (lambda text: text.replace('"schema_version": 1', r'"schema_version": "\u001b]0;"'), "x1b"),
    (lambda text: text.replace('"planes": 20', '"planes": 1'), "planes"),
    (lambda text: text.replace('"t0_us"', '"t9_us"'), "t0_us"),
    (lambda text: text.replace('"w000"', '"../w000"'), "name"),
])  # fmt: skip
def test_damaged_index_is_refused(folder, edit, words):
    index = folder / "map.json"
    index.write_text(edit(index.read_text()))
    said = refused(words, read_map, folder)
    assert "map.json" in said
    assert said.isprintable()


def test_no_map_and_no_method(folder, tmp_path):
    refused("is not a map", read_map, tmp_path / "nothing")
    with pytest.raises(InputError, match=r"no method 'Alg1/G', it has Alg1/H, EMVS/cam0"):
        read_map(folder).windows[0].depth_map("Alg1/G")


def test_index_is_plain_json(folder):
    index = json.loads((folder / "map.json").read_text())
    assert index["config"]["planes"] == 20
    assert index["windows"][0]["counts"]["cam0"]["events"] > 0
