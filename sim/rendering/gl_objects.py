"""What is made in a graphics context beside MuJoCo: textures, framebuffers, shaders."""

from __future__ import annotations

import importlib
from contextlib import ExitStack
from typing import Any

from eventsweep.emvs.errors import InputError

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
