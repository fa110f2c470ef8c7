"""Clouds, meshes and splats of every kind are read; what is damaged ends in one line."""

import numpy as np
import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.geometry.config import GeometryConfig
from eventsweep.plugins.geometry.pcd import read_pcd
from eventsweep.plugins.geometry.ply import read_ply, write_points
from eventsweep.plugins.geometry.readers import MOST_SAMPLES, read_geometry, sample_mesh
from refusals import refused
from room_world import ROOM, box_mesh, glb_bytes, ply_text, splat_bytes

CONFIG = GeometryConfig()
RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, (50, 3)).astype(np.float32).astype(np.float64)


def read(path, config=CONFIG):
    return read_geometry(str(path), config)


@pytest.fixture
def o3d():
    return pytest.importorskip("open3d")


@pytest.mark.parametrize("suffix", ["ply", "pcd"])
@pytest.mark.parametrize("how", [{"write_ascii": True}, {}, {"compressed": True}])
def test_clouds_of_open3d_are_read_as_they_are(tmp_path, o3d, suffix, how):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS))
    cloud.colors = o3d.utility.Vector3dVector(np.abs(POINTS))
    path = tmp_path / f"cloud.{suffix}"
    assert o3d.io.write_point_cloud(str(path), cloud, **how)
    found = read(path)
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)
    assert (found.kind, found.name) == ("points", "cloud")


def test_a_large_compressed_cloud_is_unpacked(tmp_path, o3d):
    """Long runs and far repeats, as real clouds have."""
    points = np.repeat(POINTS, 400, axis=0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    o3d.io.write_point_cloud(str(tmp_path / "c.pcd"), cloud, compressed=True)
    assert (tmp_path / "c.pcd").stat().st_size < 12 * len(points) / 2
    np.testing.assert_allclose(read_pcd(tmp_path / "c.pcd"), points, atol=1e-6)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off", "glb"])
def test_meshes_are_sampled_evenly(tmp_path, o3d, suffix):
    vertices, triangles = box_mesh(ROOM)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles)
    )
    mesh.compute_vertex_normals()
    mesh.compute_triangle_normals()
    if suffix == "glb":  # open3d writes such that it cannot read itself
        (tmp_path / "room.glb").write_bytes(glb_bytes(vertices, triangles))
    else:
        assert o3d.io.write_triangle_mesh(str(tmp_path / f"room.{suffix}"), mesh)
    found = read(tmp_path / f"room.{suffix}", GeometryConfig(samples_per_m2=100))
    e = ROOM[1] - ROOM[0]
    area = 2 * (e[0] * e[1] + e[1] * e[2] + e[0] * e[2])
    assert found.kind == "mesh"
    assert len(found.points) == int(np.ceil(100 * area))
    assert np.abs(found.points[:, None] - ROOM).min(axis=(1, 2)).max() < 1e-5
    on_floor = np.abs(found.points[:, 1] - ROOM[1, 1]) < 1e-5
    assert on_floor.sum() == pytest.approx(100 * e[0] * e[2], abs=4)


def test_samples_are_of_the_seed_and_shares_of_faces_exact():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0]], float)
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    points, area = sample_mesh(vertices, triangles, 200.0, 7)
    assert area == 1.5
    first = (points[:, 0] + points[:, 1] <= 1).sum()
    assert abs(first - 100) <= 1
    np.testing.assert_array_equal(points, sample_mesh(vertices, triangles, 200.0, 7)[0])
    assert not np.array_equal(points, sample_mesh(vertices, triangles, 200.0, 8)[0])
    middle = points[points[:, 0] + points[:, 1] <= 1][:, :2].mean(axis=0)
    np.testing.assert_allclose(middle, 1 / 3, atol=0.05)
    assert MOST_SAMPLES == 10_000_000


def test_splats_are_their_opaque_centres(tmp_path):
    logits = np.linspace(-4, 4, len(POINTS))
    (tmp_path / "splats.ply").write_bytes(splat_bytes(POINTS, logits))
    found = read(tmp_path / "splats.ply")
    np.testing.assert_allclose(found.points, POINTS[logits >= 0], atol=1e-6)
    assert found.kind == "splats"
    assert "25 centres of 50 splats" in found.about
    assert len(read(tmp_path / "splats.ply", GeometryConfig(least_opacity=0)).points) == 50
    refused("lower least_opacity", read, tmp_path / "splats.ply", GeometryConfig(least_opacity=1))


@pytest.mark.parametrize("order", ["little", "big"])
def test_binary_faces_of_any_number_of_corners(tmp_path, order):
    """A quad, a triangle and a line, behind an element that nobody needs and that has lists."""
    mark = {"little": "<", "big": ">"}[order]
    vertices, faces = box_mesh(ROOM)[0], [(0, 1, 3, 2), (4, 5, 6), (0, 1)]
    header = f"""ply
format binary_{order}_endian 1.0
comment made
element camera 2
property list uchar short seen
property double f
element vertex {len(vertices)}
property double x
property double y
property double z
element face {len(faces)}
property uchar flag
property list uchar int vertex_index
end_header
"""
    data = b"".join(
        b"\2" + np.array([1, 2], f"{mark}i2").tobytes() + np.array(5.0, f"{mark}f8").tobytes()
        for _ in range(2)
    )
    data += vertices.astype(f"{mark}f8").tobytes()
    for face in faces:
        data += b"\0" + bytes([len(face)]) + np.array(face, f"{mark}i4").tobytes()
    (tmp_path / "mesh.ply").write_bytes(header.encode() + data)
    found = read_ply(tmp_path / "mesh.ply")
    np.testing.assert_array_equal(found.triangles, [[0, 1, 3], [0, 3, 2], [4, 5, 6]])
    np.testing.assert_array_equal(found.vertices["z"], vertices[:, 2])


def test_ascii_faces(tmp_path):
    vertices, triangles = box_mesh(ROOM)
    (tmp_path / "mesh.ply").write_text(ply_text(vertices, triangles))
    found = read_ply(tmp_path / "mesh.ply")
    np.testing.assert_array_equal(found.triangles, triangles)
    assert read(tmp_path / "mesh.ply").kind == "mesh"


def test_an_organised_cloud_has_holes(tmp_path):
    header = "VERSION .7\nFIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 4\n"
    header += "WIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA "
    rows = np.zeros(4, [("p", "<f4", 3), ("pad", "u1", 4)])
    rows["p"] = [[1, 2, 3], [np.nan] * 3, [4, 5, 6], [7, 8, 9]]
    (tmp_path / "c.pcd").write_bytes((header + "binary\n").encode() + rows.tobytes())
    np.testing.assert_array_equal(read(tmp_path / "c.pcd").points, rows["p"][[0, 2, 3]])
    text = "".join(f"{a} {b} {c} 0 0 0 0\n" for a, b, c in rows["p"])
    (tmp_path / "d.pcd").write_text(header + "ascii\n" + text)
    np.testing.assert_array_equal(read(tmp_path / "d.pcd").points, rows["p"][[0, 2, 3]])


HEAD = "ply\nformat ascii 1.0\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
PCD = (
    "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA {d}\n"
)
REFUSED = {
    "empty.ply": ("", "is no PLY file"),
    "none.ply": (ply_text([]), "holds no points"),
    "nan.ply": (ply_text([[0, 0, 0], [0, np.nan, 0]]), "1 of 2 points are not finite"),
    "inf.ply": (ply_text([[np.inf, 0, 0]]), "1 of 1 points are not finite"),
    "vast.ply": (ply_text([[1e30, 0, 0]]), "needs coordinates in metres"),
    "faces.ply": (f"{HEAD}element face 0\nproperty list uchar int vertex_indices\nend_header\n",
                  "without the element vertex"),
    "claims.ply": (f"{HEAD}element vertex 1000000000000\n{XYZ}end_header\n0 0 0\n", "is cut off"),
    "short.ply": (f"{HEAD}element vertex 3\n{XYZ}end_header\n0 0 0\n", "is cut off"),
    "columns.ply": (f"{HEAD}element vertex 1\n{XYZ}end_header\n0 0\n", "have 2 numbers"),
    "words.ply": (f"{HEAD}element vertex 1\n{XYZ}end_header\n0 0 a\n", "are not rows of numbers"),
    "flat.ply": (f"{HEAD}element vertex 1\nproperty float x\nend_header\n0\n", "have no y, z"),
    "lists.ply": (f"{HEAD}element vertex 1\nproperty list uchar float x\nend_header\n1 0\n",
                  "hold lists"),
    "twice.ply": (f"{HEAD}element vertex 1\n{XYZ}property float x\nend_header\n0 0 0 0\n",
                  "named twice"),
    "order.ply": (f"ply\nelement vertex 0\n{XYZ}end_header\n", "names no format"),
    "endless.ply": (f"{HEAD}element vertex 0\n{XYZ}", "its header has no end"),
    "strange.ply": (f"{HEAD}element vertex 0\nproperty half x\nend_header\n", "not understood"),
    "index.ply": (ply_text([[0, 0, 0]] * 3, [[0, 1, 7]]), "a face names vertex 7"),
    "area.ply": (ply_text([[0, 0, 0]] * 3, [[0, 1, 2]]), "an area of 0 m²"),
    "empty.pcd": ("", "is no PCD file"),
    "short.pcd": (PCD.format(n=5, d="ascii") + "0 0 0\n", "is cut off"),
    "claims.pcd": (PCD.format(n=10**15, d="binary"), "is cut off"),
    "packed.pcd": (PCD.format(n=10**6, d="binary_compressed") + "abcdefgh", "is cut off"),
    "nan.pcd": (PCD.format(n=1, d="ascii") + "0 nan 0\n", "not finite"),
    "fields.pcd": ("FIELDS a b\nDATA ascii\n", "no fields x, y and z"),
    "width.pcd": (PCD.format(n="x", d="ascii"), "needs a whole number"),
    "cloud.las": ("LASF", "are not read; convert it"),
    "broken.glb": ("glTF no more", "open3d finds no triangles"),
    "none.obj": ("# nothing\n", "open3d finds no triangles"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_scored_is_refused_in_one_line(tmp_path, name):
    text, said = REFUSED[name]
    (tmp_path / name).write_text(text)
    assert name in refused(said, read, tmp_path / name)


def test_what_is_not_there_or_no_file_is_refused(tmp_path):
    assert "Errno" not in refused("No such file", read, tmp_path / "none.ply")
    (tmp_path / "folder.ply").mkdir()
    refused("is a folder", read, tmp_path / "folder.ply")
    refused("needs NAME=FILE", read, "=x.ply")


def test_columns_are_written_whole(tmp_path):
    columns = {"x": POINTS[:, 0], "kind": np.arange(50, dtype=np.uint8)}
    write_points(tmp_path / "a.ply", columns, ("a comment",))
    found = read_ply(tmp_path / "a.ply").vertices
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values)


def mutants(data, count, rng):
    """Bytes changed, cut, repeated; numbers of the header made huge, negative or words."""
    header_end = max(data.find(b"end_header"), data.find(b"DATA"), 20)
    for k in range(count):
        made = bytearray(data)
        kind = k % 6
        if kind == 0:
            for at in rng.integers(0, len(made), 3):
                made[at] = rng.integers(0, 256)
        elif kind == 1:
            at = int(rng.integers(0, header_end))
            made[at] = int(rng.choice(list(b"0123456789-. \nxfi")))
        elif kind == 2:
            del made[int(rng.integers(0, len(made))) :]
        elif kind == 3:
            a, b = sorted(rng.integers(0, len(made), 2))
            del made[a:b]
        elif kind == 4:
            digits = [at for at in range(header_end) if chr(made[at]).isdigit()]
            at = int(rng.choice(digits))
            made[at : at + 1] = rng.choice([b"99999999999", b"-1", b"0", b"nan", b"4294967295"])
        else:
            lines = bytes(made).split(b"\n")
            a, b = rng.integers(0, min(len(lines), 12), 2)
            lines[a], lines[b] = lines[b], lines[a]
            made = bytearray(b"\n".join(lines))
        yield bytes(made)


def sound_files():
    vertices, triangles = box_mesh(ROOM)
    yield "a.ply", ply_text(POINTS).encode()
    yield "m.ply", ply_text(vertices, triangles).encode()
    yield "s.ply", splat_bytes(POINTS, np.linspace(-4, 4, 50))
    header = ["ply", "format binary_big_endian 1.0", "element vertex 8", *XYZ.splitlines()]
    header += ["element face 12", "property list uchar int vertex_indices", "end_header", ""]
    faces = b"".join(b"\3" + face.astype(">i4").tobytes() for face in triangles)
    yield "b.ply", "\n".join(header).encode() + vertices.astype(">f4").tobytes() + faces
    yield "a.pcd", PCD.format(n=2, d="ascii").encode() + b"0 0 1\n1 0 0\n"
    yield "b.pcd", PCD.format(n=50, d="binary").encode() + POINTS.astype("<f4").tobytes()
    packed = b"\x1f" + POINTS.astype("<f4").T.tobytes()[:32] + b"\x40\x03"
    sizes = np.array([len(packed), 36], "<u4").tobytes()
    yield "c.pcd", PCD.format(n=3, d="binary_compressed").encode() + sizes + packed


def outcome(path):
    """What reading comes to: a geometry, or the line that refuses it."""
    try:
        return read(path, GeometryConfig(samples_per_m2=10))
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("each", [150, pytest.param(1000, marks=pytest.mark.slow)])
def test_mutants_of_every_file_are_read_or_refused(tmp_path, each):
    rng = np.random.default_rng(each)
    for name, data in sound_files():
        path, refusals = tmp_path / name, 0
        for made in mutants(data, each, rng):
            path.write_bytes(made)
            found = outcome(path)
            if isinstance(found, str):
                assert len(found.splitlines()) == 1
                assert str(path) in found
                refusals += 1
            else:
                assert len(found.points)
                assert np.isfinite(found.points).all()
        assert each / 20 < refusals < each - each / 20, name
