"""Suites with blank pictures: most tests ask for numbers, and drawing takes longer than those."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_PLACE = "eventsweep.eval.report.suite_pictures"


@contextmanager
def blank_pictures() -> Iterator[None]:
    """Pictures of cases are written, but empty; there are none of methods."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"{_PLACE}.overview_png", lambda *_, **__: b"")
        patch.setattr(f"{_PLACE}.method_pictures", lambda *_: {})
        yield
