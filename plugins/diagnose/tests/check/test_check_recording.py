"""Checking what lies at a path: no poses, refusals, nothing there; what `map` warns of."""

from dataclasses import replace

import numpy as np
import pytest

from check_cases import FAULTS, UNSPOILT, Chosen
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.datasets import NoRecordingError, open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import write_events
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check import recording as checked
from eventsweep.plugins.diagnose.check.recording import check, quick_check
from eventsweep.plugins.diagnose.check.trial_windows import TrialWindows, WindowRecording
from head_world import DURATION_US, head_recording
from refusals import refused
from small_pair import small_sequence


class _WithoutPoses(Chosen):
    @property
    def trajectory(self):
        raise InputError("has no poses")


def test_a_recording_without_poses_is_checked_as_far_as_it_goes():
    report = check(_WithoutPoses(head_recording(), (0, 1)))
    assert report.verdict == "unchecked"
    assert {name for name, _ in report.unchecked} == {"poses", "parallax", "mapping"}
    assert report.finding("rectification") is not None


def test_what_cannot_be_opened_is_the_finding(tmp_path):
    folder = small_sequence(tmp_path / "seq")
    poses = folder / "poses.txt"
    poses.write_text(poses.read_text().replace(" 1", " 2"))
    report = check(folder)
    assert report.verdict == "wrong"
    (finding,) = report.findings
    assert (finding.name, finding.evidence) == ("opening", refused("", open_recording, folder))


@pytest.mark.parametrize("what", ["nothing", "empty", "file.txt"])
def test_what_is_no_recording_is_refused(tmp_path, what):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file.txt").write_text("no")
    with pytest.raises(NoRecordingError, match="needs"):
        check(tmp_path / what)


def test_mapping_may_be_left_out_and_then_nothing_is_called_good():
    report = check(head_recording(), mapping=False)
    assert not any(finding.name.startswith("mapping") for finding in report.findings)
    assert report.verdict == "unchecked"
    assert [name for name, _ in report.unchecked] == ["mapping"]


@pytest.mark.parametrize(
    "kind",
    ["positions in mm", "half the resolution", "clocks apart", "another sensor's calibration"],
)
def test_without_mapping_what_is_odd_gets_no_cure(kind):
    fault = next(fault for fault in FAULTS if fault.kind == kind)
    report = check(fault.plant(head_recording(), np.random.default_rng(3)), mapping=False)
    assert report.verdict == "wrong"
    assert not any(finding.cure for finding in report.findings)


def test_mapping_is_not_tried_on_nonsense_and_says_so():
    poses = head_recording().trajectory
    still = replace(poses, positions_m=np.zeros_like(poses.positions_m))
    report = check(AlteredRecording(head_recording(), trajectory=still))
    assert dict(report.unchecked)["mapping"] == "cure parallax first"


@pytest.mark.slow
def test_every_step_shows_and_answers_are_the_same_again():
    steps = []
    reports = [
        check(head_recording(), progress=lambda *step: steps.append(step)).to_json()
        for _ in range(2)
    ]
    assert reports[0] == reports[1]
    assert {stage for stage, _, _ in steps} == {"events", "alternatives"}
    assert all(done <= total for _, done, total in steps)


def test_the_quick_check_never_maps_and_leaves_out_what_mapping_refuses(monkeypatch):
    monkeypatch.setattr(checked, "check_by_mapping", lambda *_: pytest.fail("mapped"))
    assert quick_check(head_recording(), MapperConfig()) == []

    class Unreadable(Chosen):
        def events(self, camera, t0_us, t1_us):
            raise InputError("damaged")

    assert quick_check(Unreadable(head_recording(), (0, 1)), MapperConfig()) == []


def test_windows_keep_the_same_events_under_all_alternatives():
    kept = WindowRecording(head_recording(), 100_000, 300_000, 1000)
    events = kept.events(0, -(10**9), 10**9)
    assert len(events) == 1000
    assert events.t_us.min() >= 100_000
    assert events.t_us.max() < 300_000
    windows, _ = TrialWindows.of(head_recording(), MapperConfig())
    assert len(windows.windows) == len(windows.middles_us) == 3
    late = UNSPOILT["one camera"](head_recording(), np.random.default_rng(0))
    assert len(TrialWindows.of(late, MapperConfig())[0].windows) == 3


def test_poses_that_cover_no_window_are_a_reason_not_to_map():
    poses = head_recording().trajectory
    few = poses.t_us < 120_000
    short = Trajectory(poses.t_us[few], poses.positions_m[few], poses.quats_xyzw[few])
    shortened = AlteredRecording(head_recording(), trajectory=short)
    refused(r"needs 0\.2 s", TrialWindows.of, shortened, MapperConfig())
    assert check(shortened).finding("poses-coverage").verdict == "wrong"
    assert DURATION_US > 200_000


def test_a_bag_without_calibration_is_checked_for_its_events(tmp_path):
    t_us = np.arange(0, 400_000, 100)
    x = (np.arange(len(t_us)) % 60).astype(np.uint16)
    events = Events(x, x % 40, t_us, (np.arange(len(t_us)) % 3 % 2).astype(np.uint8))
    write_events(tmp_path / "a.bag", "rosbag1", 64, 48, {"/cam0/events": [events]})
    report = check(tmp_path / "a.bag")
    assert report.verdict != "wrong"
    assert ("mapping", "there is no calibration") in report.unchecked
