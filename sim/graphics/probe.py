"""Opens a graphics context, draws in it and says what drew: a program of its own.

A driver can crash or hang the process that starts it, so `sim.graphics.choice` starts it here
first.
Usage: `python -P probe.py egl` (or osmesa); one line of JSON on standard output.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from typing import Any

_SIZE_PX = 16
_COLOUR = (51, 102, 204, 255)


def main(backend: str) -> None:
    """Prints vendor, renderer and version, and how many devices EGL lists."""
    os.environ["MUJOCO_GL"] = backend
    context = importlib.import_module(f"mujoco.{backend}").GLContext(_SIZE_PX, _SIZE_PX)
    context.make_current()
    gl: Any = importlib.import_module("OpenGL.GL")
    _draw(gl)
    driver: dict[str, Any] = {
        key: gl.glGetString(getattr(gl, f"GL_{key.upper()}")).decode(errors="replace")
        for key in ("vendor", "renderer", "version")
    }
    if backend == "egl":
        driver["devices"] = len(importlib.import_module("mujoco.egl").EGL.eglQueryDevicesEXT())
    sys.stdout.write(json.dumps(driver) + "\n")
    sys.stdout.flush()
    os._exit(0)  # tearing a driver down can crash


def _draw(gl: Any) -> None:
    """Clears an off-screen picture to a colour and reads it back."""
    gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, gl.glGenFramebuffers(1))
    gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, gl.glGenRenderbuffers(1))
    gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, gl.GL_RGBA8, _SIZE_PX, _SIZE_PX)
    gl.glFramebufferRenderbuffer(
        gl.GL_FRAMEBUFFER, gl.GL_COLOR_ATTACHMENT0, gl.GL_RENDERBUFFER,
        gl.glGetIntegerv(gl.GL_RENDERBUFFER_BINDING),
    )  # fmt: skip
    gl.glClearColor(*(value / 255 for value in _COLOUR))
    gl.glClear(gl.GL_COLOR_BUFFER_BIT)
    seen = gl.glReadPixels(0, 0, _SIZE_PX, _SIZE_PX, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE)
    if bytes(seen) != bytes(_COLOUR) * _SIZE_PX**2:
        raise RuntimeError("it drew the wrong colour")


if __name__ == "__main__":
    main(sys.argv[1])
