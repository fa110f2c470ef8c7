import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.point_cloud import (
    PointCloud,
    back_project_map,
    without_outliers,
    write_ply,
)
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.reference_view import inverse_depth_planes
from eventsweep.emvs.utils.release import install_extra
from point_world import pinhole

POSE = se3.from_rotation(Rotation.from_rotvec([0.1, -0.3, 0.2]), [1.0, -2.0, 0.5])


def depth_map(seed=0):
    rng = np.random.default_rng(seed)
    camera = pinhole(40, 30)
    shape = (30, 40)
    return DepthMap(
        method="Alg1/H",
        depth_m=rng.uniform(0.5, 4, shape).astype(np.float32),
        confidence=rng.uniform(1, 9, shape).astype(np.float32),
        mask=rng.random(shape) < 0.3, argmax=np.zeros(shape, np.int16),
        rho=inverse_depth_planes(0.5, 4, 10), t_us=5, T_world_rv=POSE, camera=camera,
    )  # fmt: skip


def test_points_project_back_onto_their_pixels_at_their_depth():
    depth = depth_map()
    cloud = back_project_map(depth)
    points_rv = se3.transform(se3.inverse(POSE), cloud.points_world)
    rows, columns = np.nonzero(depth.mask)
    np.testing.assert_allclose(points_rv[:, 2], depth.depth_m[depth.mask], rtol=1e-6)
    np.testing.assert_allclose(
        depth.camera.project(points_rv), np.stack([columns, rows], axis=-1), atol=1e-6
    )


def test_near_is_red_and_far_is_blue():
    depth = depth_map()
    depth.depth_m[:] = np.where(np.arange(40) < 20, 0.5, 4.0)
    cloud = back_project_map(depth)
    near = depth.depth_m[depth.mask] < 1
    red, blue = cloud.colours[:, 0].astype(int), cloud.colours[:, 2].astype(int)
    assert np.all(red[near] > blue[near])
    assert np.all(red[~near] < blue[~near])
    by_confidence = back_project_map(depth, "confidence")
    assert len(np.unique(by_confidence.colours, axis=0)) > 10


def test_radius_filter_equals_counting_neighbours():
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1, (300, 3))
    colours = rng.integers(0, 255, (300, 3)).astype(np.uint8)
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    for neighbours in (1, 3, 6):
        kept = (distance < 0.15).sum(axis=1) - 1 >= neighbours
        assert 0 < kept.sum() < 300
        cloud = without_outliers(PointCloud(points, colours), 0.15, neighbours)
        np.testing.assert_array_equal(cloud.points_world, points[kept])
        np.testing.assert_array_equal(cloud.colours, colours[kept])


def test_no_filter_and_no_points():
    cloud = back_project_map(depth_map())
    assert without_outliers(cloud, 0.05, 0) is cloud
    empty = PointCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert len(without_outliers(empty, 0.05, 3)) == 0


@pytest.mark.parametrize("points", [0, 1, 50])
def test_ply_holds_what_was_written(tmp_path, points):
    open3d = pytest.importorskip("open3d")
    whole = back_project_map(depth_map())
    cloud = PointCloud(whole.points_world[:points], whole.colours[:points])
    path = tmp_path / "cloud.ply"
    write_ply(path, cloud)
    assert path.read_bytes().startswith(b"ply\nformat binary_little_endian")
    assert [file.name for file in tmp_path.iterdir()] == ["cloud.ply"]
    if points == 0:  # open3d reads no empty file
        assert b"element vertex 0\n" in path.read_bytes()
        return
    read = open3d.io.read_point_cloud(str(path))
    np.testing.assert_allclose(np.asarray(read.points).reshape(-1, 3), cloud.points_world)
    got = np.rint(np.asarray(read.colors).reshape(-1, 3) * 255)
    np.testing.assert_array_equal(got, cloud.colours)


WITHOUT_OPEN3D = """
import sys
import numpy as np
sys.modules["open3d"] = None  # as if it were not installed
from eventsweep.emvs.depth.point_cloud import PointCloud, without_outliers
from eventsweep.emvs.depth.tsdf import SurfaceFusion
from eventsweep.emvs.errors import InputError
cloud = PointCloud(np.zeros((5, 3)), np.zeros((5, 3), np.uint8))
assert len(without_outliers(cloud, 0.1, 4)) == 5
assert len(without_outliers(cloud, 0.1, 5)) == 0
try:
    SurfaceFusion(0.1)
except InputError as error:
    print(error)
"""


def test_clouds_need_no_open3d_and_a_mesh_says_how_to_install_it():
    command = [sys.executable, "-c", WITHOUT_OPEN3D]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert install_extra("mesh") in done.stdout
    assert done.stdout.count("\n") == 1


def test_mapping_never_loads_open3d():
    ours = "eventsweep.emvs.maps.folder, eventsweep.emvs.mapper"
    code = f"import {ours}, sys; raise SystemExit('open3d' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_configuration_needs_no_numpy():
    code = "import eventsweep.emvs.config, sys; raise SystemExit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
