"""Damaged event files of every format end in events or one clear line, in bounded memory and time.

`python tests/fuzz/fuzz_events.py` does the same for as many examples as one has patience for.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from fuzz_events import KINDS, LINE
from places import ROOT

EXAMPLES = 60
MOST_MB = 64


@pytest.fixture(scope="module")
def found():
    """What a run says of each kind; in a process of its own, which may only reserve so much."""
    script = ROOT / "tests" / "fuzz" / "fuzz_events.py"
    done = subprocess.run(
        [sys.executable, script, str(EXAMPLES)], capture_output=True, text=True, check=False
    )
    return {match[1]: match.groups()[1:] for match in LINE.finditer(done.stdout)}


@pytest.mark.parametrize("kind", KINDS)
def test_damage_ends_in_events_or_in_one_clear_line(found, kind):
    done, refused, more_mb, faults = found[kind]
    assert faults == ""
    assert int(done) == EXAMPLES
    assert int(refused) > EXAMPLES // 4  # the damage is worth the name
    assert int(more_mb) < MOST_MB
