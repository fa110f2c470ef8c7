"""What MuJoCo's classic renderer draws into: textures of 8 bits, or of light without end.

MuJoCo's own buffer has 8 bits per channel, and OpenGL cuts lit vertex colours at 1. Both are
properties of the framebuffer: with a float one and clamping switched off the same commands give the
light as 32-bit numbers, at the same cost.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.rendering.gl_objects import GLObjects, opengl

Colours = NDArray[np.uint8] | NDArray[np.float32]
_CLAMPS = ("GL_CLAMP_VERTEX_COLOR", "GL_CLAMP_FRAGMENT_COLOR", "GL_CLAMP_READ_COLOR")
# Steps of a factor of two in the width of texels.
_LOD_BIAS = -0.75


class DrawTarget:
    """Stands in for the off-screen buffer of a `mujoco.MjrContext`, which must be current.

    With `floats`, light is in floating point; else 8 bits per channel. Only mirrors need a
    `stencil`, which costs software a twelfth of its time.

    Attributes:
        full_scale: the number that means 1 in the colours that `read` gives.
        colour: the texture of RGBA, bottom row first.
        depth: the texture of window depth, 1 near and 0 far.

    Raises:
        InputError: the graphics library offers no such framebuffer.
    """

    def __init__(
        self, context: Any, width_px: int, height_px: int, *, floats: bool, stencil: bool = True
    ) -> None:
        self.floats, self.full_scale = floats, 1.0 if floats else 255.0
        self._context, self._before = context, context.offFBO
        self._objects = GLObjects()
        try:
            self._make(width_px, height_px, stencil=stencil)
        except self._objects.errors as error:
            reason = " ".join(str(error).split())[:200]
            cure = "set light.renderer to classic, or lower supersample"
            raise InputError(
                f"this graphics library has no {'float ' if floats else ''}framebuffer of "
                f"{width_px}x{height_px} px ({reason}): {cure if floats else 'lower supersample'}"
            ) from error

    def _make(self, width_px: int, height_px: int, *, stencil: bool) -> None:
        gl, made = opengl(), self._objects
        self.colour = made.texture("GL_RGBA32F" if self.floats else "GL_RGBA8", width_px, height_px)
        texels = "GL_DEPTH32F_STENCIL8" if stencil else "GL_DEPTH_COMPONENT32F"
        self.depth = made.texture(texels, width_px, height_px)
        self._framebuffer = made.framebuffer(self.colour, self.depth, stencil=stencil)
        self._context.offFBO = self._framebuffer
        if self.floats:
            for name in _CLAMPS:
                gl.glClampColor(getattr(gl, name), gl.GL_FALSE)

    def bind(self) -> None:
        """Makes it what is drawn into and read from."""
        gl = opengl()
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._framebuffer)

    def read(self, height_px: int, width_px: int) -> tuple[Colours, NDArray[np.float32]]:
        """Colours (H, W, 3) and window depth (H, W) of what was drawn, bottom row first."""
        gl = opengl()
        shape = height_px, width_px, 3
        rgb: Colours = np.empty(shape, np.float32) if self.floats else np.empty(shape, np.uint8)
        numbers = gl.GL_FLOAT if self.floats else gl.GL_UNSIGNED_BYTE
        gl.glReadPixels(0, 0, width_px, height_px, gl.GL_RGB, numbers, rgb)
        return rgb, self.read_depth(height_px, width_px)

    def read_depth(self, height_px: int, width_px: int) -> NDArray[np.float32]:
        """The window depth alone."""
        gl, window_depth = opengl(), np.empty((height_px, width_px), np.float32)
        gl.glReadPixels(0, 0, width_px, height_px, gl.GL_DEPTH_COMPONENT, gl.GL_FLOAT, window_depth)
        return window_depth

    def free(self) -> None:
        """Gives the textures back; the context draws where it drew before."""
        self._context.offFBO = self._before
        self._objects.free()


def sharpen_textures(context: Any, stride: int = 1) -> None:
    """Takes textures 3/4 of a mip level finer than a sample is wide, in the current context.

    The mean over a pixel's samples removes what that leaves too sharp. So fine textures keep their
    contrast: at no bias they lose up to a tenth of it and events with it, at -1 aliasing adds some.
    Between two levels their mean is taken: the nearest one alone makes contrast jump with distance.
    In a picture's samples all but every `stride`-th are missing.
    """
    gl = opengl()
    targets, bias = (gl.GL_TEXTURE_2D, gl.GL_TEXTURE_CUBE_MAP), _LOD_BIAS - math.log2(stride)
    textures = context.texture[: context.ntexture]
    for kind, texture in zip(context.textureType, textures, strict=False):
        target = targets[int(bool(kind))]
        gl.glBindTexture(target, int(texture))
        gl.glTexParameterf(target, gl.GL_TEXTURE_LOD_BIAS, bias)
