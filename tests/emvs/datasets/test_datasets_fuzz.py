"""Damaged data sets, calibrations and poses end in a sound recording or one clear line.

`python tests/fuzz/fuzz_datasets.py 1000` does the same for as long as one has patience.
"""

import pytest

from fuzz_datasets import KINDS
from fuzz_events import ran


@pytest.mark.parametrize("examples", [2, pytest.param(40, marks=pytest.mark.slow)])
def test_damage_ends_in_a_sound_recording_or_one_clear_line(examples):
    assert ran("fuzz_datasets", examples) == set(KINDS)
