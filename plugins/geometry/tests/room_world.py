"""A room with a thin pole, by formula: exact depth pictures, a sequence, its mesh, files of it."""

import json

import numpy as np

import eventsweep as es
from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.plugins.geometry.surfels import surfels_of
from point_world import pinhole, stereo_rig

ROOM = np.array([[-1.6, -1.0, -1.0], [1.6, 1.0, 3.0]])
POLE = np.array([[-0.22, -1.0, 1.5], [-0.17, 1.0, 1.55]])
CELL_M = 0.05


def depth_of(rays, origin):
    """(H, W) z-depth along (H, W, 3) rays of the world whose z is 1."""
    with np.errstate(divide="ignore"):
        wall = np.max((ROOM[:, None, None] - origin) / rays, axis=0).min(axis=-1)
        slabs = (POLE[:, None, None] - origin) / rays
    enter, leave = slabs.min(axis=0).max(axis=-1), slabs.max(axis=0).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, wall).astype(np.float32)


def trajectory(poses=6):
    t_us = np.arange(poses) * 50_000
    places = np.zeros((poses, 3))
    places[:, 0] = np.linspace(-0.4, 0.4, poses)
    return es.Trajectory(t_us, places, np.tile([0.0, 0, 0, 1], (poses, 1)))


def write_sequence(folder, camera=None, moving=False, name="room"):
    """A stereo rig that looks along z while it moves along x; `moving` says that the pole does."""
    camera = camera or pinhole(120, 90, 70.0)
    rig, poses = stereo_rig(camera, 0.1), trajectory()
    geoms = {0: Geom(name="room", dynamic=False), 1: Geom(name="pole", dynamic=True)}
    about = {"geoms": geoms} if moving else {}
    with SequenceWriter(folder, name=name, rig=rig, trajectory=poses, config={}, **about) as writer:
        for k, T_body_cam in enumerate(rig.T_body_cam):
            for t_us, T_world_body in zip(poses.t_us, poses.at(poses.t_us), strict=True):
                origin = (T_world_body @ T_body_cam)[:3, 3]
                depth_m = depth_of(camera.ray_table(), origin)
                on_pole = depth_m < ROOM[1, 2] - 1
                more = {"segmentation": on_pole.astype(np.int32)} if moving else {}
                grey = np.zeros(depth_m.shape, np.uint8)
                writer.append_truth(k, int(t_us), depth_m, grey, more)
    return folder


def one_view(cell_m=CELL_M):
    """The surfels of a single picture."""
    camera = pinhole(120, 90, 70.0)
    rays = camera.ray_table()
    return surfels_of(depth_of(rays, np.zeros(3)), rays, np.eye(4), 70.0, cell_m, 5.0)


def off_surface_m(points):
    """(N,) distance of points from the nearest wall, or side of the pole."""
    to_wall = np.abs(points[:, None] - ROOM).min(axis=(1, 2))
    out = np.maximum(np.maximum(POLE[0] - points, points - POLE[1]), 0)
    inside = np.minimum(points - POLE[0], POLE[1] - points).min(axis=1)
    to_pole = np.where((out == 0).all(axis=1), inside, np.linalg.norm(out, axis=1))
    return np.minimum(to_wall, to_pole)


def box_mesh(box):
    """Corners and triangles of a box."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1)
                        for k in (0, 1)])  # fmt: skip
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners, np.array(triangles)


def ply_text(vertices, faces=(), kind="float"):
    """An ASCII PLY."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {kind} {axis}" for axis in "xyz"]
    if len(faces):
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += ["end_header"]
    lines += [" ".join(map(repr, map(float, vertex))) for vertex in vertices]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    return "\n".join([*lines, ""])


def splat_bytes(centres, opacity_logit):
    """A binary PLY as 3D Gaussian splatting writes it."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rows = np.zeros((len(centres), len(names)), "<f4")
    rows[:, :3], rows[:, 9], rows[:, 10:13] = centres, opacity_logit, -4
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [*(f"property float {name}" for name in names), "end_header", ""]
    return "\n".join(header).encode() + rows.tobytes()


def glb_bytes(vertices, triangles):
    """A mesh as binary glTF: a header, a chunk of JSON, one of numbers."""
    places, corners = vertices.astype("<f4").tobytes(), triangles.astype("<u2").tobytes()
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": len(places)},
             {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)}]  # fmt: skip
    ends = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3", **ends},
        {"bufferView": 1, "componentType": 5123, "count": triangles.size, "type": "SCALAR"},
    ]
    content = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}], "bufferViews": views, "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(places) + len(corners)}],
    }  # fmt: skip
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    numbers = places + corners
    numbers += bytes(-len(numbers) % 4)
    chunks = [len(text).to_bytes(4, "little") + b"JSON" + text]
    chunks += [len(numbers).to_bytes(4, "little") + b"BIN\0" + numbers]
    whole = b"".join(chunks)
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(whole)).to_bytes(4, "little") + whole
