"""A call that is killed at each step in which it changes the disk, one after another."""

import os
from unittest import mock

_STEPS = ("replace", "unlink", "rename", "rmdir", "mkdir", "link", "open", "fsync")
_KILLED = 9


def killed_at_every_step(call, check):
    """Calls `call` in processes that end without notice before their 1st, 2nd, ... step.

    Args:
        call: what is killed.
        check: called after every kill, with its number.

    Returns:
        How many times it was killed before it came through.
    """
    for step in range(1000):
        child = os.fork()
        if child == 0:
            _run(call, step)
        _, status = os.waitpid(child, 0)
        if os.waitstatus_to_exitcode(status) != _KILLED:
            assert status == 0, "it failed by itself"
            return step
        check(step)
    raise AssertionError("it does not end")


def _run(call, step):
    left = [step]

    def counted(do):
        def wrapper(*values, **named):
            if not left[0]:
                os._exit(_KILLED)
            left[0] -= 1
            return do(*values, **named)

        return wrapper

    patches = {name: counted(getattr(os, name)) for name in _STEPS}
    try:
        with mock.patch.multiple(os, **patches):
            call()
    except BaseException:
        os._exit(1)
    os._exit(0)
