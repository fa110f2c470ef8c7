"""Python in a process of its own, as its users start it."""

import os
import subprocess
import sys

from places import ROOT


def python(*arguments, path=(), env=None, **more) -> "subprocess.CompletedProcess[str]":
    """Runs this Python to its end with our packages in its path, those of `path` before them."""
    search = os.pathsep.join(str(one) for one in (*path, ROOT))
    env = os.environ | {"PYTHONPATH": search} | (env or {})
    settings = {"capture_output": True, "text": True, "check": False, "timeout": 300, **more}
    return subprocess.run([sys.executable, *map(str, arguments)], env=env, **settings)
