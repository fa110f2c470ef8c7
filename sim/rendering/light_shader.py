"""The samples of fine frames, worked out where a GPU has them: two float pictures come back.

The same arithmetic as `pixel_kernels` does, operation by operation, in passes over the picture:
luma and depth of all samples, through a lens where its table says. `precise` keeps a compiler from
joining product and sum into one rounding, which would move what a lens sees by 1e-4 of a sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.sim.rendering.base import Samples
from eventsweep.sim.rendering.draw_target import DrawTarget, GLObjects, opengl
from eventsweep.sim.rendering.fine_light import FineView, Image, Picture
from eventsweep.sim.rendering.pixel_kernels import LUMA, SAME_SURFACE

_HEADER = "#version 400 compatibility\n"
_VERTEX = _HEADER + "void main() { gl_Position = gl_Vertex; }\n"
# What a pass reads, by texture unit.
_SAMPLERS = "picture", "depths", "position", "slope"
# What MuJoCo may leave switched on that would keep a pass from writing its numbers.
_SWITCHES = ("DEPTH_TEST", "STENCIL_TEST", "SCISSOR_TEST", "ALPHA_TEST", "BLEND", "CULL_FACE",
             "DITHER", "CLIP_PLANE0")  # fmt: skip

_LUMA = """
uniform sampler2D picture;
float luma(ivec2 at) {
    vec3 rgb = %(rgb)s;
    precise float light = %(red)s * rgb.r + %(green)s * rgb.g + %(blue)s * rgb.b;
    return light;
}
"""

_LENS = """
uniform sampler2D position;
uniform sampler2D slope;
const float offset[%(S)d] = float[%(S)d](%(offsets)s);
vec2 place(ivec2 pixel, ivec2 part) {
    vec4 by = texelFetch(slope, pixel, 0);
    precise vec2 found = texelFetch(position, pixel, 0).xy + by.xz * offset[part.x]
                         + by.yw * offset[part.y];
    return found;
}
"""

_SAMPLES = (
    _LUMA
    + """
out float light;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    light = luma(ivec2(at.x, %(last_row)d - at.y));
}
"""
)

_DEPTHS = """
uniform sampler2D picture;
out float depth;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    depth = texelFetch(picture, ivec2(at.x, %(last_row)d - at.y), 0).r;
}
"""

# As `pixel_kernels.sample_of_one_surface`: `value` is the luma or the depth of a sample.
_LENS_BODY = """
uniform sampler2D depths;
float far_or_near(ivec2 at) { return texelFetch(depths, at, 0).r; }
out float light;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy), pixel = at / %(S)d;
    vec2 found = place(pixel, at - %(S)d * pixel);
    ivec2 corner = ivec2(found), right = corner + ivec2(1, 0);
    ivec2 up = corner + ivec2(0, 1), both = corner + ivec2(1, 1);
    precise vec2 share = found - vec2(corner);
    float d00 = far_or_near(corner), d01 = far_or_near(right);
    float d10 = far_or_near(up), d11 = far_or_near(both);
    float near = max(max(d00, d01), max(d10, d11)), far = min(min(d00, d01), min(d10, d11));
    precise float apart = near - far, limit = %(same)s * near;
    if (apart > limit) {
        light = value(corner + ivec2(int(share.x >= 0.5), int(share.y >= 0.5)));
        return;
    }
    float low = value(corner), high = value(up);
    precise float below = low + share.x * (value(right) - low);
    precise float above = high + share.x * (value(both) - high);
    precise float between = below + share.y * (above - below);
    light = between;
}
"""
_LENS_SAMPLES = _LUMA + _LENS + "float value(ivec2 at) { return luma(at); }" + _LENS_BODY
_LENS_DEPTHS = _LENS + (
    "uniform sampler2D picture;"
    "float value(ivec2 at) { return texelFetch(picture, at, 0).r; }" + _LENS_BODY
)


class NoShader(InputError):
    """A shader cannot work the light out here; `reason` says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"this graphics library cannot compute light in a shader ({reason}): use the CPU "
            "with StereoRenderer(..., shader=False)"
        )
        self.reason = reason


class _Picture(NamedTuple):
    """A float picture that passes draw into and read."""

    texture: int
    framebuffer: int


class _Passes(NamedTuple):
    """What one camera needs: programs, and the textures of its lens."""

    samples: int
    depths: int
    lens: tuple[int, ...]


class ShaderLight:
    """Works the light out in the graphics context that is current; see `fine_light.FineLight`.

    Raises:
        NoShader: the graphics library lacks something, or memory.
    """

    by = "light in a shader"

    def __init__(self, target: DrawTarget, views: Sequence[FineView]) -> None:
        self._gl, self._target, self._objects = opengl(), target, GLObjects()
        lacking: tuple[type[Exception], ...] = (InputError, *self._objects.errors)
        try:
            self._make(views)
        except lacking as error:
            self._objects.free()
            raise NoShader(" ".join(str(error).split())[:200]) from error

    def _make(self, views: Sequence[FineView]) -> None:
        # Cameras that are alike share what they need.
        compiled = cache(self._compiled)
        rows, columns = np.max([view.samples_shape for view in views], axis=0).tolist()
        self._picture = self._made(columns, rows)
        self._passes = {view: self._passes_of(view, compiled) for view in views}

    def _made(self, width_px: int, height_px: int) -> _Picture:
        texture = self._objects.texture("GL_R32F", width_px, height_px)
        return _Picture(texture, self._objects.framebuffer(texture))

    def _passes_of(self, view: FineView, compiled: Callable[[str], int]) -> _Passes:
        mapped, named = view.lens, self._constants(view)
        samples, depths = (_LENS_SAMPLES, _LENS_DEPTHS) if mapped else (_SAMPLES, _DEPTHS)
        tables: tuple[int, ...] = ()
        if mapped is not None:
            height_px, width_px = mapped.position.shape[:2]
            slope = mapped.step.reshape(height_px, width_px, 4)
            tables = (
                self._objects.texture("GL_RG32F", width_px, height_px, mapped.position),
                self._objects.texture("GL_RGBA32F", width_px, height_px, slope),
            )
        return _Passes(compiled(samples % named), compiled(depths % named), tables)

    def _constants(self, view: FineView) -> dict[str, object]:
        """What differs between cameras, as a shader writes it."""
        n, full_scale = view.supersample, self._target.full_scale
        texel = "texelFetch(picture, at, 0).rgb"
        red, green, blue = (_number(weight / full_scale) for weight in LUMA)
        return {
            "S": n, "last_row": view.picture_shape[0] - 1, "same": _number(float(SAME_SURFACE)),
            "rgb": texel if self._target.floats else f"floor({texel} * 255.0 + 0.5)",
            "red": red, "green": green, "blue": blue,
            "offsets": ", ".join(_number((k + 0.5) / n - 0.5) for k in range(n)),
        }  # fmt: skip

    def _compiled(self, fragment: str) -> int:
        gl, program = self._gl, self._objects.program(_VERTEX, _HEADER + fragment)
        gl.glUseProgram(program)
        for unit, name in enumerate(_SAMPLERS):
            gl.glUniform1i(gl.glGetUniformLocation(program, name), unit)
        gl.glUseProgram(0)
        return program

    def take(self, view: FineView, picture: Picture, samples: Samples) -> None:
        """See `fine_light.FineLight`."""
        passes, target, k = self._passes[view], self._target, view.stride
        shape = view.samples_shape if view.lens else view.picture_shape
        drawn = (passes.samples, target.colour), (passes.depths, target.depth)
        with self._flat():
            for (program, texture), part in zip(drawn, samples, strict=True):
                self._draw(program, shape, texture, target.depth, *passes.lens)
                part[picture.first_row :: k] = self._read(shape)

    @contextmanager
    def _flat(self) -> Iterator[None]:
        """Every number that a shader writes gets into the picture; afterwards all is as before."""
        gl = self._gl
        gl.glPushAttrib(gl.GL_ENABLE_BIT | gl.GL_VIEWPORT_BIT | gl.GL_TEXTURE_BIT)
        try:
            for name in _SWITCHES:
                gl.glDisable(getattr(gl, f"GL_{name}"))
            yield
        finally:
            gl.glUseProgram(0)
            gl.glPopAttrib()
            self._target.bind()

    def _draw(self, program: int, shape: tuple[int, int], *textures: int) -> None:
        gl, (rows, columns) = self._gl, shape
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._picture.framebuffer)
        gl.glViewport(0, 0, columns, rows)
        gl.glUseProgram(program)
        for unit, texture in enumerate(textures):
            gl.glActiveTexture(gl.GL_TEXTURE0 + unit)
            gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
        gl.glRectf(-1, -1, 1, 1)

    def _read(self, shape: tuple[int, int]) -> Image:
        gl, numbers = self._gl, np.empty(shape, np.float32)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._picture.framebuffer)
        gl.glReadPixels(0, 0, shape[1], shape[0], gl.GL_RED, gl.GL_FLOAT, numbers)
        return numbers

    def free(self) -> None:
        """See `fine_light.FineLight`."""
        self._objects.free()


def _number(value: float) -> str:
    """A float32 as a shader writes it: the nearest number to this text is that very one."""
    return repr(float(np.float32(value)))
