"""The tool that times long recordings counts what every verb reads."""

import pytest

from long_recording import LARGER, costs, row


@pytest.mark.slow
def test_every_verb_runs_and_its_events_are_counted(tmp_path):
    one = 20_000
    found = list(costs(tmp_path, LARGER, one))
    both = 2 * LARGER * one
    assert [cost.events for cost in found] == [both, both // 2, both, both, both]
    assert len(list((tmp_path / "maps" / "1").glob("w*"))) == LARGER
    assert len(list((tmp_path / "maps" / str(LARGER)).glob("w*"))) == 1
    assert all(50 < cost.peak_mb < 2000 and cost.cpu_s > 0 for cost in found)
    assert row(found[0]).startswith("| `info` | ")
