"""What refinement writes: a recording that opens as refined, beside what was there."""

import json

import numpy as np
import pytest

from dataset_world import rewritten, write_sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.calibration_writers import write_kalibr, write_opencv
from eventsweep.plugins.diagnose.calibrate.folder import INFO_FILE, write_refined
from eventsweep.plugins.diagnose.calibrate.refine import Estimate, RefineConfig, Refinement
from eventsweep.plugins.diagnose.parameters import Correction, parameters_of

NAMES = ("stereo", "delay", "focal", "pose-delay", "hand-eye", "lever")
VALUES = {
    "cam1 yaw": 0.4, "cam1 clock": -2.5, "focal length": 1.5, "pose clock": 3.0,
    "hand-eye pitch": 1.0, "lever z": 5.0,
}  # fmt: skip


def refinement_of(cameras=2, names=NAMES):
    estimates = tuple(
        Estimate(parameter, VALUES[parameter.name], 0.1) if parameter.name in VALUES
        else Estimate(parameter, 0.0, float("inf"), "flat")
        for parameter in parameters_of(names, cameras)
    )  # fmt: skip
    return Refinement(estimates, np.ones((3, 2)), ((0, 1),) * 3, RefineConfig(names))


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("ours") / "plane", "pinhole", steps=300)


def written(tmp_path, path):
    """The folder, the refined recording, and the notes."""
    out, refinement = tmp_path / "refined", refinement_of()
    out.mkdir()
    recording = open_recording(path)
    notes = write_refined(out, out, recording, refinement, "a command")
    return out, refinement.applied(recording), notes


def same_recording(ours, changed):
    for a, b in zip(ours.rig.T_body_cam, changed.rig.T_body_cam, strict=True):
        assert np.allclose(a, b, atol=1e-9)
    assert ours.rig.cameras == changed.rig.cameras
    assert (ours.trajectory.t_us == changed.trajectory.t_us).all()
    assert np.allclose(ours.trajectory.positions_m, changed.trajectory.positions_m, atol=1e-8)
    for k in range(len(ours.rig)):
        ours_us = ours.events(k, 100_000, 200_000).t_us
        assert len(ours_us)
        assert (ours_us == changed.events(k, 100_000, 200_000).t_us).all()


OWN = {
    "dsec": "cam_to_cam.yaml", "tumvie": "camera-calibrationA.json",
    "mvsec": "camchain-imucam-plane.yaml",
}  # fmt: skip


@pytest.mark.parametrize("kind", ["sequence", *OWN, "rosbag1", "npz"])
def test_what_is_written_opens_as_the_refined_recording_also_in_the_recordings_own_format(
    tmp_path, sequence, kind
):
    out, changed, _ = written(tmp_path, rewritten(sequence, tmp_path / kind, kind))
    same_recording(open_recording(out / "recording.toml"), changed)
    for file in out.rglob(OWN.get(kind, "none")):
        ours = read_rig(file)
        assert ours.cameras[0].fx_px == pytest.approx(changed.rig.cameras[0].fx_px)
        inside = [np.linalg.inv(rig.T_body_cam[0]) @ rig.T_body_cam[1]
                  for rig in (ours, changed.rig)]  # fmt: skip
        assert np.allclose(*inside, atol=1e-6)
    assert len([*out.rglob(OWN.get(kind, "none"))]) == (kind in OWN)


@pytest.mark.parametrize("write", [write_kalibr, write_opencv])
def test_a_described_recording_gets_a_file_of_the_kind_that_it_names(tmp_path, sequence, write):
    path = rewritten(sequence, tmp_path / "npz", "npz")
    write(path / "mine.yaml", open_recording(path).rig)
    descriptor = path / "recording.toml"
    descriptor.write_text(descriptor.read_text("utf-8").replace("rig.json", "mine.yaml"), "utf-8")
    out, changed, _ = written(tmp_path, path)
    fy_px = changed.rig.cameras[1].fy_px
    assert read_rig(out / "mine.yaml").cameras[1].fy_px == pytest.approx(fy_px)


def test_provenance_says_what_was_refined_from_what_and_notes_what_a_format_cannot_hold(
    tmp_path, sequence
):
    out, changed, notes = written(tmp_path, sequence)
    assert any("cannot store clock offsets" in note and "time_offset_us" in note for note in notes)
    assert any("hand-eye is in rig.json" in note for note in notes)
    info = json.loads((out / INFO_FILE).read_text("utf-8"))
    assert info["recording"]["manifest_sha256"] == changed.recording.manifest.digest()
    assert info["command"] == "a command"
    assert info["refine"] == list(NAMES)
    assert "eventsweep" in info["versions"]
    by_name = {estimate["parameter"]: estimate for estimate in info["estimates"]}
    assert by_name["cam1 yaw"]["correction"] == 0.4
    assert by_name["cam1 pitch"]["refused"] == "flat"
    assert by_name["cam1 pitch"]["uncertainty_95"] is None


def test_the_hash_of_other_formats_follows_their_content(tmp_path, sequence):
    path = rewritten(sequence, tmp_path / "npz", "npz")
    recording = open_recording(path)
    changed = Correction({parameters_of(("focal",), 2)[0]: 1.0}).applied(recording)
    digests = []
    for k, given in enumerate((recording, recording, changed)):
        out = tmp_path / f"out{k}"
        out.mkdir()
        write_refined(out, out, given, refinement_of())
        digests.append(json.loads((out / INFO_FILE).read_text("utf-8"))["recording"]["sha256"])
    assert digests[0] == digests[1] != digests[2]


def test_a_recording_without_files_is_written_without_a_descriptor(tmp_path, sequence):
    changed = Correction().applied(open_recording(sequence))
    notes = write_refined(tmp_path, tmp_path, changed, refinement_of())
    assert not (tmp_path / "recording.toml").exists()
    assert any("does not name its event files" in note for note in notes)
    assert (tmp_path / "rig.json").exists()
