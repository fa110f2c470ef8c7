"""A float framebuffer for MuJoCo's classic renderer: linear light without steps and without end.

MuJoCo draws into 8 bits per channel, and OpenGL cuts lit vertex colours at 1. Both are properties
of the framebuffer: with a float one and clamping switched off the same commands give the light as
32-bit numbers, at the same cost.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError

_CLAMPS = ("GL_CLAMP_VERTEX_COLOR", "GL_CLAMP_FRAGMENT_COLOR", "GL_CLAMP_READ_COLOR")


class FloatTarget:
    """Stands in for the off-screen buffer of a MuJoCo context, which must be current.

    Args:
        context: a `mujoco.MjrContext`; draws into this target from here on.
        width_px: greatest width.
        height_px: greatest height.

    Raises:
        InputError: the graphics library offers no float framebuffer.
    """

    def __init__(self, context: Any, width_px: int, height_px: int) -> None:
        # Only now: importing it earlier would fix the platform before MuJoCo chooses it.
        self._gl: Any = importlib.import_module("OpenGL.GL")
        self._context, self._before = context, context.offFBO
        try:
            self._make(width_px, height_px)
        except (self._gl.error.Error, AttributeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"this graphics library has no float framebuffer ({reason}): "
                "set light.renderer to classic"
            ) from error
        context.offFBO = int(self._buffer)

    def _make(self, width_px: int, height_px: int) -> None:
        gl = self._gl
        self._buffer = gl.glGenFramebuffers(1)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._buffer)
        self._stores = gl.glGenRenderbuffers(2)
        formats = (
            (gl.GL_RGBA32F, gl.GL_COLOR_ATTACHMENT0),
            (gl.GL_DEPTH_COMPONENT32F, gl.GL_DEPTH_ATTACHMENT),
        )
        for store, (kind, place) in zip(self._stores, formats, strict=True):
            gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, store)
            gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, kind, width_px, height_px)
            gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, store)
        if gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER) != gl.GL_FRAMEBUFFER_COMPLETE:
            raise InputError(
                f"this graphics library has no float framebuffer of {width_px}x{height_px} px: "
                "set light.renderer to classic, or lower supersample"
            )
        for name in _CLAMPS:
            gl.glClampColor(getattr(gl, name), gl.GL_FALSE)

    def read(self, rgb: NDArray[np.float32], window_depth: NDArray[np.float32]) -> None:
        """Fills `rgb` (H, W, 3) and `window_depth` (H, W), bottom row first, after drawing."""
        gl = self._gl
        height, width = window_depth.shape
        gl.glReadPixels(0, 0, width, height, gl.GL_RGB, gl.GL_FLOAT, rgb)
        gl.glReadPixels(0, 0, width, height, gl.GL_DEPTH_COMPONENT, gl.GL_FLOAT, window_depth)

    def free(self) -> None:
        """Gives the buffers back; the context draws where it drew before."""
        self._context.offFBO = self._before
        self._gl.glDeleteRenderbuffers(2, self._stores)
        self._gl.glDeleteFramebuffers(1, [int(self._buffer)])
