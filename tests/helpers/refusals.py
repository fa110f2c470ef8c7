"""What is refused, and with which words."""

import re

import pytest

from eventsweep.emvs.errors import InputError


def refused(words, call, /, *args, **kwargs):
    """What the call's `InputError` says: one line that holds the words.

    The words are a pattern, or several that it must all hold; a path stands for itself.
    """
    __tracebackhide__ = True
    with pytest.raises(InputError) as caught:
        call(*args, **kwargs)
    said = str(caught.value)
    assert len(said.splitlines()) == 1, said
    for one in words if isinstance(words, (list, tuple)) else [words]:
        pattern = one if isinstance(one, str) else re.escape(str(one))
        assert re.search(pattern, said), f"{one} is not in: {said}"
    return said
