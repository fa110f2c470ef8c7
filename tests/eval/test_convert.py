"""`eventsweep convert`: what goes in comes out, or is refused in one line."""

import itertools
import json
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conversion_chain import run_chain
from dataset_world import write_sequence
from event_files import ALL, READ_ONLY, WRITTEN, moving_edges, write_any
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.poses import read_poses, write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.dsec import read_disparity
from eventsweep.emvs.formats import calibration_writers as rigs
from eventsweep.emvs.formats import open_events, write_events
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.main import main
from eventsweep.eval.convert import Options, convert_file, targets
from eventsweep.eval.inspect import inspect
from eventsweep.sim.rigs import RIGS
from places import ROOT
from refusals import command_refused, line_of, untouched

SIZE_PX = (640, 480)
WIDE = {"width_px": 1280, "height_px": 720}
SIZE = ("--width-px", 640, "--height-px", 480)
# Zero, repeated, a burst that EVT3 writes as vectors, a gap beyond its clock, beyond 32 bits.
TIMES = [0, 0, 7, *[20_000_000] * 40, 1 << 33]


def converting(*words):
    return ["convert", *map(str, words), "--quiet"]


def run(*words) -> int:
    return main(converting(*words))


def events(times=TIMES) -> Events:
    x = np.arange(len(times), dtype=np.uint16)
    return Events(x, x // 40, np.array(times), (x % 32 > 2).astype(np.uint8))


def assert_same(path, kind, expected):
    reader = open_events(path)
    assert reader.format == kind
    got = Events.concat(list(reader.chunks(reader.streams[0])))
    for name in ("x", "y", "t_us", "p"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


@pytest.mark.parametrize(("first", "second"), [
    *itertools.pairwise([*WRITTEN, WRITTEN[0]]),
    *zip(READ_ONLY, itertools.cycle(["evt3", "npz", "rosbag1"])),
])  # fmt: skip
def test_each_event_format_becomes_another_and_keeps_every_event(tmp_path, first, second):
    """Each is read once and written once; other pairs are met on the walks below."""
    short = {"dat": 1 << 31, "v2e": (1 << 32) - 1}
    a, b, made = tmp_path / "a", tmp_path / "b", events([*TIMES[:-1], short.get(first, TIMES[-1])])
    write_any(a, first, SIZE_PX, [made])
    assert run(a, b, "--to", second, *SIZE) == 0
    assert_same(b, second, made)


STEPS_US = st.tuples(st.sampled_from([0, 1, 999, 4096, 2**24, 17_000_000]), st.integers(1, 40))


@settings(max_examples=8)
@given(
    order=st.permutations(WRITTEN), start_us=st.sampled_from([0, 2**24 - 1, 2**32 - 2]),
    steps_us=st.lists(STEPS_US, min_size=1, max_size=8),
)  # fmt: skip
@pytest.mark.slow
def test_events_survive_a_walk_through_all_formats(tmp_path, order, start_us, steps_us):
    stamps = start_us + np.cumsum([step for step, _ in steps_us])
    made = events(np.repeat(stamps, [count for _, count in steps_us]))
    path = write_any(tmp_path / "0", order[0], SIZE_PX, [made])
    for k, kind in enumerate(order[1:], 1):
        assert run(path, tmp_path / f"{k}", "--to", kind, *SIZE, "--force") == 0
        path = tmp_path / f"{k}"
        assert_same(path, kind, made)


class Shares:
    """A progress that remembers how far each stage came."""

    def __init__(self):
        self.seen = []

    @contextmanager
    def stage(self, title, total):
        yield lambda done, words: self.seen.append(done)

    def assert_all(self):
        """To all of it, never backwards."""
        assert self.seen == sorted(self.seen)
        assert self.seen[-1] > 0.9


@pytest.mark.parametrize("kind", ALL)
def test_every_format_says_how_much_of_it_is_read(tmp_path, kind):
    write_any(tmp_path / "a", kind, (1280, 720), moving_edges(400_000, packet=1 << 15))
    options = Options("dsec", **WIDE)
    for work, more in ((convert_file, (tmp_path / "b", options)), (inspect, ())):
        shares = Shares()
        work(tmp_path / "a", *more, shares)
        shares.assert_all()
        assert 0 < shares.seen[0] <= shares.seen[-1] <= 1


@pytest.mark.parametrize("kind", ["mvsec", "tumvie", "rosbag1", "npz"])
def test_recordings_say_it_of_all_cameras(tmp_path, kind):
    ours, shares = write_sequence(tmp_path / "ours", "kb4", steps=60), Shares()
    convert_file(ours, tmp_path / kind, Options(kind), shares)
    shares.assert_all()


def test_one_camera_of_a_recording_goes_into_one_file(tmp_path, capsys):
    ours = write_sequence(tmp_path / "ours", "kb4", steps=60)
    assert run(ours, tmp_path / "b", "--to", "evt3", "--stream", "cam1") == 0
    sequence = Sequence.open(ours)
    assert_same(tmp_path / "b", "evt3", sequence.events(1, 0, 10**6))
    command_refused(capsys, *converting(ours, tmp_path / "c", "--to", "evt3", "--stream", "cam7"))


@pytest.mark.slow
def test_memory_does_not_grow_with_the_file(tmp_path):
    chain = ("dsec", "evt3", "rosbag1", "npz", "mvsec", "csv")
    short, long = (run_chain(tmp_path, count, chain) for count in (4_000_000, 40_000_000))
    assert max(np.subtract(long, short)) < 30
    assert max(long) < 400


def test_a_shift_is_applied_and_printed(tmp_path, capsys):
    a, b = tmp_path / "a.txt", tmp_path / "b.raw"
    late = events()
    late = Events(late.x, late.y, late.t_us + (1 << 50), late.p)
    write_events(a, "text", *SIZE_PX, {"e": [late]})
    asked = ["convert", a, b, "--to", "evt3", *SIZE]
    command_refused(capsys, *asked, "--quiet")
    assert not b.exists()
    assert main([*map(str, asked), "--from-zero"]) == 0
    assert f"shifted by -{1 << 50} µs" in capsys.readouterr().err
    assert open_events(b).span_us("events") == (0, 1 << 33)


@pytest.mark.parametrize("words", ["a --to npz", "b --to nothing", "b --to sequence"])
def test_an_input_is_never_replaced_and_a_target_is_a_known_one(
    tmp_path, monkeypatch, capsys, words
):
    monkeypatch.chdir(tmp_path)
    write_events(tmp_path / "a", "npz", 64, 64, {"e": [events()]})
    with untouched(tmp_path):
        command_refused(capsys, *converting("a", *words.split()))


def test_an_input_in_the_place_of_its_output_is_kept_beside(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    write_events(tmp_path / "a", "npz", 64, 64, {"e": [events()]})
    before = (tmp_path / "a").read_bytes()
    assert main([*converting("a", "a", "--to", "evt3", "--force")]) == 0
    assert (tmp_path / "a.kept-1").read_bytes() == before
    assert "a.kept-1" in caplog.text


def test_depth_is_never_unpickled(tmp_path, capsys):
    path = tmp_path / "evil.npy"
    np.save(path, np.array([{"a": 1}], object), allow_pickle=True)
    command_refused(capsys, *converting(path, tmp_path / "b", "--to", "depth-npy"))


def test_slider_depth_becomes_a_bag_and_a_folder(shared_data, tmp_path):
    folder = tmp_path / "slider"
    assert run(shared_data / "slider_depth", folder, "--to", "evt3") == 0
    said = (folder / "recording.toml").read_text()
    assert 'file = "cam0.raw"' in said
    assert sum(len(p) for p in open_events(folder / "cam0.raw").chunks("events")) == 1_078_541


def poses(n=20) -> Trajectory:
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return Trajectory(np.arange(n) * 5000 + (1 << 45), rng.normal(size=(n, 3)), quats)


def test_trajectories_go_to_tum_and_kitti(tmp_path):
    made, a = poses(), tmp_path / "a.txt"
    write_tum(a, made)
    assert run(a, tmp_path / "b", "--to", "tum") == 0
    assert run(a, tmp_path / "c", "--to", "kitti") == 0
    got, T_world_body = read_poses(tmp_path / "b"), made.at(made.t_us)
    np.testing.assert_array_equal(got.t_us, made.t_us)
    np.testing.assert_allclose(got.at(made.t_us), T_world_body, atol=1e-9)
    rows = np.loadtxt(tmp_path / "c").reshape(-1, 3, 4)
    np.testing.assert_allclose(rows, T_world_body[:, :3], atol=1e-9)
    np.savetxt(tmp_path / "times.txt", made.t_us / 1e6, "%.6f")
    assert run(tmp_path / "c", tmp_path / "d", "--to", "tum") == 0
    assert np.array_equal(read_poses(tmp_path / "d").t_us, made.t_us)


def test_what_a_header_says_needs_no_flag_and_contradicts_one(tmp_path, capsys):
    path, tum = tmp_path / "p.csv", tmp_path / "p.tum"
    path.write_text("t_us,x,y,z,qw,qx,qy,qz\n5,1,2,3,1,0,0,0\n5,9,9,9,1,0,0,0\n9,1,2,3,1,0,0,0\n")
    assert run(path, tum, "--to", "tum") == 0
    assert "note: 1 of 3 poses repeat the time before them" in capsys.readouterr().err
    assert read_poses(tum).t_us.tolist() == [5, 9]
    assert read_poses(tum).quats_xyzw.tolist() == [[0, 0, 0, 1]] * 2
    assert "leave the setting out" in command_refused(
        capsys, "convert", path, tmp_path / "q", "--to", "tum", "--unit", "s"
    )


@pytest.mark.parametrize(("unit", "scale"), [("s", 1e-6), ("ms", 1e-3), ("us", 1), ("ns", 1000)])
def test_units_of_time(tmp_path, unit, scale):
    path = tmp_path / "p.txt"
    path.write_text(f"time,x,y,z,qx,qy,qz,qw\n{5_000_000 * scale},1,2,3,0,0,0,1\n")
    assert read_poses(path, unit).t_us.tolist() == [5_000_000]


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("kind", ["kalibr", "basalt", "opencv", "rig"])
def test_calibrations_come_back(tmp_path, name, kind):
    made, path = RIGS[name], tmp_path / ("rig.yaml" if kind in ("kalibr", "opencv") else "rig.json")
    if kind == "basalt" and made.cameras[0].model == "radtan":
        assert "cannot be written for Basalt" in line_of(rigs.write_basalt, path, made)
        return
    if kind == "kalibr" and any(any(camera.distortion[4:]) for camera in made.cameras):
        assert "Kalibr has no such coefficient" in line_of(rigs.write_kalibr, path, made)
        return
    rigs.WRITERS[kind](path, made)
    got = read_rig(path)
    for k in range(len(made)):
        np.testing.assert_allclose(got.T_body_cam[k], made.T_body_cam[k], atol=1e-9)
        assert got.cameras[k].K.tolist() == made.cameras[k].K.tolist()
        assert got.cameras[k].distortion[:4] == made.cameras[k].distortion[:4]


def test_opencv_reads_its_own_yaml(tmp_path):
    import cv2

    rigs.write_opencv(tmp_path / "c.yaml", RIGS["mvsec"])
    store = cv2.FileStorage(str(tmp_path / "c.yaml"), cv2.FileStorage_READ)
    np.testing.assert_array_equal(store.getNode("cam1_K").mat(), RIGS["mvsec"].cameras[1].K)
    assert store.getNode("cam0_model").string() == "fisheye"


def test_depth_maps_go_to_every_image_format(tmp_path, monkeypatch, capsys):
    import cv2

    monkeypatch.chdir(tmp_path)
    depth_m = np.array([[1.0, 2.5, 60.0], [0.5, 4.0, 8.0]], np.float32)
    mask = depth_m != 4.0
    np.savez("depth.npz", depth_m=depth_m, mask=mask, camera=json.dumps({"fx_px": 100.0}))
    known = np.where(mask, depth_m, np.nan)
    for kind in ("depth-png", "depth-npy", "depth-tiff"):
        assert run("depth.npz", kind, "--to", kind) == 0
    png, tiff = (cv2.imread(f"depth-{kind}", cv2.IMREAD_UNCHANGED) for kind in ("png", "tiff"))
    np.testing.assert_array_equal(png, np.where(mask, depth_m * 1000, 0))
    np.testing.assert_array_equal(tiff, known)
    np.testing.assert_array_equal(np.load("depth-npy"), known)
    asked = converting("depth.npz", "d.png", "--to", "disparity-png")
    command_refused(capsys, *asked)
    assert main([*asked, "--baseline-m", "0.1"]) == 0
    np.testing.assert_allclose(read_disparity(tmp_path / "d.png", 10.0), known, rtol=0.02)


@pytest.mark.slow
def test_clouds_go_to_pcd_and_back(tmp_path):
    import open3d as o3d

    points = np.random.default_rng(0).normal(size=(50, 3))
    a = tmp_path / "a.ply"
    o3d.io.write_point_cloud(str(a), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)))
    assert run(a, tmp_path / "b.pcd", "--to", "pcd") == 0
    assert run(tmp_path / "b.pcd", tmp_path / "c.ply", "--to", "ply") == 0
    got = np.asarray(o3d.io.read_point_cloud(str(tmp_path / "c.ply")).points)
    np.testing.assert_allclose(got, points, atol=1e-6)


def test_every_target_is_named_in_the_docs():

    text = (ROOT / "docs" / "formats.md").read_text()
    assert [name for name in targets() if f"`{name}`" not in text] == []
