"""Damaged files end in sound values or one clear line, in bounded memory and time.

`python tests/fuzz/fuzz_events.py` and `fuzz_datasets.py 1000` do the same for as long as one has
patience: for event files of every format, and for data sets, calibrations and poses.
"""

import pytest

import fuzz_datasets
import fuzz_events


@pytest.mark.slow
@pytest.mark.parametrize(("script", "examples"), [(fuzz_events, 100), (fuzz_datasets, 40)])
def test_damage_ends_in_sound_values_or_in_one_clear_line(script, examples):
    assert fuzz_events.ran(script.__name__, examples) == set(script.KINDS)
