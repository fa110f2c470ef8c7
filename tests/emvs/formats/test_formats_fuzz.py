"""Damaged event files of every format end in events or one clear line, in bounded memory and time.

`python tests/fuzz/fuzz_events.py` does the same for as many examples as one has patience for.
"""

from fuzz_events import KINDS, ran


def test_damage_ends_in_events_or_in_one_clear_line():
    assert ran("fuzz_events", examples=20) == set(KINDS)
