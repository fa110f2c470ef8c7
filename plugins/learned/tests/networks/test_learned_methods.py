"""Learned methods in the mapper: names, any rig, any planes, laws."""

from dataclasses import replace

import numpy as np
import pytest

from depth_maps import assert_same_bits, mapper, steps_off
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.precision import scatter_scale
from eventsweep.emvs.methods import methods_by_name, overview
from point_world import fronto_parallel
from refusals import refused
from tiers import often

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25)
mapped = mapper(CONFIG)


@pytest.mark.parametrize("depth_m", [0.8, 1.23, 2.1])
@pytest.mark.parametrize("planes", often([25], [25, 60, 200]))
def test_a_fronto_parallel_plane_is_recovered(depth_m, planes):
    """At any number of planes, as precisely in metres: within half of 25 planes."""
    result = mapped(fronto_parallel(depth_m), "Learned/H", "Learned/cam1", planes=planes)
    for name in ("Learned/H", "Learned/cam1"):
        assert steps_off(result, name, depth_m) < 0.5 * planes / 25, name


@pytest.mark.parametrize("cameras", [1, 2, 3])
def test_any_number_of_cameras(cameras):
    name = "Learned/cam0" if cameras == 1 else "Learned/H"
    assert steps_off(mapped(fronto_parallel(1.23, cameras=cameras), name), name, 1.23) < 0.5


def test_planes_even_in_depth_and_polarities_apart_are_mapped_as_well():
    result = mapped(fronto_parallel(1.23), "Learned/H", spacing="linear", planes=60)
    depth = result.depth_maps["Learned/H"]
    assert np.median(abs(depth.depth_m[depth.mask] - 1.23)) < 0.06
    apart = mapped(fronto_parallel(1.23), "Learned/H", polarity="separate")
    assert steps_off(apart, "Learned/H", 1.23) < 0.5


def test_threads_company_and_repetition_do_not_change_a_bit():
    recording = fronto_parallel(1.5)
    alone = mapped(recording, "Learned/H", threads=1).depth_maps["Learned/H"]
    for threads in (1, 2):
        result = mapped(recording, "Focus/H", "Learned/cam0", "Learned/H", threads=threads)
        assert_same_bits(result.depth_maps["Learned/H"], alone)


def test_its_company_does_not_change():
    """A method that keeps votes leaves the others what they are."""
    recording = fronto_parallel(1.5)
    with_it = mapped(recording, "Alg1/H", "Focus/H", "Learned/H", "Alg2/AtHc@2")
    without = mapped(recording, "Alg1/H", "Focus/H", "Alg2/AtHc@2")
    for name in ("Alg1/H", "Focus/H", "Alg2/AtHc@2"):
        assert_same_bits(with_it.depth_maps[name], without.depth_maps[name])


def test_a_lower_error_keeps_a_part_of_the_points():
    recording = fronto_parallel(1.5)
    wide, narrow = (
        mapped(recording, "Learned/H", learned={"error_px": px}).depth_maps["Learned/H"]
        for px in (2.0, 0.3)
    )
    assert 0 < narrow.points < wide.points
    assert not (narrow.mask & ~wide.mask).any()
    rim = np.ones_like(wide.mask)
    rim[3:-3, 3:-3] = False
    assert not (wide.mask & rim).any()


def test_the_error_in_metres_grows_with_the_square_of_depth():
    """Law: error_m = error_px Z² / (f b), and error_px is a falling function times the scatter."""
    result = mapped(fronto_parallel(1.23), "Learned/H", "Focus/H", planes=100)
    for depth in result.depth_maps.values():
        scale = scatter_scale(depth.scatter_px) * depth.depth_m**2
        per = (depth.error_m / scale)[depth.mask]
        falling = per[np.argsort(depth.reliability[depth.mask], kind="stable")]
        assert np.all(falling[1:] <= falling[:-1] * 1.001)


def test_without_a_fitted_surface_no_error_is_stated():
    plain = mapped(fronto_parallel(1.23), "Learned/H", "Focus/H", planes=100, interpolate=False)
    assert all(d.scatter_px is None and d.error_m is None for d in plain.depth_maps.values())


def test_a_window_without_candidates_has_no_points():
    recording = fronto_parallel(1.5)
    few = replace(recording, streams=tuple(one.slice(0, 3) for one in recording.streams))
    result = mapped(few, "Learned/H", focus={"threshold_c": 200})
    assert result.depth_maps["Learned/H"].points == 0


@pytest.mark.parametrize(("name", "cameras", "words"), [
    ("Learned/X", 2, "the names are Learned/<F> or Learned/camK"),
    ("Learned/AtHc@2", 2, "the names are Learned/<F> or Learned/camK"),
    ("Learned/cam2", 2, r"unknown method 'Learned/cam2' for 2 camera\(s\)"),
    ("Learned/H", 1, r"for 1 camera\(s\)"),
])  # fmt: skip
def test_names_that_cannot_be_get_one_line(name, cameras, words):
    refused(words, methods_by_name, (name,), cameras)


def test_the_compatibility_setting_has_no_learned_method():
    words = "Learned/H does not support the mcemvs setting"
    refused(words, methods_by_name, ("Learned/H",), 2, mcemvs=True)
    assert any(name.startswith("Learned/<F>") for name in overview())


@pytest.mark.parametrize(("wanted", "names"), [
    (0.5, ("Alg1/H", "EMVS/cam0", "Focus/H", "Learned/H", "Late/union")),
    (0.9, ("Focus/H", "Learned/H", "Learned/cam0")),
])  # fmt: skip
def test_a_wanted_precision_chooses_the_threshold(wanted, names):
    """More precision, fewer points: of every method whose reliability is calibrated."""
    recording = fronto_parallel(1.5)
    some, fewer = (mapped(recording, *names, min_precision=p) for p in (wanted, wanted + 0.05))
    for name in names:
        a, b = some.depth_maps[name], fewer.depth_maps[name]
        assert a.points > 0, name
        assert b.points <= a.points
        if name != "Late/union":
            assert not (b.mask & ~a.mask).any()


@pytest.mark.parametrize("name", ["Alg2/AtHc@2", "SGM/ts", "Focus/AtHc@2"])
def test_a_precision_that_nobody_knows_is_refused_before_any_work(name):
    words = f"min_precision: {name} has no calibrated"
    refused(words, mapped, fronto_parallel(1.5), name, min_precision=0.9)


def test_a_precision_that_cannot_be_reached_says_what_can():
    words = "EMVS/cam0 reached at most 0"
    refused(words, mapped, fronto_parallel(1.5), "EMVS/cam0", min_precision=0.9999)


def test_what_votes_rank_states_no_error():
    """How far votes stand out says too little: `min_precision` works, an error is not stated."""
    maps = mapped(fronto_parallel(1.5), "Alg1/H", "EMVS/cam0", "Late/union").depth_maps
    assert all(one.error_m is None for one in maps.values())


def test_planes_farther_apart_than_calibrated_state_no_error():
    names = "Focus/H", "Learned/H"
    fine, coarse = (mapped(fronto_parallel(1.5), *names, planes=n).depth_maps for n in (200, 10))
    assert all(fine[name].error_m is not None for name in names)
    assert all(coarse[name].error_m is None for name in names)


def test_points_lie_on_the_plane_through_their_neighbours():
    """Law: the fit leaves a slanted or flat plane what it is, and takes noise from it."""
    fitted = mapped(fronto_parallel(1.23), "Learned/H").depth_maps["Learned/H"]
    plain = mapped(fronto_parallel(1.23), "Learned/H", interpolate=False).depth_maps["Learned/H"]
    spread = [np.std(1 / one.depth_m[fitted.mask]) for one in (fitted, plain)]
    assert spread[0] < spread[1]
