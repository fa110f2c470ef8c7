"""Odd values in results, rankings, submissions, archives and caches end in a page or one line.

`python plugins/ranking/tests/fuzz_results.py 1000` does the same for as long as one has patience.
"""

import pytest

from fuzz_events import LINE
from fuzz_results import KINDS
from places import ROOT
from programs import python


@pytest.mark.slow
def test_odd_values_end_in_a_page_or_one_clear_line():
    done = python(ROOT / "plugins" / "ranking" / "tests" / "fuzz_results.py", 40, timeout=None)
    kept = "is a damaged entry of the cache: it is kept as"
    assert [line for line in done.stderr.splitlines() if kept not in line] == []
    found = {match[1]: match.groups()[1:] for match in LINE.finditer(done.stdout)}
    assert {kind: faults for kind, (*_, faults) in found.items()} == dict.fromkeys(KINDS, "")
