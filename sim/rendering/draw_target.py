"""What MuJoCo's classic renderer draws into: textures of 8 bits, or of light without end.

MuJoCo's own buffer has 8 bits per channel, and OpenGL cuts lit vertex colours at 1. Both are
properties of the framebuffer: with a float one and clamping switched off the same commands give the
light as 32-bit numbers, at the same cost.
"""

from __future__ import annotations

import importlib
import math
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError

Colours = NDArray[np.uint8] | NDArray[np.float32]
_CLAMPS = ("GL_CLAMP_VERTEX_COLOR", "GL_CLAMP_FRAGMENT_COLOR", "GL_CLAMP_READ_COLOR")
LOD_BIAS = -0.75
"""How much sharper textures of fine frames are, in steps of a factor of two in their texels."""


# Format of texels -> the format that OpenGL reads.
_INCOMING = {
    "GL_RGBA8": ("GL_RGBA", "GL_UNSIGNED_BYTE"),
    "GL_RGBA32F": ("GL_RGBA", "GL_FLOAT"),
    "GL_RG32F": ("GL_RG", "GL_FLOAT"),
    "GL_R32F": ("GL_RED", "GL_FLOAT"),
    "GL_DEPTH32F_STENCIL8": ("GL_DEPTH_COMPONENT", "GL_FLOAT"),
    "GL_DEPTH_COMPONENT32F": ("GL_DEPTH_COMPONENT", "GL_FLOAT"),
}


def opengl() -> Any:
    """PyOpenGL's module; to import it earlier would fix the platform before MuJoCo chooses it."""
    return importlib.import_module("OpenGL.GL")


class GLObjects:
    """Makes objects of the graphics context that is current, and deletes them all at once."""

    def __init__(self) -> None:
        self._gl, self._made = opengl(), ExitStack()

    @property
    def errors(self) -> tuple[type[Exception], ...]:
        """What is raised where the graphics library lacks something."""
        return self._gl.error.Error, AttributeError, RuntimeError

    def texture(self, texels: str, width_px: int, height_px: int, data: Any = None) -> int:
        """Makes a texture that is read texel by texel; their format is one of `_INCOMING`.

        `data` is (H, W, channels), row 0 first; without it, the texture holds whatever lies there.

        Raises:
            InputError: larger than the graphics library can.
        """
        gl = self._gl
        longest_px = int(gl.glGetIntegerv(gl.GL_MAX_TEXTURE_SIZE))
        if max(width_px, height_px) > longest_px:
            raise InputError(
                f"an image of {width_px}x{height_px} samples is needed, but this graphics "
                f"library allows {longest_px} per side: lower supersample"
            )
        number = int(gl.glGenTextures(1))
        self._made.callback(gl.glDeleteTextures, [number])
        gl.glBindTexture(gl.GL_TEXTURE_2D, number)
        for which in (gl.GL_TEXTURE_MIN_FILTER, gl.GL_TEXTURE_MAG_FILTER):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, which, gl.GL_NEAREST)
        incoming = (getattr(gl, name) for name in _INCOMING[texels])
        gl.glTexImage2D(
            gl.GL_TEXTURE_2D, 0, getattr(gl, texels), width_px, height_px, 0, *incoming, data
        )
        gl.glBindTexture(gl.GL_TEXTURE_2D, 0)
        return number

    def framebuffer(self, colour: int, depth: int | None = None, *, stencil: bool = False) -> int:
        """Makes a framebuffer that draws into textures, and binds it.

        With `stencil`, that of depth holds one as well.

        Raises:
            RuntimeError: the graphics library cannot draw into these.
        """
        gl = self._gl
        number = int(gl.glGenFramebuffers(1))
        self._made.callback(gl.glDeleteFramebuffers, 1, [number])
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, number)
        deep = gl.GL_DEPTH_STENCIL_ATTACHMENT if stencil else gl.GL_DEPTH_ATTACHMENT
        places = {gl.GL_COLOR_ATTACHMENT0: colour, deep: depth}
        for place, texture in places.items():
            if texture is not None:
                gl.glFramebufferTexture2D(gl.GL_FRAMEBUFFER, place, gl.GL_TEXTURE_2D, texture, 0)
        status = gl.glCheckFramebufferStatus(gl.GL_FRAMEBUFFER)
        if status != gl.GL_FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"a framebuffer is incomplete, status {int(status):#x}")
        # Some libraries take memory only when something is drawn: what they lack, they say here.
        gl.glClear(gl.GL_COLOR_BUFFER_BIT)
        gl.glFinish()
        return number

    def program(self, vertex: str, fragment: str) -> int:
        """Compiles a shader.

        Raises:
            RuntimeError: the graphics library does not take it.
        """
        gl, shaders = self._gl, importlib.import_module("OpenGL.GL.shaders")
        parts = (
            shaders.compileShader(vertex, gl.GL_VERTEX_SHADER),
            shaders.compileShader(fragment, gl.GL_FRAGMENT_SHADER),
        )
        number = int(shaders.compileProgram(*parts, validate=False))
        self._made.callback(gl.glDeleteProgram, number)
        return number

    def free(self) -> None:
        """Deletes them; the context that they were made in must be current."""
        self._made.close()


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
    targets, bias = (gl.GL_TEXTURE_2D, gl.GL_TEXTURE_CUBE_MAP), LOD_BIAS - math.log2(stride)
    textures = context.texture[: context.ntexture]
    for kind, texture in zip(context.textureType, textures, strict=False):
        target = targets[int(bool(kind))]
        gl.glBindTexture(target, int(texture))
        gl.glTexParameterf(target, gl.GL_TEXTURE_LOD_BIAS, bias)
