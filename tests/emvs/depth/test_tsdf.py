"""The global cloud and mesh of many windows."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.config import FuseConfig, MapperConfig
from eventsweep.emvs.depth import point_cloud
from eventsweep.emvs.depth.point_cloud import PointCloud, VoxelCloud
from eventsweep.emvs.depth.tsdf import SurfaceFusion, write_mesh
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.maps.merge import fuse_windows
from eventsweep.emvs.maps.sliding import map_windows
from point_world import fronto_parallel
from refusals import refused


def cloud_of(points):
    points = np.asarray(points, np.float64).reshape(-1, 3)
    colours = (np.abs(points) * 50 % 256).astype(np.uint8)
    return PointCloud(points, colours)


def naive(clouds, voxel_m, min_windows):
    """Voxel -> mean point, mean colour, windows; by dictionaries."""
    found = {}
    for k, cloud in enumerate(clouds):
        for point, colour in zip(cloud.points_world, cloud.colours, strict=True):
            cell = tuple(np.floor(point / voxel_m).astype(int))
            found.setdefault(cell, []).append((k, point, colour))
    kept = {c: v for c, v in found.items() if len({k for k, _, _ in v}) >= min_windows}
    return {
        cell: (
            np.mean([p for _, p, _ in v], axis=0),
            np.mean([c for _, _, c in v], axis=0),
            len({k for k, _, _ in v}),
        )
        for cell, v in kept.items()
    }


windows = st.lists(
    st.lists(st.tuples(*[st.floats(-3, 3, width=32)] * 3), max_size=15), min_size=1, max_size=5
)


@settings(max_examples=60)
@given(windows, st.sampled_from([0.1, 0.7, 2.0]), st.integers(1, 3), st.booleans())
def test_voxels_equal_their_slow_twin(points, voxel_m, min_windows, often):
    clouds = [cloud_of(p) for p in points]
    with pytest.MonkeyPatch.context() as patch:
        # Merging at every window or at the end: the same.
        patch.setattr(point_cloud, "_MERGE_AT_LEAST", 0 if often else 10**9)
        voxels = VoxelCloud(voxel_m)
        for cloud in clouds:
            voxels.add(cloud)
        found, counts = voxels.cloud(min_windows)
    expected = naive(clouds, voxel_m, min_windows)
    assert len(found) == len(counts) == len(expected)
    means = sorted((tuple(np.round(m, 6)), n, tuple(c)) for m, c, n in expected.values())
    got = sorted(
        (tuple(np.round(m, 6)), int(n), tuple(c))
        for m, c, n in zip(found.points_world, found.colours, counts, strict=True)
    )
    for (point_a, n_a, colour_a), (point_b, n_b, colour_b) in zip(means, got, strict=True):
        np.testing.assert_allclose(point_a, point_b, atol=2e-6)
        np.testing.assert_allclose(colour_a, colour_b, atol=0.501)
        assert n_a == n_b


def test_memory_follows_the_voxels_and_not_the_points(monkeypatch):
    monkeypatch.setattr(point_cloud, "_MERGE_AT_LEAST", 1000)
    voxels, rng = VoxelCloud(0.5), np.random.default_rng(0)
    for _ in range(50):
        voxels.add(cloud_of(rng.uniform(0, 2, (500, 3))))
        waiting = sum(len(part.keys) for part in voxels._waiting)
        assert len(voxels) + waiting <= 4**3 + 1000 + 4**3
    cloud, counts = voxels.cloud()
    assert len(cloud) == 4**3
    assert counts.max() <= 50


def test_points_too_far_for_the_voxels_are_refused():
    refused("choose larger voxels", lambda: VoxelCloud(1e-6).add(cloud_of([[1e3, 0, 0]])))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("fuse") / "map"
    config = MapperConfig(
        min_depth_m=0.5, max_depth_m=4, planes=40, methods=("Alg1/H", "EMVS/cam0"),
        window_s=0.2, stride_s=0.1,
    )  # fmt: skip
    about = RecordingInfo(name="points", path="points")
    map_windows(fronto_parallel(1.5, points=1500), out, config, about, clouds=False)
    return out


def read_vertices(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    kinds = {"double": "<f8", "uchar": "u1", "int": "<i4"}
    lines = [line.split() for line in head.decode().splitlines() if line.startswith("property")]
    return np.frombuffer(body, [(name, kinds[kind]) for _, kind, name in lines])


def test_the_cloud_of_many_windows_lies_on_the_plane_that_was_seen(folder):
    where, info = fuse_windows(read_map(folder), FuseConfig(voxel_m=0.02))
    assert where == folder / "global" / "Alg1-H"
    vertices = read_vertices(where / "cloud.ply")
    assert len(vertices) == info.points > 200
    assert info.points < info.window_points
    assert np.median(np.abs(vertices["z"] - 1.5)) < 0.05
    assert vertices["windows"].max() > 1
    assert json.loads((where / "fuse.json").read_text())["points"] == info.points


def test_support_only_takes_points_away(folder):
    stored = read_map(folder)
    counts = [
        fuse_windows(stored, FuseConfig(voxel_m=0.05, min_windows=k))[1].points for k in (1, 2, 3)
    ]
    assert counts[0] > counts[1] > counts[2] > 0
    refused("lower min_windows", fuse_windows, stored, FuseConfig(voxel_m=0.05, min_windows=99))


def test_only_methods_that_were_mapped(folder):
    stored = read_map(folder)
    assert fuse_windows(stored, FuseConfig(), "EMVS/cam0")[0].name == "EMVS-cam0"
    with pytest.raises(InputError, match=r"no method 'Alg1/G', it has Alg1/H, EMVS/cam0"):
        fuse_windows(stored, FuseConfig(), "Alg1/G")


def test_the_same_cloud_twice(folder):
    stored = read_map(folder)
    first = (fuse_windows(stored, FuseConfig())[0] / "cloud.ply").read_bytes()
    assert (fuse_windows(stored, FuseConfig())[0] / "cloud.ply").read_bytes() == first


def slanted(camera, T_world_rv):
    """Depth of the plane z = 2 + x/4 of the world, in a view that may stand anywhere."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    bearing = camera.unproject(np.stack([u, v], axis=-1).astype(np.float64))
    rays = np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1)
    towards = rays @ T_world_rv[:3, :3].T
    centre = T_world_rv[:3, 3]
    depth_m = (2 + centre[0] / 4 - centre[2]) / (towards[..., 2] - towards[..., 0] / 4)
    return depth_m.astype(np.float32)


def test_a_mesh_lies_on_the_surface_that_was_seen(tmp_path):
    camera = Camera(80, 60, 70, 70, 39.5, 29.5)
    surface = SurfaceFusion(0.05)
    mask, colours = np.ones((60, 80), bool), np.full((60, 80, 3), 200, np.uint8)
    surface.add(slanted(camera, np.eye(4)), np.zeros((60, 80), bool), colours, camera, np.eye(4))
    for x_m in (-0.2, 0, 0.2):
        T_world_rv = np.eye(4)
        T_world_rv[0, 3] = x_m
        surface.add(slanted(camera, T_world_rv), mask, colours, camera, T_world_rv)
    mesh = surface.mesh(smallest_part=50)
    vertices = np.asarray(mesh.vertices)
    assert len(vertices) > 500
    assert np.abs(vertices[:, 2] - 2 - vertices[:, 0] / 4).max() < 0.05
    np.testing.assert_allclose(np.asarray(mesh.vertex_colors), 200 / 255, atol=0.01)
    write_mesh(tmp_path / "mesh.ply", mesh)
    assert (tmp_path / "mesh.ply").read_bytes().startswith(b"ply")


def test_an_empty_mesh_is_refused(tmp_path):
    refused("no surface found", write_mesh, tmp_path / "mesh.ply", SurfaceFusion(0.05).mesh())
    assert list(tmp_path.iterdir()) == []


def test_a_mesh_on_request(folder):
    where, info = fuse_windows(read_map(folder), FuseConfig(voxel_m=0.04, mesh=True))
    assert info.triangles > 100
    assert (where / "mesh.ply").stat().st_size > 1000
    where, info = fuse_windows(read_map(folder), FuseConfig(voxel_m=0.04))
    assert info.triangles is None
    assert not (where / "mesh.ply").exists()
