"""Every fault of the campaign, planted in a small recording, is named, and nothing else is."""

import numpy as np
import pytest

from check_cases import FAULTS, FILE_FAULTS, UNSPOILT
from dataset_world import rewritten
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.plugins.diagnose.check.recording import check
from head_world import head_recording, written
from planting import UNKNOWN
from tiers import often_named

# Each takes seconds: one of each family is planted in every run, the others in slow ones.
ALWAYS = {
    "positions in mm", "poses late", "poses frozen", "camera at rest", "hot pixels",
}  # fmt: skip
# Here more than one number is wrong: turned about several axes, or two, which are not named.
SEVERAL = {"hand-eye missing", "poses late, camera rolled"}
# Through so narrow a lens the two look alike.
TRADING_OFF = {"stereo yaw", "baseline off"}
# What else is called wrong first, without a cure. So few events fill few packets, and between their
# stamps there are none.
CALLED = {"events stamped by the host": {"gaps in the events"}}
ALWAYS_UNSPOILT = {"as simulated", "one camera", "poses of a tracked body"}
ALWAYS_IN_FILES = {"events not sorted csv"}


def first_suspects(report):
    """What is called wrong first: several where no recording of this rig can tell them apart."""
    return set(report.suspects[0].split(" or "))


@pytest.mark.parametrize("fault", often_named(ALWAYS, {f.kind: f for f in FAULTS}))
def test_a_planted_fault_is_named_first_and_a_new_kind_gets_no_wrong_cure(fault):
    report = check(fault.plant(head_recording(), np.random.default_rng(3)))
    right = {*fault.named, *CALLED.get(fault.kind, ())}
    if fault.is_new:
        assert not report.suspects or first_suspects(report) <= {*right, *UNKNOWN}
        return
    assert report.verdict == "wrong"
    several = set(UNKNOWN) if fault.kind in SEVERAL | TRADING_OFF else set()
    assert first_suspects(report) & (right | several)
    if fault.kind in TRADING_OFF:
        evidence = report.finding("mapping-1").evidence
        assert "stereo yaw" in evidence
        assert "baseline" in evidence


@pytest.mark.slow
def test_causes_that_no_recording_of_this_rig_can_tell_apart_are_named_together():
    """Cameras side by side and alike: exchanged, each is where the other's inverse says it is."""
    report = check(AlteredRecording(head_recording(), streams=(1, 0)))
    assert first_suspects(report) == {"cameras swapped", "extrinsics inverted"}


@pytest.mark.parametrize("tell", often_named(ALWAYS_UNSPOILT, UNSPOILT))
def test_a_correct_recording_is_not_accused(tell):
    report = check(tell(head_recording(), np.random.default_rng(1)))
    assert report.suspects == ()
    assert any(finding.name.startswith("mapping") for finding in report.findings)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """The same recording on disk."""
    return written(head_recording(), tmp_path_factory.mktemp("check") / "seq")


@pytest.mark.parametrize(
    ("form", "edit", "named"),
    often_named(ALWAYS_IN_FILES, {f"{kind} {form}": (form, *rest)
                                  for kind, form, *rest in FILE_FAULTS}),
)  # fmt: skip
def test_a_fault_in_the_files_is_named_first(form, edit, named, sequence, tmp_path):
    folder = rewritten(sequence, tmp_path / "rewritten", form)
    assert check(folder, mapping=False).verdict != "wrong"
    edit(folder)
    assert first_suspects(check(folder)) & named
