import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_methods
import naive_sweep
from depth_maps import assert_same_bits, mapper, steps_off
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import union
from eventsweep.emvs.dsi import voting
from eventsweep.emvs.dsi.fusion import Split, fuse
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.dsi.voting import batch_planes
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, overview, register, unregister
from eventsweep.emvs.methods.method import Method
from eventsweep.emvs.reference_view import (
    inverse_depth_at,
    inverse_depth_planes,
    is_linear,
    linear_planes,
)
from point_world import fronto_parallel
from refusals import refused

F = ("min", "H", "G", "A", "RMS", "max")
CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, threshold_c=20)
mapped = mapper(CONFIG)


def compositions(n, suffix=""):
    for outer, inner in itertools.product(F, F):
        yield f"Alg2/{outer}t{inner}c@{n}{suffix}"
        if "~" not in suffix:
            yield f"Alg2/{outer}c{inner}t@{n}{suffix}"


def find(name, cameras=2, *, mcemvs=False):
    return methods_by_name((name,), cameras, mcemvs=mcemvs)[0]


def votes(seed, cameras, intervals, planes=2, height=3, width=4):
    rng = np.random.default_rng(seed)
    values = rng.exponential(5, (cameras * intervals, planes, height, width)).astype(np.float32)
    values[rng.random(values.shape) < 0.15] = 0
    return values


# Kernels and their twins


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), cameras=st.integers(2, 3), n=st.integers(1, 4))
def test_every_composition_equals_its_twin(seed, cameras, n):
    volumes = votes(seed, cameras, n, 1, 2, 3)
    plain = volumes.reshape(cameras, n, 1, 2, 3).astype(np.float64)
    names = [*compositions(n), *(compositions(n, "~") if n > 1 else ())]
    for name in names:
        got = fuse(find(name, cameras).fusion, volumes)
        for place in np.ndindex(got.shape):
            expected = naive_methods.fuse(name, plain[:, :, *place].tolist())
            assert got[place] == pytest.approx(expected, rel=5e-6, abs=1e-30), name


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), batch=st.integers(1, 3))
def test_folding_equals_fusing_whole_volumes(seed, n, batch):
    volumes = np.round(votes(seed, 2, n, planes=5))  # rounding makes ties
    names = [f"Alg2/{x}@{n}" for x in ("AtHc", "HcAt", "RMScmint")]
    chosen = [find(name) for name in names]
    chosen.insert(1, Method.from_function("Own/sum", _sum, "sum", Split(n)))
    maxima = RunningMaxima([method.fusion for method in chosen], 4, 3)
    for first in range(0, 5, batch):
        part = np.ascontiguousarray(volumes[:, first : first + batch]).reshape(len(volumes), -1, 12)
        maxima.update(part, part.shape[1])
    for k, method in enumerate(chosen):
        fused, got = fuse(method.fusion, volumes), maxima.of(k)
        for y, x in np.ndindex(3, 4):
            value, plane, _ = naive_sweep.maximum(fused[:, y, x])
            assert (got.value[y, x], got.plane[y, x]) == (value, plane)


def _sum(parts):
    return parts.sum(axis=(0, 1))


@given(
    seed=st.integers(0, 2**32 - 1), events=st.integers(0, 30), n=st.integers(1, 6),
    by=st.sampled_from(["count", "time"]),
)  # fmt: skip
def test_cuts_equal_twin(seed, events, n, by):
    t_us = np.sort(np.random.default_rng(seed).integers(100, 150, events))
    edges = Split(n, by).edges(t_us, 100, 150)
    assert len(edges) == n + 1
    of_event = np.repeat(np.arange(n), np.diff(edges))
    np.testing.assert_array_equal(of_event, naive_methods.intervals(t_us, n, by, 100, 150))


# Laws of fusion


@pytest.mark.parametrize("composition", ["{0}t{1}c", "{0}c{1}t"])
def test_order_laws(composition):
    """Every mean is monotonic, so a larger mean at either level gives a larger value."""
    volumes = votes(3, 3, 4)
    for fixed, (low, high) in itertools.product(F, itertools.pairwise(F)):
        for small, large in (((low, fixed), (high, fixed)), ((fixed, low), (fixed, high))):
            a, b = (
                fuse(find(f"Alg2/{composition.format(*pair)}@4", 3).fusion, volumes)
                for pair in (small, large)
            )
            assert np.all(a <= b * np.float32(1 + 3e-6))


def test_one_kind_of_mean_at_both_levels_is_that_mean_of_all():
    volumes = votes(4, 2, 3)
    for name in F:
        all_at_once = fuse(find(f"Alg1/{name}", 6).fusion, volumes)
        for both in (f"Alg2/{name}t{name}c@3", f"Alg2/{name}c{name}t@3"):
            np.testing.assert_allclose(fuse(find(both).fusion, volumes), all_at_once, rtol=5e-6)


@pytest.mark.parametrize("name", ["AtHc", "HcAt", "RMStGc", "mincmaxt"])
def test_permuting_cameras_or_intervals_changes_nothing(name):
    volumes = votes(5, 3, 4).reshape(3, 4, 2, 3, 4)
    method = find(f"Alg2/{name}@4", 3)
    expected = fuse(method.fusion, volumes.reshape(12, 2, 3, 4))
    for cameras, intervals in (([2, 0, 1], [0, 1, 2, 3]), ([0, 1, 2], [3, 1, 0, 2])):
        moved = volumes[cameras][:, intervals].reshape(12, 2, 3, 4)
        np.testing.assert_allclose(fuse(method.fusion, moved), expected, rtol=3e-6)


def test_shuffling_two_intervals_swaps_them_in_all_cameras_but_the_first():
    volumes = votes(6, 2, 2)
    swapped = volumes[[0, 1, 3, 2]]
    np.testing.assert_array_equal(
        fuse(find("Alg2/AtHc@2~").fusion, volumes), fuse(find("Alg2/AtHc@2").fusion, swapped)
    )
    assert not np.array_equal(
        fuse(find("Alg2/AtHc@2~").fusion, volumes), fuse(find("Alg2/AtHc@2").fusion, volumes)
    )


# The mapper


@pytest.mark.parametrize("compatibility", ["none", "mcemvs"])
def test_one_interval_is_algorithm_1_to_the_bit(compatibility):
    names = [f"Alg2/{x}@1" for x in ("AtHc", "HcAt", "HtHc", "RMScGt", "GtRMSc")]
    pairs = list(zip(names, ("H", "H", "H", "RMS", "RMS"), strict=True))
    recording = fronto_parallel(1.5)
    fused = {f"Alg1/{one}" for _, one in pairs}
    result = mapped(recording, *fused, *names, "Alg2/AtHc@1/time", compatibility=compatibility)
    for name, one in [*pairs, ("Alg2/AtHc@1/time", "H")]:
        assert_same_bits(result.depth_maps[name], result.depth_maps[f"Alg1/{one}"])


@pytest.mark.parametrize("by", ["", "/time"])
def test_the_mean_over_intervals_is_the_mean_over_the_window_by_scale(by):
    """Votes of a window are the sum over its n intervals, so their mean is 1/n of them."""
    result = mapped(fronto_parallel(1.5), "Alg1/A", f"Alg2/AtAc@4{by}", f"Alg2/AcAt@4{by}")
    whole = result.slices.values["Alg1/A"]
    for name in (f"Alg2/AtAc@4{by}", f"Alg2/AcAt@4{by}"):
        np.testing.assert_allclose(4 * result.slices.values[name], whole, rtol=2e-5, atol=1e-5)
        np.testing.assert_allclose(
            4 * result.depth_maps[name].confidence, result.depth_maps["Alg1/A"].confidence,
            rtol=2e-5, atol=1e-5,
        )  # fmt: skip


def test_methods_do_not_depend_on_the_company_they_are_in():
    recording = fronto_parallel(1.5)
    names = ("Alg1/H", "Alg2/AtHc@4", "Alg2/HcAt@3/time", "Alg2/AtHc@2~", "Late/union")
    together = mapped(recording, *names)
    assert list(together.depth_maps) == list(names)
    assert list(together.slices.values) != []
    for name in names:
        assert_same_bits(mapped(recording, name).depth_maps[name], together.depth_maps[name])


@pytest.mark.parametrize("polarity", ["both", "separate"])
def test_threads_do_not_change_a_bit(polarity):
    names = ("all", "Alg2/AtHc@4", "Alg2/HcAt@3/time", "Alg2/GtRMSc@2~", "Late/union")
    recording = fronto_parallel(1.5)
    one, two = (mapped(recording, *names, polarity=polarity, threads=t) for t in (1, 2))
    for name in one.depth_maps:
        assert_same_bits(one.depth_maps[name], two.depth_maps[name])
        np.testing.assert_array_equal(one.slices.values[name], two.slices.values[name])
    assert one.counts == two.counts


@pytest.mark.parametrize("values", [{}, {"polarity": "separate"}, {"compatibility": "mcemvs"}])
def test_every_event_and_vote_is_accounted_for(values):
    recording = fronto_parallel(1.5)
    result = mapped(recording, "Alg2/AtHc@3", **values)
    assert result.event_image.sum() == len(recording.streams[0])
    for stream, counts in zip(recording.streams, result.counts, strict=True):
        flat = counts.to_json()
        assert flat["events"] == len(stream)
        lost = ("without_pose", "without_ray", "looking_backwards", "dropped_tail")
        assert flat["events"] == flat["voting"] + sum(flat[name] for name in lost)
        votes_of = ("votes_counted", "votes_outside_image", "votes_behind_camera")
        assert flat["voting"] * 25 == sum(flat[name] for name in votes_of)
        assert flat["votes_counted"] > 0


@pytest.mark.parametrize(("name", "values"), [
    ("Alg2/AtHc@4", {}), ("Alg2/HcAt@2/time", {}), ("Alg2/AtHc@2~", {}), ("Late/union", {}),
    ("Alg1/H", {"reference": "end"}), ("Alg1/H", {"reference_shift": 0.5}),
])  # fmt: skip
def test_a_plane_is_recovered(name, values):
    result = mapped(fronto_parallel(1.23), name, **values)
    assert result.depth_maps[name].points > (100 if values else 200)
    assert steps_off(result, name, 1.23) < 0.5


def test_volumes_on_request(tmp_path):
    config = CONFIG.model_copy(update={"save_dsi": True, "methods": ("Alg2/AtHc@2", "Late/union")})
    result = map_window(fronto_parallel(1.5), config, dsi_dir=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["Alg2-AtHc@2.npy"]
    volume = np.load(tmp_path / "Alg2-AtHc@2.npy")
    np.testing.assert_array_equal(volume.max(axis=0), result.depth_maps["Alg2/AtHc@2"].confidence)


# Late fusion


def test_late_fusion_equals_twin():
    names = ("EMVS/cam0", "EMVS/cam1", "EMVS/cam2")
    result = mapped(fronto_parallel(1.5, cameras=3), *names, "Late/union")
    maps = [result.depth_maps[name] for name in names]
    joined = result.depth_maps["Late/union"]
    assert_same_bits(joined, union("Late/union", maps))
    for place in np.ndindex(joined.mask.shape):
        camera, reported = naive_methods.union(
            [one.confidence[place] for one in maps], [one.mask[place] for one in maps]
        )
        assert joined.mask[place] == reported
        assert joined.depth_m[place] == maps[camera].depth_m[place]
    assert joined.points > max(one.points for one in maps)


# Polarity


def test_polarities_apart_obey_the_means():
    """Concave means of parts sum to less than that of the sums, convex ones to more, A to it."""
    recording = fronto_parallel(1.5)
    apart, together = (mapped(recording, "all", polarity=p) for p in ("separate", "both"))
    for name, rows in together.slices.values.items():
        other, eps = apart.slices.values[name], 1e-4
        if name in ("Alg1/min", "Alg1/H", "Alg1/G", "Focus/H"):
            assert np.all(other <= rows + eps)
            assert (other < rows - eps).any()
        elif name in ("Alg1/RMS", "Alg1/max"):
            assert np.all(other >= rows - eps)
        else:
            np.testing.assert_allclose(other, rows, atol=eps)


# Planes and the reference view


@pytest.mark.parametrize("count", [2, 3, 25, 1000])
@pytest.mark.parametrize(("near_m", "far_m"), [(0.5, 6), (0.5, 0.6), (0.1, 100)])
def test_planes_know_their_spacing(count, near_m, far_m):
    linear, inverse = (make(near_m, far_m, count) for make in (linear_planes, inverse_depth_planes))
    step_m = (far_m - near_m) / (count - 1)
    np.testing.assert_allclose(np.diff(1 / linear.astype(float)), step_m, rtol=2e-3)
    assert is_linear(linear) == (count > 2)
    assert not is_linear(inverse)
    between = np.array([0, 0.25, count - 1.5, count - 1], np.float32)
    if count > 2:
        expected = np.interp(between, np.arange(count), 1 / linear.astype(float))
        np.testing.assert_allclose(1 / inverse_depth_at(linear, between), expected, rtol=1e-5)
    whole = np.arange(count, dtype=np.float32)
    np.testing.assert_allclose(inverse_depth_at(linear, whole), linear, rtol=1e-5)


def test_a_plane_is_recovered_by_linear_planes():
    result = mapped(fronto_parallel(1.23), "Alg1/H", spacing="linear", planes=60)
    step_m = 3.5 / 59
    np.testing.assert_allclose(np.diff(1 / result.view.rho), step_m, rtol=1e-3)
    depth = result.depth_maps["Alg1/H"]
    assert np.median(np.abs(depth.depth_m - 1.23)[depth.mask]) < 0.6 * step_m


def test_more_than_256_planes():
    depth = mapped(fronto_parallel(1.23), "Alg1/H", planes=300).depth_maps["Alg1/H"]
    assert depth.argmax.max() > 256
    assert np.median(np.abs(depth.depth_m - 1.23)[depth.mask]) < 0.1


@pytest.mark.parametrize(("planes", "bits"), [(32_767, 16), (32_768, 32), (70_000, 32)])
def test_plane_indices_never_overflow(planes, bits):
    """The maximum lies at the last plane but one of a volume that rises to it."""
    ramp = np.arange(planes, dtype=np.float32)
    ramp[-1] = 0
    maxima = RunningMaxima((find("EMVS/cam0").fusion,), 2, 1, planes=planes)
    maxima.update(np.repeat(ramp[None, :, None], 2, axis=2), planes)
    found = maxima.of(0)
    assert found.plane.dtype == np.dtype(f"int{bits}")
    np.testing.assert_array_equal(found.plane, planes - 2)
    assert np.all(found.left == planes - 3)
    assert not found.right.any()


def test_the_reference_view_at_the_end_and_along_the_baseline():
    recording = fronto_parallel(1.5)
    result = mapped(recording, "EMVS/cam0", reference="end", reference_shift=0.25)
    end_us = min(result.window.t1_us, recording.trajectory.span_us[1])
    assert result.view.t_us == end_us
    T = recording.trajectory.at(end_us) @ recording.rig.T_body_cam[0]
    T[0, 3] += 0.25 * 0.1
    np.testing.assert_allclose(result.view.T_world_rv, T, atol=1e-12)


def test_seen_from_camera_1_the_cameras_change_places():
    """On the baseline's far end camera 1 votes where camera 0 votes on the near one."""
    recording = fronto_parallel(1.5)
    result = mapped(recording, "EMVS/cam1", reference_shift=1.0)
    T = recording.trajectory.at(result.view.t_us) @ recording.rig.T_body_cam[1]
    np.testing.assert_allclose(result.view.T_world_rv, T, atol=1e-12)


def test_a_wider_view_holds_the_votes_of_the_narrow_one():
    recording = fronto_parallel(1.5)
    narrow, wide = (
        mapped(recording, "EMVS/cam0", **size, slice_row=row)
        for size, row in (({}, 30), ({"view_width_px": 136, "view_height_px": 84}, 40))
    )
    inside, outside = narrow.slices.values["EMVS/cam0"], wide.slices.values["EMVS/cam0"]
    assert outside.shape == (25, 136)
    np.testing.assert_allclose(outside[:, 21:115], inside[:, 1:95], atol=2e-3)
    counted = [one.counts[0].votes.counted for one in (narrow, wide)]
    assert counted[1] > counted[0]
    assert outside.sum() > inside.sum()


def test_a_view_of_its_own_focal_length():
    result = mapped(fronto_parallel(1.23), "Alg1/A", view_focal_px=40.0)
    camera, own = result.view.camera, fronto_parallel(1.23).rig.cameras[0]
    assert (camera.width_px, camera.fx_px, camera.fy_px) == (own.width_px, 40, 40)
    assert camera.cx_px - (camera.width_px - 1) / 2 == pytest.approx(0.15)
    depth = result.depth_maps["Alg1/A"]
    assert np.median(np.abs(depth.depth_m - 1.23)[depth.mask]) < 0.1


def test_a_view_of_its_own_principal_point():
    """Its axis moved to the right and below, the same votes lie as far to the right and below."""
    recording = fronto_parallel(1.5)
    own = recording.rig.cameras[0].undistorted()
    moved = {"view_cx_px": own.cx_px + 10, "view_cy_px": own.cy_px + 3}
    here, there = (
        mapped(recording, "EMVS/cam0", **view, slice_row=row)
        for view, row in (({}, 30), (moved, 33))
    )
    camera = there.view.camera
    assert (camera.cx_px, camera.cy_px) == (own.cx_px + 10, own.cy_px + 3)
    assert (camera.width_px, camera.fx_px) == (own.width_px, own.fx_px)
    before, after = here.slices.values["EMVS/cam0"], there.slices.values["EMVS/cam0"]
    np.testing.assert_allclose(after[:, 11:-1], before[:, 1:-11], atol=2e-3)
    assert before[:, 1:-11].max() > 1


def test_a_view_of_another_program():
    """As EMVS programs state theirs: one focal length, the principal point at half the size."""
    view = {
        "view_width_px": 80, "view_height_px": 60, "view_focal_px": 55.0, "view_focal_y_px": 55.0,
        "view_cx_px": 40.0, "view_cy_px": 30.0,
    }  # fmt: skip
    result = mapped(fronto_parallel(1.23), "Alg1/A", **view)
    camera = result.view.camera
    assert (camera.width_px, camera.height_px) == (80, 60)
    assert camera.K.tolist() == [[55, 0, 40], [0, 55, 30], [0, 0, 1]]
    depth = result.depth_maps["Alg1/A"]
    assert depth.mask.any()
    assert np.median(np.abs(depth.depth_m - 1.23)[depth.mask]) < 0.1


# Names


def test_names_are_parsed():
    method = find("Alg2/RMStminc@3/time~", 3)
    assert (method.fusion.split, method.fusion.shuffled, method.fusion.time_first) == (
        Split(3, "time"),
        True,
        False,
    )
    assert "minimum, then over time by the root mean square" in method.summary
    assert find("Alg2/HcAt@2").fusion.time_first
    assert find("Alg2/AtHc@2", mcemvs=True).fusion != find("Alg2/AtHc@2").fusion
    assert [m.name for m in methods_by_name(("Late/union", "Alg1/H", "Late/union"), 2)] == [
        "Alg1/H", "Late/union",
    ]  # fmt: skip
    assert not any(
        name.startswith(("Alg2", "Late")) for name in [m.name for m in methods_by_name(("all",), 2)]
    )


ONE_CAMERA = r"1 camera\(s\): choose from EMVS/cam0, Focus/cam0 or all"


@pytest.mark.parametrize(("name", "cameras", "words"), [
    ("Alg2/AtHc", 2, r"Alg2/AtHc'.*<F>t<F>c@n"), ("Alg2/XtHc@2", 2, "<F>t<F>c@n"),
    ("Alg2/AtHc@0", 2, "<F>t<F>c@n"), ("Alg2/AcHc@2", 2, "fuses twice across cameras"),
    ("Alg2/AtHc@65", 2, "65 sub-intervals; at most 64"), ("Alg2/AtHc@2", 1, ONE_CAMERA),
    ("Alg2/HcAt@2~", 2, "shuffling changes nothing"),
    ("Alg2/AtHc@1~", 2, "shuffling changes nothing"), ("Late/join", 2, "Late/union"),
    ("Late/union", 1, ONE_CAMERA), ("Alg1/H", 1, r"Alg1/H.*EMVS/cam0"),
    ("Alg3/H", 2, r"unknown method.*Alg1/H.*<F>t<F>c@n.*Late/union"),
    ("Alg1/median", 2, r"Alg1/median.*EMVS/cam0"), ("EMVS/cam2", 2, r"EMVS/cam2.*EMVS/cam0"),
    ("Focus/X", 2, r"unknown method 'Focus/X': the names are Focus/<F>"),
    ("Focus/AtHc", 2, "the names are"), ("Focus/cam01", 2, "the names are"),
    ("Focus/cam2", 2, r"unknown method 'Focus/cam2' for 2 camera\(s\)"),
    ("Focus/H", 1, f"for {ONE_CAMERA}"), ("Focus/cam1", 1, r"for 1 camera\(s\)"),
    ("SGM/x", 2, r"unknown method 'SGM/x': the baselines are SGM/ts"),
    ("SGM/ts", 1, "SGM/ts matches two cameras, this rig has 1"),
])  # fmt: skip
def test_unknown_names_get_one_line_with_the_grammar(name, cameras, words):
    refused(words, find, name, cameras)


@pytest.mark.parametrize(("name", "cameras", "words"), [
    *((name, 3, f"{name} in the mcemvs setting fuses 2 cameras")
      for name in ("Alg2/HcAt@2", "Alg2/AtHc@2", "Focus/H")),
    ("all", 3, "2 cameras, this rig has 3"), ("SGM/ts", 2, "does not support the mcemvs setting"),
])  # fmt: skip
def test_the_harmonic_mean_of_mcemvs_is_for_two_cameras(name, cameras, words):
    refused(words, find, name, cameras, mcemvs=True)
    assert len(methods_by_name(("Alg1/min",), 3, mcemvs=True)) == 1


# A method of one's own


@pytest.fixture
def own():
    method = Method.from_function("Own/harmonic", _harmonic, "H in numpy", Split(4))
    register(method)
    yield method
    unregister(method.name)


def _harmonic(parts):
    with np.errstate(divide="ignore"):
        return (len(parts) / (1 / parts).sum(axis=0)).mean(axis=0)


def test_a_method_of_ones_own(own):
    assert overview()["Own/harmonic"] == "H in numpy"
    result = mapped(fronto_parallel(1.5), "Own/harmonic", "Alg2/AtHc@4")
    mine, built_in = result.depth_maps["Own/harmonic"], result.depth_maps["Alg2/AtHc@4"]
    np.testing.assert_allclose(mine.confidence, built_in.confidence, rtol=1e-5)
    assert (mine.argmax == built_in.argmax).mean() > 0.999
    refused("registered already", register, own)
    refused("Own/harmonic", find, "Own/nothing")


@pytest.mark.parametrize("name", ["Alg1/mine", "Late/mine", "mine", "My method/x", "../x", "Own/"])
def test_names_that_are_taken_or_no_names_are_refused(name):
    refused("needs the form Family/variant", register, Method.from_function(name, _sum, "x"))


def test_functions_cannot_change_the_votes():
    def spoil(parts):
        parts[:] = 0

    with pytest.raises(ValueError, match="read-only"):
        fuse(Method.from_function("Own/bad", spoil, "x").fusion, votes(1, 2, 1))


# Requests


def test_a_baseline_needs_two_cameras():
    with pytest.raises(InputError, match=r"reference_shift is 0\.5: needs a rig of 2 cameras"):
        mapped(fronto_parallel(1.5, cameras=1), "all", reference_shift=0.5)


def test_only_camera_0s_view_has_ground_truth():
    assert MapperConfig(reference="end").is_camera_0_view
    for values in ({"reference_shift": 0.5}, {"view_width_px": 100}, {"view_focal_px": 50.0},
                   {"view_focal_y_px": 50.0}, {"view_cx_px": 0}, {"view_cy_px": 0}):  # fmt: skip
        assert not MapperConfig(**values).is_camera_0_view


def test_scratch_planes_have_a_limit():
    one_mpx = 1280 * 720
    assert batch_planes(100, 2, one_mpx, 8) == 8
    assert batch_planes(100, 16, one_mpx, 2) == 64
    assert batch_planes(100, 2, one_mpx, 128) == 1


def test_batches_do_not_change_a_bit(monkeypatch):
    recording, name = fronto_parallel(1.5), "Alg2/GtHc@4"
    usual = mapped(recording, name).depth_maps[name]
    monkeypatch.setattr(voting, "_SCRATCH_PX", 1)
    assert_same_bits(mapped(recording, name).depth_maps[name], usual)
