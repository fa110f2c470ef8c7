"""Damaged data sets, calibrations and poses end in a sound recording or one clear line.

`python tests/fuzz/fuzz_datasets.py 1000` does the same for as long as one has patience.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from fuzz_datasets import KINDS
from fuzz_events import LINE
from places import ROOT

EXAMPLES = 20
MOST_MB = 64


@pytest.fixture(scope="module")
def found():
    """What a run says of each kind."""
    script = ROOT / "tests" / "fuzz" / "fuzz_datasets.py"
    done = subprocess.run(
        [sys.executable, script, str(EXAMPLES)], capture_output=True, text=True, check=False
    )
    assert done.stderr == ""  # no library prints anything of its own
    return {match[1]: match.groups()[1:] for match in LINE.finditer(done.stdout)}


@pytest.mark.parametrize("kind", KINDS)
def test_damage_ends_in_a_sound_recording_or_one_clear_line(found, kind):
    done, refused, more_mb, faults = found[kind]
    assert faults == ""
    assert int(done) == EXAMPLES
    assert int(refused) > EXAMPLES // 4
    assert int(more_mb) < MOST_MB
