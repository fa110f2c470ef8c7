"""Frame cameras beside the event cameras: their pictures are those of a camera in that place."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.data.image_stores import frame_cameras
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.scenes import load
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.simulate import simulate
from refusals import refused

OBLIQUE = RIGS["oblique"]
SAME = Rig("same", OBLIQUE.cameras[1:], OBLIQUE.T_body_cam[1:], ("again",))
FRAMES = {"rate_hz": 50.0, "exposure_us": 8000, "gain": 1.0}


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """A frame camera exactly where the second event camera is, and of its lens."""
    out = tmp_path_factory.mktemp("frames") / "planes"
    config = SimConfig(duration_s=0.05, frames=FRAMES, supersample=2, sampling="linear")
    rig = replace(OBLIQUE, frame_cameras=SAME)
    return Sequence.open(simulate(load("planes"), rig, config, 0, out))


def test_a_frame_camera_in_an_event_cameras_place_takes_its_pictures(sequence):
    """Drawn for itself, and integrated over the exposure, as those of the event camera's pixels."""
    again, *shared = frame_cameras(sequence)
    assert [each.shares for each in shared] == [0, 1]
    assert again.name == "again"
    assert again.pictures.t_us.tolist() == sequence.photo_times_us(1).tolist() == [20_000, 40_000]
    for k in range(2):
        one, two = again.photo(k), shared[1].photo(k)
        assert one[:2] == two[:2]
        off = np.abs(one.image.astype(int) - two.image)
        assert off.mean() < 1.0
        assert np.percentile(off, 99) <= 6


def test_what_was_seen_by_event_cameras_does_not_depend_on_it(sequence, tmp_path):
    config = SimConfig(duration_s=0.05, frames=FRAMES, supersample=2, sampling="linear")
    plain = Sequence.open(simulate(load("planes"), OBLIQUE, config, 0, tmp_path / "plain"))
    assert plain.manifest.event_counts == sequence.manifest.event_counts
    for k in range(2):
        name = f"cam{k}/events.h5"
        assert plain.manifest.files[name] == sequence.manifest.files[name]


def test_a_rig_keeps_its_frame_cameras(tmp_path):
    rig = RIGS["davis346-frames"]
    (tmp_path / "rig.json").write_text(json.dumps(rig.to_json()))
    read = read_rig(tmp_path / "rig.json")
    assert read.to_json() == rig.to_json()
    assert read.frame_cameras.cameras == rig.frame_cameras.cameras
    assert "frame_cameras" not in RIGS["davis346"].to_json()


def test_impossible_frame_cameras_are_refused():
    eye = Camera(8, 6, 5.0, 5.0, 4.0, 3.0)
    twice = Rig("twice", (eye,), (np.eye(4),), ("left",))
    refused("two cameras named 'left'", replace, RIGS["davis346"], frame_cameras=twice)
    nested = Rig("nested", (eye,), (np.eye(4),), ("a",), replace(twice, camera_names=("b",)))
    refused("frame cameras of frame cameras", replace, twice, frame_cameras=nested)
    with pytest.raises(InputError, match="needs a rig"):
        replace(twice, frame_cameras="grey")
