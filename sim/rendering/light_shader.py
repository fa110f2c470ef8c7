"""The light of fine frames, worked out where a GPU has the samples: one float picture comes back.

The same arithmetic as `pixel_kernels` and `box_kernels` do, operation by operation, in passes over
the picture: samples to luma (through a lens: bilinear, where its table says), sums of S samples
down, sums of S to the right; and the nearest depth in every pixel. `precise` keeps a compiler from
joining product and sum into one rounding, which would move what a lens sees by 1e-4 of a sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.sim.rendering.draw_target import DrawTarget
from eventsweep.sim.rendering.fine_light import FineView, Image
from eventsweep.sim.rendering.gl_objects import GLObjects, opengl
from eventsweep.sim.rendering.pixel_kernels import LUMA

_HEADER = "#version 400 compatibility\n"
_VERTEX = _HEADER + "void main() { gl_Position = gl_Vertex; }\n"
# What a pass reads, by texture unit.
_SAMPLERS = "picture", "position", "slope"
# What MuJoCo may leave switched on that would keep a pass from writing its numbers.
_SWITCHES = ("DEPTH_TEST", "STENCIL_TEST", "SCISSOR_TEST", "ALPHA_TEST", "BLEND", "CULL_FACE",
             "DITHER", "CLIP_PLANE0")  # fmt: skip

_SUM = """
uniform sampler2D picture;
out float sum;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    precise float total = texelFetch(picture, at, 0).r;
    for (int q = 1; q < %(S)d; ++q) total += texelFetch(picture, at + q * ivec2(%(along)s), 0).r;
    precise float scaled = total * %(share)s;
    sum = scaled;
}
"""

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

_LENS_SAMPLES = (
    _LUMA
    + _LENS
    + """
out float light;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy), pixel = at / %(S)d;
    vec2 found = place(pixel, at - %(S)d * pixel);
    ivec2 corner = ivec2(found);
    precise vec2 share = found - vec2(corner);
    float low = luma(corner), high = luma(corner + ivec2(0, 1));
    precise float below = low + share.x * (luma(corner + ivec2(1, 0)) - low);
    precise float above = high + share.x * (luma(corner + ivec2(1, 1)) - high);
    precise float between = below + share.y * (above - below);
    light = between;
}
"""
)

_NEAREST = """
uniform sampler2D picture;
out float nearest;
void main() {
    ivec2 corner = %(S)d * (ivec2(gl_FragCoord.xy) + %(border)d);
    nearest = 0.0;
    for (int k = 0; k < %(S)d; ++k) for (int m = 0; m < %(S)d; ++m) {
        ivec2 at = ivec2(corner.x + m, %(last_row)d - corner.y - k);
        nearest = max(nearest, texelFetch(picture, at, 0).r);
    }
}
"""

_LENS_NEAREST = (
    "uniform sampler2D picture;"
    + _LENS
    + """
out float nearest;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) + %(border)d;
    nearest = 0.0;
    for (int k = 0; k < %(S)d; ++k) for (int m = 0; m < %(S)d; ++m) {
        ivec2 at = ivec2(place(pixel, ivec2(m, k)));
        float below = max(texelFetch(picture, at, 0).r,
                          texelFetch(picture, at + ivec2(1, 0), 0).r);
        float above = max(texelFetch(picture, at + ivec2(0, 1), 0).r,
                          texelFetch(picture, at + ivec2(1, 1), 0).r);
        nearest = max(nearest, max(below, above));
    }
}
"""
)


class NoShader(InputError):
    """A shader cannot work the light out here; `reason` says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"this graphics library cannot work light out in a shader ({reason}): let the CPU do "
            "it, by StereoRenderer's argument shader=False"
        )
        self.reason = reason


class _Picture(NamedTuple):
    """A float picture that passes draw into and read."""

    texture: int
    framebuffer: int


class _Passes(NamedTuple):
    """What one camera needs: programs, and the textures of its lens."""

    samples: int
    down: int
    right: int
    nearest: int
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
        self._pictures = self._picture(columns, rows), self._picture(columns, rows)
        self._passes = {view: self._passes_of(view, compiled) for view in views}

    def _picture(self, width_px: int, height_px: int) -> _Picture:
        texture = self._objects.texture("GL_R32F", width_px, height_px)
        return _Picture(texture, self._objects.framebuffer(texture))

    def _passes_of(self, view: FineView, compiled: Callable[[str], int]) -> _Passes:
        n, mapped = view.supersample, view.lens
        named = self._constants(view)
        samples, nearest = (_LENS_SAMPLES, _LENS_NEAREST) if mapped else (_SAMPLES, _NEAREST)
        tables: tuple[int, ...] = ()
        if mapped is not None:
            height_px, width_px = mapped.position.shape[:2]
            slope = mapped.step.reshape(height_px, width_px, 4)
            tables = (
                self._objects.texture("GL_RG32F", width_px, height_px, mapped.position),
                self._objects.texture("GL_RGBA32F", width_px, height_px, slope),
            )
        return _Passes(
            compiled(samples % named),
            compiled(_SUM % {"S": n, "along": "0, 1", "share": _number(1 / (n * n))}),
            compiled(_SUM % {"S": n, "along": "1, 0", "share": _number(1)}),
            compiled(nearest % named),
            tables,
        )

    def _constants(self, view: FineView) -> dict[str, object]:
        """What differs between cameras, as a shader writes it."""
        n, full_scale = view.supersample, self._target.full_scale
        texel = "texelFetch(picture, at, 0).rgb"
        red, green, blue = (_number(weight / full_scale) for weight in LUMA)
        return {
            "S": n, "border": view.border_px, "last_row": view.source_shape[0] - 1,
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

    def light(self, view: FineView) -> tuple[Image, Image]:
        """See `fine_light.FineLight`."""
        passes, (first, second) = self._passes[view], self._pictures
        rows, columns = view.samples_shape
        light_rows, light_columns = view.light_shape
        seen = view.sensor.height_px, view.sensor.width_px
        with self._flat():
            self._draw(passes.samples, first, (rows, columns), self._target.colour, *passes.lens)
            self._draw(passes.down, second, (light_rows, columns), first.texture)
            self._draw(passes.right, first, (light_rows, light_columns), second.texture)
            self._draw(passes.nearest, second, seen, self._target.depth, *passes.lens)
            return self._read(first, view.light_shape), self._read(second, seen)

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

    def _draw(
        self, program: int, picture: _Picture, shape: tuple[int, int], *textures: int
    ) -> None:
        gl, (rows, columns) = self._gl, shape
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, picture.framebuffer)
        gl.glViewport(0, 0, columns, rows)
        gl.glUseProgram(program)
        for unit, texture in enumerate(textures):
            gl.glActiveTexture(gl.GL_TEXTURE0 + unit)
            gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
        gl.glRectf(-1, -1, 1, 1)

    def _read(self, picture: _Picture, shape: tuple[int, int]) -> Image:
        gl, numbers = self._gl, np.empty(shape, np.float32)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, picture.framebuffer)
        gl.glReadPixels(0, 0, shape[1], shape[0], gl.GL_RED, gl.GL_FLOAT, numbers)
        return numbers

    def free(self) -> None:
        """See `fine_light.FineLight`."""
        self._objects.free()


def _number(value: float) -> str:
    """A float32 as a shader writes it: the nearest number to this text is that very one."""
    return repr(float(np.float32(value)))
