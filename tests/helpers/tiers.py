"""Which cases of a test are tried in every run; the others wait for `--run-slow`."""

from collections.abc import Collection, Iterable, Mapping

import pytest


def often(always: Collection, cases: Iterable) -> list:
    """Parameters: all `cases`, of which those that are not `always` tried are marked as slow.

    A case that is a tuple is a value for each of the test's arguments.
    """
    cases = [*cases]
    assert set(always) <= set(cases)
    return [_param(case, None, case in always) for case in cases]


def often_named(always: Collection, cases: Mapping) -> list:
    """As `often`, with names: those in `always`, and the parameters' ids."""
    assert set(always) <= set(cases)
    return [_param(case, name, name in always) for name, case in cases.items()]


def _param(case, name, always):
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, id=name, marks=() if always else pytest.mark.slow)
