"""`eventsweep align` on made folders: what it writes, and what it refuses in one line."""

import json

import cv2
import h5py
import numpy as np
import pytest

import panel_world as world
from eventsweep.emvs.data.image_stores import frame_cameras
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.cli.main import main

FRAMES = Rig("panel, frames", (world.GREY,), (world.T_BODY_GREY,), ("grey",))


def write(path, *, poses=True, truth=True, frames=True):
    """The panel's world as a sequence folder."""
    made = world.PanelRecording(0)
    rig = Rig("panel", (world.EYE,), world.RIG.T_body_cam, ("eye",), FRAMES)
    trajectory = made.trajectory if poses else None
    settings = {"config": {}, "name": "panel", "span_us": made.trajectory.span_us}
    with SequenceWriter(path, rig=rig, trajectory=trajectory, **settings) as writer:
        writer.append_events(0, made.events(0, 0, 300_000))
        for t_us in made.truth_times_us(0) if truth else ():
            light = np.zeros((120, 160), np.uint8)
            writer.append_truth(0, int(t_us), made.truth_depth_m(0, int(t_us)), light)
        pictures = made.frame_cameras[0].pictures
        for k in range(len(pictures.t_us)) if frames else ():
            writer.append_beside(0, pictures.photo(k))
    return path


@pytest.fixture(scope="module")
def panel(tmp_path_factory):
    return write(tmp_path_factory.mktemp("made") / "panel")


def align(capsys, *arguments):
    code = main(["align", *map(str, arguments)])
    return code, capsys.readouterr()


def test_a_sequence_keeps_its_frame_camera(panel):
    (grey,) = frame_cameras(open_recording(panel))
    assert (grey.name, grey.camera, grey.shares) == ("grey", world.GREY, None)
    np.testing.assert_allclose(grey.T_body_cam, world.T_BODY_GREY, atol=1e-12)
    taken = world.PanelRecording(0).frame_cameras[0].pictures
    assert grey.pictures.t_us.tolist() == taken.t_us.tolist()
    np.testing.assert_array_equal(grey.photo(2).image, taken.photo(2).image)


def test_frames_masks_depth_and_residual_are_written(panel, tmp_path, capsys):
    code, said = align(capsys, panel, "--out", tmp_path / "a", "--apply", "--json")
    facts = json.loads(said.out)
    assert code == 0
    assert facts["frames"] == 6
    assert facts["residual_px"][0]["median_px"] < 0.5
    assert {each["name"] for each in facts["correction"]} >= {"clock", "rotation about z"}
    names = sorted(path.name for path in (tmp_path / "a" / "frames").iterdir())
    stamps = (tmp_path / "a" / "timestamps.txt").read_text().split()
    assert len(names) == len(stamps) == 6
    mask = cv2.imread(str(tmp_path / "a" / "mask" / names[0]), cv2.IMREAD_UNCHANGED)
    frame = cv2.imread(str(tmp_path / "a" / "frames" / names[0]), cv2.IMREAD_UNCHANGED)
    assert mask.shape == frame.shape == (120, 160)
    assert (frame[mask != 255] == 0).all()
    depth = cv2.imread(str(tmp_path / "a" / "depth" / names[0]), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    t_us = int(stamps[0])
    true_m, _, panel_on = world.hits(world.EYE, world.motion(0).at(min(t_us, 260_000)))
    assert np.median(np.abs(depth / 1000 - true_m)) < 2e-3
    assert panel_on.any()
    corrected = json.loads((tmp_path / "a" / "corrected.json").read_text())
    assert Rig.from_json(corrected).frame_cameras.camera_names == ("grey",)
    assert abs(corrected["frames_late_us"]["grey"]) < 2000
    rows = (tmp_path / "a" / "residual.csv").read_text().splitlines()
    assert rows[0].startswith("calibration,depth_from_m")
    assert {row.split(",")[0] for row in rows[1:]} == {"given", "corrected"}


def test_events_in_the_frame_cameras_pixels_open_as_dsecs(panel, tmp_path, capsys):
    out = tmp_path / "grey"
    arguments = ("--into", "grey", "--start-s", "0.1", "--duration-s", "0.04", "--images", "npz")
    code, _ = align(capsys, panel, "--out", out, *arguments)
    assert code == 0
    from eventsweep.emvs.formats import open_events

    reader = open_events(out / "events.h5")
    events = reader.between(reader.streams[0], 100_000, 140_000)
    assert len(events) > 1000
    assert events.x.max() < 220
    with h5py.File(out / "events.h5") as file:
        t, index = file["events/t"][()], file["ms_to_idx"][()]
        assert (t[index[index < len(t)]] >= 1000 * np.flatnonzero(index < len(t))).all()
    with h5py.File(out / "events_px.h5") as file:
        assert len(file["xy_px"]) == len(file["depth_m"]) == len(file["unsure"]) == len(events)
        said = json.loads((out / "alignment.json").read_text())["events"]
        assert said["aligned"] == len(events)
        assert said["unsure"] == file["unsure"][()].sum() > 0
    with np.load(sorted((out / "views").iterdir())[0]) as view:
        assert (view["mask"] == 255).all()
        assert view["image"].shape == view["depth_m"].shape == (170, 220)


def test_views_at_any_time_take_the_nearest_frame(panel, tmp_path, capsys):
    code, _ = align(capsys, panel, "--out", tmp_path / "t", "--at-s", "0.0735", "--at-s", "0.1")
    assert code == 0
    assert (tmp_path / "t" / "timestamps.txt").read_text().split() == ["73500", "100000"]
    frame = cv2.imread(str(tmp_path / "t" / "frames" / "000000.png"), cv2.IMREAD_UNCHANGED)
    mask = cv2.imread(str(tmp_path / "t" / "mask" / "000000.png"), cv2.IMREAD_UNCHANGED)
    light = 255 * world.hits(world.EYE, world.motion(0).at(73_500))[1]
    assert np.median(np.abs(frame.astype(float) - light)[mask == 255]) < 4


@pytest.mark.parametrize(("lacks", "line"), [
    ({"truth": False}, "has no ground truth of depth: add --depth, to a map folder"),
    ({"poses": False}, "has no poses (no poses.txt)"),
    ({"frames": False}, "no frame within the part and the poses"),
])  # fmt: skip
def test_what_is_missing_is_said_in_one_line(tmp_path, capsys, lacks, line):
    folder = write(tmp_path / "lacks", **lacks)
    code, said = align(capsys, folder, "--out", tmp_path / "out", "--quiet")
    assert code == 2
    assert line in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("flags", "line"), [
    (("--into", "moon"), "no camera 'moon' here; choose from eye, grey"),
    (("--depth", "nowhere"), "nowhere: no such map folder or depth file"),
    (("--at-s", "0.9"), "no pose at 900000 µs"),
    (("--start-s", "5"), "choose a part within them"),
    (("--depth-camera", "eye"), "--depth-camera without --depth-at-s"),
])  # fmt: skip
def test_wrong_flags_are_refused_before_anything_is_written(panel, tmp_path, capsys, flags, line):
    code, said = align(capsys, panel, "--out", tmp_path / "out", "--quiet", *flags)
    assert code == 2
    assert line in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["d.npy", "d.npz"])
def test_a_depth_file_of_the_frame_camera_does_as_well(panel, tmp_path, capsys, name):
    T_world_grey = world.motion(0).at(114_000) @ world.T_BODY_GREY
    depth_m = world.hits(world.GREY, T_world_grey)[0].astype(np.float32)
    if name == "d.npy":
        np.save(tmp_path / name, depth_m)
    else:
        np.savez(tmp_path / name, depth_m=depth_m)
    flags = "--depth", tmp_path / name, "--depth-camera", "grey", "--depth-at-s", "0.114"
    code, said = align(capsys, panel, "--out", tmp_path / "f", "--at-s", "0.114", *flags)
    assert code == 0, said.err
    mask = cv2.imread(str(tmp_path / "f" / "mask" / "000000.png"), cv2.IMREAD_UNCHANGED)
    light = 255 * world.hits(world.EYE, world.motion(0).at(114_000))[1]
    frame = cv2.imread(str(tmp_path / "f" / "frames" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert (mask == 255).mean() > 0.8
    assert (mask == 0).any()  # what the panel hides from the grey camera has no depth
    assert np.median(np.abs(frame.astype(float) - light)[mask == 255]) < 4
    code, said = align(capsys, panel, "--out", tmp_path / "g", *flags[:2])
    assert code == 2
    assert "by whom? add --depth-at-s, add --depth-camera" in said.err
