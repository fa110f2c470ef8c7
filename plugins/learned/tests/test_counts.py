"""What pages count of the training set is as many as there are."""

import pytest

from eventsweep.plugins.learned.training.sequences import sequences
from places import numbers_in, page
from study_samples import UNSEEN


def trained(part, what):
    return len({getattr(one, what) for one in sequences(part)})


COUNTS = {
    "training": (
        "learned.md", r"simulates (\w+) sequences to learn from and (\w+) to calibrate with",
        lambda: [len(sequences("training")), len(sequences("calibration"))],
    ),
    "rigs": ("learned.md", r"(\w+) rigs\. The network", lambda: [trained("training", "rig")]),
    "scenes never seen": (
        "learned.md", r"without the\s+(\w+)\s+scenes\s+of\s+these\s+samples",
        lambda: [len({one.case for one in UNSEEN})],
    ),
    "what DERD-Net learns from": (
        "baselines.md", r"on the (\w+) sequences of", lambda: [len(sequences("training"))],
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", COUNTS)
def test_what_a_page_counts_is_as_many(what):
    name, pattern, counted = COUNTS[what]
    assert numbers_in(page(name), pattern) == counted()
