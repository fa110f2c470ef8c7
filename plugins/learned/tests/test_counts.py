"""What pages count of the training set is as many as there are."""

import pytest

from eventsweep.plugins.learned.training.sequences import sequences
from places import numbers_in, page
from study_samples import UNSEEN


def trained(part, what):
    return len({getattr(one, what) for one in sequences(part)})


def left_in_training():
    return {one.scene for one in sequences("training")} - {one.case for one in UNSEEN}


COUNTS = {
    "training": (
        "learned.md", r"simulates (\w+) sequences to learn from and (\w+) to calibrate with",
        lambda: [len(sequences("training")), len(sequences("calibration"))],
    ),
    "rigs": ("learned.md", r"(\w+) rigs, forward", lambda: [trained("training", "rig")]),
    "scenes never seen": (
        "learned.md",
        r"without the (\w+)\s+scenes\s+of\s+these\s+samples\s.*with\s+the\s+(\w+)\s+others",
        lambda: [len({one.case for one in UNSEEN}), len(left_in_training())],
    ),
    "what DERD-Net learns from": (
        "baselines.md", r"(\w+) simulated sequences, (\w+) scenes, (\w+) rigs",
        lambda: [len(sequences("training")), *(trained("training", w) for w in ("scene", "rig"))],
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", COUNTS)
def test_what_a_page_counts_is_as_many(what):
    name, pattern, counted = COUNTS[what]
    assert numbers_in(page(name), pattern) == counted()
