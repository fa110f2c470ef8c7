"""Truth that a `recording.toml` names gives the plane's depth, whatever form it comes in."""

import cv2
import numpy as np
import pytest

from dataset_world import (
    DISTANCE_M,
    NORMAL,
    TRUTH_US,
    plane_depth_m,
    rewritten,
    write_sequence,
)
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ground_truth import nearest_truth_us, truth_at
from eventsweep.emvs.datasets.own_truth import depth_of_points
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.cli.main import main
from refusals import refused
from tiers import often_named

LENS = "kb4"


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("ours") / "plane", LENS)


def described(ours, folder, table):
    """The recording in npz files, with a table `[truth]`."""
    out = rewritten(ours, folder / "recording", "npz")
    with (out / "recording.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n[truth]\n{table}\n")
    return out


def expected_m(recording, t_us, view):
    T_world_cam = recording.trajectory.at([t_us])[0] @ recording.rig.T_body_cam[0]
    return plane_depth_m(T_world_cam, view.bearing_table())


def write_times(out, names=None, unit=1e-6):
    lines = [f"{t * unit:.9f} {names[k] if names else ''}" for k, t in enumerate(TRUTH_US)]
    (out / "times.txt").write_text("# truth\n" + "\n".join(lines) + "\n")


def write_maps(out, form, kind="z", lens="undistorted", unit_m=1.0):
    """Maps of the three times, by formats' own libraries."""
    recording = open_recording_without_truth(out)
    camera = recording.rig.cameras[0]
    view = camera if lens == "sensor" else camera.undistorted()
    for k, t_us in enumerate(TRUTH_US):
        depth = expected_m(recording, t_us, view).astype(np.float64)
        if kind == "distance":
            bearing = view.bearing_table()
            depth *= np.linalg.norm(
                np.concatenate([bearing, np.ones((*depth.shape, 1))], -1), axis=-1
            )
        depth /= unit_m
        path = out / f"d{k}.{form}"
        if form == "png":
            cv2.imwrite(str(path), np.rint(np.nan_to_num(depth)).astype(np.uint16))
        elif form == "npz":
            np.savez(path, depth_m=depth, mask=np.isfinite(depth))
        elif form == "exr":
            exr = pytest.importorskip("OpenEXR")
            channel = {"Z": depth.astype(np.float32)}
            exr.File(
                {"type": exr.scanlineimage, "compression": exr.ZIP_COMPRESSION}, channel
            ).write(str(path))
        else:
            np.save(path, depth)
    return camera.undistorted()


def open_recording_without_truth(out):
    path = out / "recording.toml"
    text = path.read_text()
    path.write_text(text.split("\n[truth]")[0])
    recording = open_recording(out)
    path.write_text(text)
    return recording


@pytest.mark.parametrize(("form", "more", "unit_m", "within_m"), [
    ("npy", {}, 1.0, 1e-5), ("npz", {}, 1.0, 1e-5), ("exr", {}, 1.0, 1e-5),
    ("npy", {"kind": "distance"}, 1.0, 1e-5), ("png", {}, 0.001, 6e-4), ("png", {}, 0.0002, 2e-4),
    ("npy", {"lens": "sensor"}, 1.0, 0.02),
    ("npy", {"lens": "sensor", "kind": "distance"}, 0.01, 0.02),
])  # fmt: skip
def test_maps_in_files_are_the_plane(ours, tmp_path, form, more, unit_m, within_m):
    lines = [f'depth = "d*.{form}"', 'times = "times.txt"', f"unit_m = {unit_m}"]
    out = described(ours, tmp_path, "\n".join(lines + [f'{k} = "{v}"' for k, v in more.items()]))
    view = write_maps(out, form, unit_m=unit_m, **more)
    write_times(out)
    recording = open_recording(out)
    assert recording.truth_times_us(0).tolist() == list(TRUTH_US)
    for t_us in TRUTH_US:
        found, expected = truth_at(recording, t_us), expected_m(recording, t_us, view)
        known = np.isfinite(found)
        assert known.mean() > 0.8
        assert np.abs(found - expected)[known].max() < within_m


def test_names_in_the_times_choose_the_maps(ours, tmp_path):
    table = 'depth = "d*.npy"\ntimes = "times.txt"\ntime_unit = "ms"\ntime_offset_us = 5'
    out = described(ours, tmp_path, table)
    view = write_maps(out, "npy")
    (out / "d0.npy").rename(out / "dz.npy")
    write_times(out, ["dz.npy", "d1.npy", "maps/d2.npy"], unit=1e-3)
    recording = open_recording(out)
    assert recording.truth_times_us(0).tolist() == [t + 5 for t in TRUTH_US]
    found = recording.truth_view_depth_m(0, TRUTH_US[0] + 5)
    assert np.allclose(found, expected_m(recording, TRUTH_US[0], view), atol=1e-5, equal_nan=True)


def write_plane(path, mesh, unit_m=1.0, points=400_000):
    """The plane as two triangles or many points, in units of the file."""
    if mesh:
        xy = np.array([(-3.0, -3), (3, -3), (3, 3), (-3, 3)])
    else:
        xy = np.random.default_rng(0).uniform(-1.6, 1.6, (points, 2))
    xyz = np.column_stack([xy, (DISTANCE_M - xy @ NORMAL[:2]) / NORMAL[2]]) / unit_m
    faces = "element face 2\nproperty list uchar int vertex_indices\n" if mesh else ""
    header = f"ply\nformat ascii 1.0\nelement vertex {len(xyz)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + faces + "end_header\n"
    with path.open("w") as file:
        file.write(header)
        np.savetxt(file, xyz, "%.9f")
        file.write("3 0 1 2\n3 0 2 3\n" if mesh else "")


@pytest.mark.parametrize("mesh", often_named(["mesh"], {"mesh": True, "cloud": False}))
def test_a_surface_is_seen_from_every_pose(ours, tmp_path, mesh):
    pytest.importorskip("open3d")
    more = "" if mesh else "point_radius_m = 0.012"
    out = described(ours, tmp_path, f'surface = "hall.ply"\nunit_m = 0.001\n{more}')
    write_plane(out / "hall.ply", mesh, 0.001)
    recording = open_recording(out)
    view = recording.rig.cameras[0].undistorted()
    for t_us in (123_457, 250_000):
        assert nearest_truth_us(recording, t_us) == t_us
        found, expected = truth_at(recording, t_us), expected_m(recording, t_us, view)
        assert np.isfinite(found).mean() > 0.97
        off = np.abs(found - expected)[np.isfinite(found)]
        assert off.max() < (1e-4 if mesh else 0.03)
        assert np.median(off) < (1e-5 if mesh else 0.01)
    refused("no ground truth within", nearest_truth_us, recording, 10_000_000)


def test_near_points_hide_what_lies_behind():
    rng = np.random.default_rng(2)
    view = Camera(80, 60, 70, 70, 39.5, 29.5)
    near = np.column_stack([rng.uniform(-0.2, 0.2, (4000, 2)), np.full(4000, 1.0)])
    far = np.column_stack([rng.uniform(-2, 2, (40_000, 2)), np.full(40_000, 3.0)])
    points = np.concatenate([far, near])
    depth_m = depth_of_points(points, 0.02, view, np.eye(4))
    assert (depth_m[24:36, 34:46] == 1).mean() > 0.99
    assert (depth_m[:10] == 3).mean() > 0.95
    assert (depth_of_points(points, 1e-4, view, np.eye(4))[24:36, 34:46] == 3).any()


def test_a_map_is_scored_by_the_truth_of_its_own_recording(ours, tmp_path):
    out = described(ours, tmp_path, 'depth = "d*.npy"\ntimes = "times.txt"')
    write_maps(out, "npy")
    write_times(out)
    words = ("--map.min-depth-m", "1", "--map.max-depth-m", "4", "--map.reference-s", "0.25")
    folder = str(tmp_path / "map")
    assert main(["map", str(out), "--out", folder, *words, "--method", "Alg1/H", "--quiet"]) == 0
    near = ("--score.truth-tolerance-s", "0.001")
    assert main(["score", folder, *near, "--quiet"]) == 0


@pytest.mark.parametrize(("table", "prepare", "message"), [
    ("", None, "needs one of the keys depth or surface"),
    ('depth = "d*.npy"\nsurface = "h.ply"', None, "needs one of the keys"),
    ('depth = "d*.npy"', None, "needs the key times"),
    ('depth = "d*.npy"\ntimes = "t.txt"', None, r"t\.txt: cannot be read \(No such file"),
    ('depth = "d*.npy"\ntimes = "times.txt"', lambda out: None, "0 depth maps"),
    ('surface = "none.ply"', None, "none.ply: no such file"),
    ('depth = "d*.npy"\ntimes = "times.txt"\nunit_m = -1', None, "truth.unit_m"),
    ('depth = "d*.npy"\ntimes = "times.txt"\nunits = 1', None, "truth.units"),
])  # fmt: skip
def test_a_table_that_cannot_be_is_refused(ours, tmp_path, table, prepare, message):
    out = described(ours, tmp_path, table)
    if prepare is not None:
        write_times(out)
    refused(message, open_recording, out)


@pytest.mark.parametrize(("text", "message"), [
    ("0.2\n0.25\n", "3 depth maps .* for 2 times"),
    ("0.2\n0.2\n0.3\n", "must increase"),
    ("0.2 d0.npy\n0.25 d9.npy\n0.3 d2.npy\n", "no depth map 'd9.npy'"),
    ("0.2\n0.25 d1.npy\n0.3\n", "1 of 3 lines name an image; needs a name in all lines or in none"),
    ("0.1\nnow\n", r"line 2: now is not a time"), ("0.1\ninf\n", "needs one below 2"),
])  # fmt: skip
def test_times_that_cannot_be_are_refused(ours, tmp_path, text, message):
    out = described(ours, tmp_path, 'depth = "d*.npy"\ntimes = "times.txt"')
    write_maps(out, "npy")
    (out / "times.txt").write_text(text)
    refused(message, open_recording, out)


def test_maps_that_cannot_be_are_refused(ours, tmp_path):
    out = described(ours, tmp_path, 'depth = "d*.*"\ntimes = "times.txt"')
    write_times(out)
    (out / "d0.png").write_bytes(cv2.imencode(".png", np.ones((4, 4), np.uint16))[1].tobytes())
    np.save(out / "d1.npy", np.ones((4, 5)))
    (out / "d2.png").write_bytes(cv2.imencode(".png", np.ones((4, 4), np.uint8))[1].tobytes())
    recording = open_recording(out)
    for t_us, message in zip(TRUTH_US, ("set the key unit_m", "5 x 4 px", "16 bits"), strict=True):
        refused(message, truth_at, recording, t_us)


@pytest.mark.parametrize(("text", "words"), [
    (None, "set the key point_radius_m"), ("nothing", "neither a mesh nor a point cloud"),
])  # fmt: skip
def test_a_cloud_without_radius_and_what_is_none_are_refused(ours, tmp_path, text, words):
    pytest.importorskip("open3d")
    out = described(ours, tmp_path, 'surface = "hall.ply"')
    write_plane(out / "hall.ply", mesh=False, points=100)
    if text is not None:
        (out / "hall.ply").write_text(text)
    refused(words, truth_at, open_recording(out), 250_000)
