"""Every fault of the campaign, planted in a small recording, is named, and nothing else is."""

import numpy as np
import pytest

from check_cases import FAULTS, FILE_FAULTS, UNSPOILT
from dataset_world import rewritten
from eventsweep.emvs.check.recording import check, check_path
from eventsweep.emvs.data.writer import SequenceWriter
from head_world import head_recording

# Each takes seconds: one of each family is planted in every run, the others in slow ones.
ALWAYS = {
    "poses inverted", "quaternions w first", "OpenGL axes", "positions in mm", "poses late",
    "poses frozen", "camera at rest", "focal length off", "cameras swapped", "extrinsics inverted",
    "stereo yaw", "camera late", "rows mirrored", "hot pixels", "left-handed poses",
}  # fmt: skip


def planted():
    """Every fault; those that are not always planted are marked."""
    assert {one.kind for one in FAULTS} >= ALWAYS
    for one in FAULTS:
        marks = () if one.kind in ALWAYS else pytest.mark.slow
        yield pytest.param(one, id=one.kind, marks=marks)


@pytest.mark.parametrize("fault", list(planted()))
def test_a_planted_fault_is_named_first(fault):
    report = check(fault.plant(head_recording(), np.random.default_rng(3)))
    assert report.verdict == "wrong"
    assert report.suspects[0] in fault.named


@pytest.mark.parametrize("name", UNSPOILT)
def test_a_correct_recording_is_not_accused(name):
    report = check(UNSPOILT[name](head_recording(), np.random.default_rng(1)))
    assert report.suspects == ()
    assert any(one.name.startswith("mapping") for one in report.findings)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """The same recording on disk."""
    path, world = tmp_path_factory.mktemp("check") / "seq", head_recording()
    with SequenceWriter(
        path, name="head", rig=world.rig, trajectory=world.trajectory, config={},
        depth_range_m=world.depth_range_m,
    ) as writer:  # fmt: skip
        for camera, events in enumerate(world.streams):
            writer.append_events(camera, events)
    return path


@pytest.mark.parametrize("fault", FILE_FAULTS, ids=lambda one: f"{one.kind} {one.format}")
def test_a_fault_in_the_files_is_named_first(fault, sequence, tmp_path):
    folder = rewritten(sequence, tmp_path / "rewritten", fault.format)
    assert check_path(folder, mapping=False).verdict != "wrong"
    fault.edit(folder)
    assert check_path(folder).suspects[0] in fault.named
