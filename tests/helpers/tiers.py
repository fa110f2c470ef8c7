"""Which cases of a test are tried in every run; the others wait for `--run-slow`."""

from collections.abc import Collection, Iterable, Mapping

import pytest


def often(always: Collection, cases: Iterable) -> list:
    """Parameters: all `cases`, of which those that are not `always` tried are marked as slow.

    A mapping gives each case its name: in `always`, and as the parameter's id. A tuple is a value
    for each of the test's arguments.
    """
    named = cases if isinstance(cases, Mapping) else {case: case for case in cases}
    assert set(always) <= set(named)
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            id=name if isinstance(name, str) else None,
            marks=() if name in always else pytest.mark.slow,
        )
        for name, case in named.items()
    ]
