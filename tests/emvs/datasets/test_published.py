"""M3ED, VECtor, EVIMO2 and EDS as their publishers lay them out: truth, clocks, choices, faults."""

import h5py
import numpy as np
import pytest

import dataset_files
import dataset_world as world
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.formats import open_events
from eventsweep.eval.cli.main import main
from made_events import events_at
from refusals import refused


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("published")
    return Sequence.open(world.write_sequence(folder / "ours", "radtan", steps=200))


@pytest.mark.parametrize(("kind", "off_m"), [("m3ed", 1e-6), ("evimo2", 6e-4)])
def test_depth_at_the_sensors_pixels_becomes_that_of_the_view(sequence, tmp_path, kind, off_m):
    """M3ED's infinity and EVIMO2's 0 mean unknown; millimetres are rounded."""
    found = open_recording(dataset_files.WRITERS[kind](sequence, tmp_path / kind))
    assert found.truth_times_us(0).tolist() == list(world.TRUTH_US)
    for t_us in world.TRUTH_US:
        got, expected = found.truth_view_depth_m(0, t_us), sequence.truth_view_depth_m(0, t_us)
        known = np.isfinite(got)
        assert known.mean() > 0.8
        # The nearest pixel of the sensor lies up to half a pixel beside the view's.
        np.testing.assert_allclose(got[known], expected[known], atol=0.02 + off_m)


@pytest.mark.parametrize("kind", ["m3ed", "vector", "evimo2", "eds"])
def test_info_describes_them_and_they_convert(sequence, tmp_path, capsys, kind):
    write = {**dataset_files.WRITERS, **dataset_files.SINGLE}[kind]
    path = write(sequence, tmp_path / kind)
    assert main(["info", str(path), "--quiet"]) == 0
    capsys.readouterr()
    assert main(["convert", str(path), str(tmp_path / "ours"), "--to", "sequence", "--quiet"]) == 0
    before, after = open_recording(path), Sequence.open(tmp_path / "ours")
    for camera in range(len(before.rig)):
        one, two = (r.events(camera, 0, 1 << 40) for r in (before, after))
        np.testing.assert_array_equal(one.t_us, two.t_us)
        assert len(one) > 100


def test_a_camera_of_evimo2_alone_is_its_own_recording(sequence, tmp_path):
    path = dataset_files.write_evimo2(sequence, tmp_path / "e")
    assert len(open_recording(path).rig) == 2
    (path / "dataset_extrinsics.npz").unlink()
    found = open_recording(path)
    assert len(found.rig) == 1
    moved = sequence.trajectory.times(sequence.rig.T_body_cam[0])
    np.testing.assert_allclose(found.trajectory.positions_m, moved.positions_m, atol=1e-9)
    np.testing.assert_array_equal(found.trajectory.t_us, moved.t_us)


def test_evimo2s_cameras_are_brought_to_one_clock(sequence, tmp_path):
    """Times count from each camera's own bag, whose beginnings `meta` says."""
    path = dataset_files.write_evimo2(sequence, tmp_path / "e")
    right = tmp_path / "e" / "right_camera" / "sfm" / "eval" / "plane_000000" / "dataset_info.npz"
    meta = dataset_files.evimo2_meta(sequence, 1)
    meta["meta"]["ros_time_offset"] += 2.5
    np.savez(right, meta=meta)
    found = open_recording(path)
    for camera, late_us in enumerate((0, 2_500_000)):
        own_us = sequence.events(camera, 0, 1 << 40).t_us
        np.testing.assert_array_equal(found.events(camera, 0, 1 << 40).t_us, own_us + late_us)


def test_vectors_large_scale_is_tracked_by_a_lidar(sequence, tmp_path):
    """Sequences by name; both scales' calibrations lie in one folder."""
    path = dataset_files.write_vector(sequence, tmp_path / "v")
    small = open_recording(path).trajectory
    for file in path.glob("plane1.*"):
        file.rename(file.with_name(file.name.replace("plane1", "units_dolly1")))
    refused(r"lacks the pose of the left .* needs camera_lidar_extrinsic", open_recording, path)
    calib = path / "calib"
    joint = calib / "small_scale_joint_camera_extrinsic_results.yaml"
    marker = calib / "camera_mocap_extrinsic_results1.yaml"
    (calib / "large_scale_joint_camera_extrinsic_results.yaml").write_text(joint.read_text())
    lidar = marker.read_text().replace("T_cam_body", "T_cam_lidar")
    (calib / "camera_lidar_extrinsic_results.yaml").write_text(lidar)
    np.testing.assert_allclose(open_recording(path).trajectory.positions_m, small.positions_m)


def test_of_two_calibrations_beside_a_sequence_none_is_guessed(sequence, tmp_path):
    path = dataset_files.write_eds(sequence, tmp_path / "08_peanuts")
    own = path / "00_calib_results"
    own.rename(tmp_path / "00_calib_results")
    assert len(open_recording(path).rig) == 1
    other = tmp_path / "01_calib_results"
    other.mkdir()
    text = (tmp_path / "00_calib_results" / "camchain-kalibr.yaml").read_text()
    (other / "camchain-kalibr.yaml").write_text(text)
    refused("00_calib_results, 01_calib_results; copy the one for this", open_recording, path)


def test_a_lone_file_of_m3ed_is_described(sequence, tmp_path):
    path = dataset_files.write_m3ed(sequence, tmp_path / "m") / "plane_data.h5"
    found = open_readable(path)
    assert [name for name, _ in found.streams] == ["prophesee/left", "prophesee/right"]
    assert "m3ed" in found.what


@pytest.mark.parametrize("step_us", [333, 1000, 1700])
def test_m3eds_index_lacks_the_last_millisecond_and_no_event(tmp_path, step_us):
    """Slices that follow each other hold every event once, up to and beyond the last."""
    rng = np.random.default_rng(2)
    t_us = np.sort(rng.integers(0, 9_500, 800))
    path = tmp_path / "x_data.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("prophesee/left")
        dataset_files.write_m3ed_camera(group, events_at(rng, t_us, 1, 1))
        assert len(group["ms_map_idx"]) == t_us[-1] // 1000
    reader = open_events(path)
    parts = [reader.between("prophesee/left", t, t + step_us) for t in range(0, 13_000, step_us)]
    np.testing.assert_array_equal(np.concatenate([part.t_us for part in parts]), t_us)


def test_damage_to_m3ed_names_the_file(sequence, tmp_path):
    path = dataset_files.write_m3ed(sequence, tmp_path / "m")
    with h5py.File(path / "plane_data.h5", "r+") as file:
        del file["prophesee/right/t"]
    words = r"plane_data\.h5: lacks prophesee/right/t"
    refused(words, lambda: open_recording(path).event_span_us(1))
    with h5py.File(path / "plane_data.h5", "r+") as file:
        file["prophesee/left/calib/distortion_model"][()] = "fov"
    refused(r"plane_data\.h5: prophesee/left\.distortion_model", open_recording, path)
    with h5py.File(path / "plane_depth_gt.h5", "r+") as file:
        del file["depth"]
    refused("", open_recording, path)
