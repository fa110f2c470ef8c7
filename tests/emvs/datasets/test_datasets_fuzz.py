"""Damaged data sets, calibrations and poses end in a sound recording or one clear line.

`python tests/fuzz/fuzz_datasets.py 1000` does the same for as long as one has patience.
"""

import pytest

from fuzz_datasets import KINDS
from fuzz_events import ran


@pytest.mark.slow
def test_damage_ends_in_a_sound_recording_or_one_clear_line():
    assert ran("fuzz_datasets", 40) == set(KINDS)
