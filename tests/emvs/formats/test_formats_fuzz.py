"""Damaged event files of every format end in events or one clear line, in bounded memory and time.

`python tests/fuzz/fuzz_events.py` does the same for as many examples as one has patience for.
"""

import pytest

from fuzz_events import KINDS, ran


@pytest.mark.slow
def test_damage_ends_in_events_or_in_one_clear_line():
    assert ran("fuzz_events", 100) == set(KINDS)
