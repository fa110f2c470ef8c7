"""True surfaces: exact, one per cell, with the normal, class and views that the pictures give."""

import numpy as np
import pytest

import eventsweep as es
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.geometry import truth as truth_module
from eventsweep.plugins.geometry.ply import read_ply
from eventsweep.plugins.geometry.surfels import KINDS, surfels_of
from eventsweep.plugins.geometry.truth import (
    cached_surfaces,
    open_sequence,
    true_surfaces,
    write_truth,
)
from point_world import pinhole
from refusals import refused
from room_world import CELL_M, POLE, ROOM, off_surface_m, one_view, write_sequence

FAR_M = 2.5


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return es.Sequence(write_sequence(tmp_path_factory.mktemp("room") / "seq"))


@pytest.fixture(scope="module")
def truth(sequence):
    return true_surfaces(sequence, CELL_M, 5.0)


def on_pole(truth):
    return (truth.points_world > POLE[0] - 1e-3).all(axis=1) & (
        truth.points_world < POLE[1] + 1e-3
    ).all(axis=1)


def test_every_point_lies_on_a_surface_and_in_a_cell_of_its_own(truth):
    assert len(truth) > 3000
    assert off_surface_m(truth.points_world).max() < 1e-6
    cells = np.floor(truth.points_world / CELL_M)
    assert len(np.unique(cells, axis=0)) == len(truth)


def test_normals_are_those_of_the_walls_and_look_at_the_camera(truth):
    np.testing.assert_allclose(np.linalg.norm(truth.normals, axis=1), 1, atol=1e-6)
    apart = np.abs(truth.points_world[:, None] - ROOM)
    wall = np.where(apart.min(axis=(1, 2)) < 1e-6, apart.min(axis=1).argmin(axis=1), -1)
    for axis in range(3):
        chosen = (wall == axis) & (truth.kind == KINDS.index("plane"))
        assert chosen.sum() > 100 or axis == 2
        np.testing.assert_allclose(np.abs(truth.normals[chosen, axis]), 1, atol=1e-4)
        inwards = -np.sign(truth.points_world[chosen, axis]) if axis < 2 else -1
        assert (np.sign(truth.normals[chosen, axis]) == inwards).all()


def test_classes_are_those_of_the_depth_picture(truth):
    pole = on_pole(truth)
    assert pole.sum() > 30
    assert (truth.kind[pole] == KINDS.index("thin")).mean() > 0.9
    assert (truth.kind[~pole] == KINDS.index("thin")).mean() < 0.01
    names = [KINDS[k] for k in np.unique(truth.kind)]
    assert {"plane", "curved", "edge", "thin"} == set(names)
    crease = np.sort(np.abs(truth.points_world[:, None] - ROOM).min(axis=1), axis=1)[:, 1]
    assert (truth.kind[(crease > 0.3) & ~pole] != KINDS.index("curved")).all()
    assert (crease[truth.kind == KINDS.index("curved")] < 0.3).all()


def test_far_begins_where_it_is_said_to(sequence):
    found = true_surfaces(sequence, CELL_M, FAR_M)
    beyond = found.points_world[:, 2] > FAR_M
    np.testing.assert_array_equal(found.kind == KINDS.index("far"), beyond)


def test_views_are_counted_once_per_picture(truth, sequence):
    """Of twelve pictures; the middle of the far wall is in all, what the pole hides in fewer."""
    assert truth.views.max() == 12
    assert truth.views.min() >= 1
    middle = (np.abs(truth.points_world[:, :2]) < 0.5).all(axis=1) & (
        truth.points_world[:, 2] > 2.9
    )
    assert np.median(truth.views[middle]) >= 10
    assert (truth.depth_m <= 3.0001).all()


def test_what_moves_is_left_out(tmp_path):
    moving = es.Sequence(write_sequence(tmp_path / "moving", moving=True))
    assert not on_pole(true_surfaces(moving, CELL_M, 5.0)).any()


def test_a_lens_changes_nothing(tmp_path):
    """Pixels of a distorting lens see the same surfaces."""
    lens = Camera(120, 90, 70.0, 70.0, 59.8, 44.3, "radtan", (-0.1, 0.02, 0.001, -0.001))
    found = true_surfaces(es.Sequence(write_sequence(tmp_path / "lens", lens)), CELL_M, 5.0)
    assert off_surface_m(found.points_world).max() < 1e-6
    assert 0.5 < (found.kind == KINDS.index("plane")).mean() < 0.95


def test_pictures_are_merged_in_any_portions(sequence, truth, monkeypatch):
    """Merging after every picture, or once at the end, keeps the same."""
    monkeypatch.setattr(truth_module, "_MERGE_AT_LEAST", 0)
    often = true_surfaces(sequence, CELL_M, 5.0)
    for name, values in vars(truth).items():
        np.testing.assert_array_equal(getattr(often, name), values, err_msg=name)


def test_it_is_made_once(sequence, truth, tmp_path, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path))
    first = cached_surfaces(sequence, CELL_M, 5.0)
    monkeypatch.setattr(truth_module, "true_surfaces", None)
    again = cached_surfaces(sequence, CELL_M, 5.0)
    for name, values in vars(truth).items():
        np.testing.assert_array_equal(getattr(first, name), values)
        np.testing.assert_array_equal(getattr(again, name), values)


def test_the_file_holds_everything(truth, tmp_path):
    write_truth(tmp_path / "truth.ply", truth)
    read = read_ply(tmp_path / "truth.ply").vertices
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(read[axis], truth.points_world[:, k])
        np.testing.assert_array_equal(read[f"n{axis}"], truth.normals[:, k])
    for name in ("radius_m", "depth_m", "kind", "views"):
        np.testing.assert_array_equal(read[name], getattr(truth, name))


def test_what_no_camera_saw_is_no_surface():
    camera = pinhole(8, 6, 10.0)
    rays = camera.ray_table()
    depth_m = np.full((6, 8), np.inf, np.float32)
    assert len(surfels_of(depth_m, rays, np.eye(4), 10.0, CELL_M, 5.0)) == 0
    depth_m[2, 3] = 1.5
    (point,) = surfels_of(depth_m, rays, np.eye(4), 10.0, CELL_M, 5.0).points_world
    np.testing.assert_allclose(point, rays[2, 3] * 1.5)


def test_discs_cover_the_surface_between_their_middles():
    """Any place on what a picture shows lies on a disc of a pixel: the others are between."""
    found = one_view()
    wall = np.abs(found.points_world[:, 2] - ROOM[1, 2]) < 1e-6
    spacing = 3.0 / 70
    assert found.radius_m[wall].min() >= max(CELL_M, spacing) / np.sqrt(2) - 1e-6


def test_what_is_no_sequence_with_depth_is_refused(tmp_path, sequence):
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    refused("against the folder of a sequence", open_sequence, tmp_path / "poses.txt")
    refused("not recognised", open_sequence, tmp_path)
    refused("no such folder", open_sequence, tmp_path / "none")
    refused("raise cell_m", true_surfaces, sequence, 1e-6, 5.0)
