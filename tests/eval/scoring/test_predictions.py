"""Depth maps of others: every format gives back what was written, and nothing else is let in."""

import contextlib
import re
from dataclasses import replace

import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given as given_values
from hypothesis import strategies as st

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.eval.scoring.depth_files import SUFFIXES, depths_in, read_stored
from eventsweep.eval.scoring.pairing import Estimate
from eventsweep.eval.scoring.predictions import Prediction, TargetView, estimates_of
from eventsweep.eval.scoring.run_folder import keep, kept_predictions, predicted_maps
from refusals import line_of

VIEW = TargetView(t_us=250_000, width_px=7, height_px=5, focal_px=100.0, baseline_m=0.1)
SHAPE = (VIEW.height_px, VIEW.width_px)


def depths():
    depth_m = np.random.default_rng(0).uniform(0.5, 4.0, SHAPE)
    depth_m[0, :3] = np.nan
    return depth_m


def write(path, depth_m, scale=1.0):
    """One depth map in the format that the suffix says."""
    if path.suffix == ".npz":
        np.savez(path, depth_m=depth_m)
    elif path.suffix == ".npy":
        np.save(path, depth_m)
    elif path.suffix == ".png":
        stored = np.round(np.nan_to_num(depth_m) / scale).astype(np.uint16)
        path.write_bytes(cv2.imencode(".png", stored)[1].tobytes())
    elif path.suffix in (".tif", ".tiff"):
        path.write_bytes(cv2.imencode(".tiff", depth_m.astype(np.float32))[1].tobytes())
    elif path.suffix == ".exr":
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Z": depth_m.astype(np.float32)}).write(str(path))
    else:
        known = zip(*np.nonzero(np.isfinite(depth_m)), strict=True)
        path.write_text("\n".join(f"{c} {r} {float(depth_m[r, c])!r}" for r, c in known))


def given(folder, facts="", case="desk", **arrays):
    """The prediction in a folder, with what it says of itself; arrays are written into an NPZ."""
    if arrays:
        np.savez(folder / "250000.npz", **arrays)
    if facts:
        (folder / "prediction.toml").write_text(facts)
    return Prediction.open(folder, case)


def assert_depths(prediction, view=VIEW, factor=1.0, **close):
    """It has our depths, so many times as large, and nothing elsewhere."""
    depth_m, mask = prediction.depth_m(view)
    np.testing.assert_array_equal(mask, np.isfinite(depths()))
    np.testing.assert_allclose(depth_m[mask], factor * depths()[mask], **close)
    assert not depth_m[~mask].any()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_gives_back_what_was_written(tmp_path, suffix):
    write(tmp_path / f"250000{suffix}", depths(), scale=1e-4)
    facts = "scale = 1e-4\n" if suffix == ".png" else "\n"
    assert_depths(given(tmp_path, facts), atol=6e-5)


@given_values(
    scale=st.floats(1e-3, 10), baseline_m=st.floats(0.01, 2), focal_px=st.floats(10, 2000)
)
def test_disparity_is_baseline_times_focal_length_over_depth(
    tmp_path_factory, scale, baseline_m, focal_px
):
    folder = tmp_path_factory.mktemp("given")
    np.save(folder / "250000.npy", baseline_m * focal_px / depths() / scale)
    view = TargetView(250_000, *SHAPE[::-1], focal_px, baseline_m)
    assert_depths(given(folder, f'quantity = "disparity"\nscale = {scale!r}\n'), view, rtol=1e-5)


def test_disparity_may_refer_to_a_baseline_and_focal_length_of_its_own(tmp_path):
    np.save(tmp_path / "250000.npy", 0.6 * 500 / depths())
    facts = 'quantity = "disparity"\nbaseline_m = 0.6\nfocal_px = 500\n'
    assert_depths(given(tmp_path, facts), rtol=1e-6)


def test_a_mask_hides_numbers_and_zero_negative_and_infinite_ones_are_no_depth(tmp_path):
    mask, expected = np.random.default_rng(1).random(SHAPE) > 0.5, np.isfinite(depths())
    _, seen = given(tmp_path, depth_m=depths(), mask=mask).depth_m(VIEW)
    np.testing.assert_array_equal(seen, mask & expected)
    depth_m = depths()
    depth_m[1, :4], expected[1, :4] = (0, -1, np.inf, -np.inf), False
    np.save(tmp_path / "a.npy", depth_m)
    found = depths_in(read_stored(tmp_path / "a.npy", *SHAPE))
    np.testing.assert_array_equal(np.isfinite(found), expected)


@pytest.mark.parametrize(("name", "description", "times"), [
    ("250000_mine.npy", "", None), ("0.25depth_points_fused.npy", 'time_unit = "s"', None),
    ("0.15depth.npy", 'time_unit = "s"\ntime_offset_us = 100_000', None),
    ("first.npy", "", "250000\n"),
])  # fmt: skip
def test_times_come_from_names_seconds_or_a_list(tmp_path, name, description, times):
    np.save(tmp_path / name, depths())
    if times:
        (tmp_path / "timestamps.txt").write_text(times)
    assert list(given(tmp_path, f"{description}\n").files) == [VIEW.t_us]


def test_each_case_has_its_folder_and_the_name_is_fit_for_a_method(tmp_path):
    (tmp_path / "desk").mkdir()
    np.save(tmp_path / "desk" / "1.npy", depths())
    np.save(tmp_path / "2.npy", depths())
    desk = given(tmp_path, 'name = "my method / 2"\n')
    assert (list(desk.files), desk.name) == ([1], "Given/my_method___2")
    assert list(given(tmp_path, case="boxes").files) == [2]


def test_a_time_within_the_tolerance_counts_and_others_are_refused_with_the_nearest(tmp_path):
    np.save(tmp_path / "249900.npy", depths())
    said = line_of(given(tmp_path).check, [VIEW])
    assert re.search("1 of 1 reference views .* 250000 .* -100 µs away", said)
    np.save(tmp_path / "260000.npy", depths())
    given(tmp_path, "tolerance_us = 100").check([VIEW])


def test_confidence_of_an_npz_comes_along_and_others_say_nothing(tmp_path):
    sure = np.arange(35).reshape(SHAPE)
    found = given(tmp_path, depth_m=depths(), confidence=sure).confidence(VIEW)
    np.testing.assert_array_equal(found, sure)
    for suffix in (".npz", ".npy"):
        folder = tmp_path / suffix[1:]
        folder.mkdir()
        write(folder / f"250000{suffix}", depths())
        assert given(folder).confidence(VIEW) is None


@pytest.mark.parametrize("wrong", [np.ones(3), np.full(SHAPE, np.nan), np.full(SHAPE, "x")])
def test_a_confidence_that_is_no_image_of_numbers_is_refused(tmp_path, wrong):
    prediction = given(tmp_path, depth_m=depths(), confidence=wrong)
    assert "confidence is" in line_of(prediction.confidence, VIEW)


SEEN = replace(VIEW, true_depth_m=(2.0, 2.0))


@pytest.mark.parametrize("factor", [1000, 0.001, 100])
def test_another_unit_is_refused_unless_it_is_declared(tmp_path, factor):
    np.save(tmp_path / "250000.npy", depths() * factor)
    assert re.search("median depth would be .* set scale", line_of(given(tmp_path).depth_m, SEEN))
    for scale, unit in ((1 / factor, 1), (1, factor)):
        assert_depths(given(tmp_path, f"scale = {scale}"), SEEN, unit, rtol=1e-6)


@pytest.mark.parametrize("factor", [4, 0.25])
def test_a_poor_map_in_metres_is_let_in(tmp_path, factor):
    np.save(tmp_path / "250000.npy", depths() * factor)
    assert_depths(given(tmp_path), SEEN, factor)


EMPTY = {"NaN": np.nan, "negative": -1.5, "zero": 0.0, "infinite": np.inf}


@pytest.mark.parametrize("number", EMPTY.values(), ids=EMPTY)
@pytest.mark.parametrize("quantity", ["depth", "disparity"])
def test_a_map_of_nothing_is_refused_unless_it_is_meant(tmp_path, quantity, number):
    np.save(tmp_path / "250000.npy", np.full(SHAPE, number))
    facts = f'quantity = "{quantity}"\n'
    line = line_of(given(tmp_path, facts).depth_m, SEEN)
    for told in (
        "250000.npy",
        f"no {quantity}",
        "250000 µs",
        "finite and positive",
        "may_be_empty",
    ):
        assert told in line
    assert not given(tmp_path, facts + "may_be_empty = true\n").depth_m(SEEN)[1].any()


def mapped():
    camera = Camera(VIEW.width_px, VIEW.height_px, 100.0, 100.0, 3.0, 2.0)
    one, places = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.int16)
    return DepthMap("Alg1/H", 2 * one, one, one > 0, places, one[0], VIEW.t_us, np.eye(4), camera)


@pytest.mark.parametrize("name", ["theirs", "..", "méthode 2"])
def test_what_is_kept_comes_back_as_a_depth_map_of_the_window(tmp_path, name):
    theirs, run = tmp_path / "given", tmp_path / "run"
    (theirs / "desk").mkdir(parents=True)
    sure = np.arange(35.0).reshape(SHAPE)
    np.savez(theirs / "desk" / "250000.npz", depth_m=1000 * depths(), confidence=sure)
    prediction = given(theirs, f'name = "{name}"\nscale = 0.001\n')
    with kept_predictions(run, [theirs]) as folder:
        keep(folder, "desk", VIEW.t_us, estimates_of([prediction], VIEW))

    (found,) = predicted_maps(run, "desk", mapped())

    assert found.method == prediction.name
    np.testing.assert_array_equal(found.mask, np.isfinite(depths()))
    np.testing.assert_allclose(found.depth_m[found.mask], depths()[found.mask], rtol=1e-6)
    np.testing.assert_array_equal(found.confidence, sure)
    assert predicted_maps(run, "boxes", mapped()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["given", "run"]
    assert strangers(run / "predictions") == []


@pytest.mark.parametrize("case", ["../../evil", "/tmp/evil", "..", ".hidden", "a/b"])
def test_the_name_of_a_case_leads_nowhere_else(tmp_path, case):
    run, theirs = tmp_path / "deep" / "run", {"Given/a": Estimate(depths(), depths() > 0)}
    with kept_predictions(run, [tmp_path / "given"]) as folder:
        keep(folder, case, VIEW.t_us, theirs)
        assert all(folder in path.parents for path in tmp_path.rglob("*.npz"))
    assert [one.method for one in predicted_maps(run, case, mapped())] == ["Given/a"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep"]


def keep_one(run):
    with kept_predictions(run, [run / "given"]) as folder:
        keep(folder, "desk", 1, {"Given/a": Estimate(np.ones(SHAPE), np.ones(SHAPE, bool))})


def test_what_was_kept_goes_when_nothing_is_scored_and_never_what_is_not_ours(tmp_path):
    place = tmp_path / "predictions"
    keep_one(tmp_path)
    (place / "thesis.tex").write_text("x")
    with kept_predictions(tmp_path, []):
        pass
    assert not place.exists()
    assert (tmp_path / "predictions.kept-1" / "thesis.tex").read_text() == "x"


def test_a_folder_of_that_name_that_is_not_ours_is_not_looked_into(tmp_path):
    (tmp_path / "predictions" / "mine" / "desk").mkdir(parents=True)
    (tmp_path / "predictions" / "mine" / "prediction.toml").write_text("= 1")
    assert predicted_maps(tmp_path, "desk", mapped()) == []


def test_predictions_that_lie_where_others_are_put_are_kept_beside(tmp_path):
    keep_one(tmp_path)
    with kept_predictions(tmp_path, [tmp_path / "predictions" / "Given-a"]):
        pass
    assert (tmp_path / "predictions.kept-1" / "Given-a" / "desk" / "1.npz").is_file()


def stored(array, name="250000.npy"):
    return lambda folder: np.save(folder / name, array, allow_pickle=True)


def text(words, name="250000.txt", *stems):
    """A text, and our depths in files of these names."""

    def spoil(folder):
        (folder / name).write_text(words)
        for stem in stems:
            write(folder / stem, depths())

    return spoil


def eight_bits(folder):
    content = cv2.imencode(".png", np.ones(SHAPE, np.uint8))[1]
    (folder / "250000.png").write_bytes(content.tobytes())


FACTS = "prediction.toml"
BAD = {
    "no folder": (lambda folder: folder.rmdir(), "no such folder"),
    "empty": (lambda folder: None, "no depth maps"),
    "no time": (stored(depths(), "depth.npy"), "begin with the time"),
    "twice": (text("", FACTS, "250000.npy", "250000_b.npy"), "both for 250000 µs"),
    "size": (stored(depths()[1:]), "4 rows and 7 columns"),
    "three channels": (stored(np.ones((*SHAPE, 3))), "needs (H, W)"),
    "pickle": (stored(np.array([{}])), "cannot be read"),
    "complex": (stored(depths() * 1j), "complex"),
    "no scale": (lambda folder: write(folder / "250000.png", depths(), 1e-3), "set scale"),
    "8 bits": (eight_bits, "needs 16 bits"), "outside": (text("7 0 1.5"), "lies at 7, 0"),
    "half a pixel": (text("0.5 0 1"), "whole"), "two columns": (text("1 2"), "needs 3"),
    "words": (text("a b c"), "cannot be read"), "no TOML": (text("= 1", FACTS), "not TOML"),
    "unknown key": (text("unit = 1", FACTS, "250000.npy"), "it may hold name"),
    "list too short": (text("1", "timestamps.txt", "a.npy", "b.npy"), "it has 1 of them"),
    "mask": (lambda folder: np.savez(folder / "250000.npz", depth_m=depths(), mask=np.ones(3)),
     "mask is float64"),
    "npz of disparity": (text('quantity = "disparity"', FACTS, "250000.npz"), "quantity"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_bad_predictions_end_in_one_clear_line(tmp_path, kind):
    spoil, message = BAD[kind]
    spoil(tmp_path)
    assert message in line_of(lambda: given(tmp_path).depth_m(VIEW))


@pytest.mark.parametrize("suffix", SUFFIXES)
@given_values(data=st.data())
def test_damaged_files_end_in_one_clear_line_or_are_read(tmp_path_factory, suffix, data):
    path = tmp_path_factory.mktemp("damaged") / f"1{suffix}"
    write(path, depths(), 1e-3)
    content = bytearray(path.read_bytes())
    content = content[: data.draw(st.integers(0, len(content)))]
    for place in data.draw(st.lists(st.integers(0, max(len(content) - 1, 0)), max_size=4)):
        if content:
            content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(bytes(content))
    with contextlib.suppress(InputError):
        assert read_stored(path, *SHAPE).shape == SHAPE
