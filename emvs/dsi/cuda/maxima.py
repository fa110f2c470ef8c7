"""What a sweep on the GPU remembers of the planes: maxima of votes and of focus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from emvs.config import MapperConfig
from emvs.dsi.backend import InFocus, measure_of, needs_focus
from emvs.dsi.cuda import arrays, device, focus_kernels, fusion_kernels
from emvs.dsi.focus_measures import DOG_RATIO, half_window
from emvs.dsi.fusion_kernels import CAMERA
from emvs.dsi.maxima import AS_IT_IS, Maximum, beginnings
from emvs.dsi.method import Method, Tables

_SHARPNESS = {
    "variance": focus_kernels.SQUARE,
    "mean-square": focus_kernels.SQUARE,
    "gradient": focus_kernels.GRADIENT,
    "laplacian": focus_kernels.LAPLACIAN,
}
ROOM_IMAGES = 4  # per plane, beside the votes
STATE_BYTES = 4 * 4 + 4  # per pixel and method, at most


class DeviceFocus:
    """Peaks of the focus measure on the GPU; the twin of `emvs.dsi.backend.FocusFold`.

    Args:
        methods: the methods of one sweep; those without a focus measure are left alone.
        cameras: number of cameras.
        volumes: number of volumes.
        batch: most planes at a time.
        width_px: columns.
        height_px: rows.
        config: measure, scale and number of planes.
    """

    def __init__(
        self, methods: Sequence[Method], cameras: int, volumes: int, batch: int, width_px: int,
        height_px: int, config: MapperConfig,
    ) -> None:  # fmt: skip
        self._width_px, self._cells, self._planes = width_px, width_px * height_px, 0
        measured = needs_focus(methods, config)
        asked = any(m.focus and m.camera() is None for m in measured)

        def peak(method: Method) -> _Peak:
            camera, measure = method.camera(), measure_of(method, config)
            if camera is not None:
                return of_camera(camera, measure)
            tables = Tables.of((method,), volumes, config.polarities)
            return _Peak(tables, measure, self._cells, config.planes)

        def of_camera(camera: int, measure: str) -> _Peak:
            tables = _of_camera(camera, cameras, volumes, config.polarities)
            return _Peak(tables, measure, self._cells, config.planes)

        self._peaks = {method: peak(method) for method in measured}
        self._witnesses = [
            of_camera(c, config.focus_measure) for c in range(cameras if asked else 0)
        ]
        self._as_it_is = _on_device(Tables.of((AS_IT_IS,), 1))
        if measured:
            self._measure = _Measure(batch, width_px, self._cells, config)

    def take(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        for peak in (*self._peaks.values(), *self._witnesses):
            image = self._measure.image[:planes]
            fusion_kernels.fuse[device.strided(self._cells)](*peak.fusion, 0, votes, planes, image)
            value = self._measure.of(peak.measure, planes)
            fusion_kernels.fold[device.strided(self._cells)](
                *self._as_it_is, value.reshape(1, *value.shape), self._planes, planes,
                *peak.state.arrays,
            )  # fmt: skip
        self._planes += planes

    def found(self) -> dict[str, InFocus]:
        """What was found, by the methods' names, copied from the GPU."""

        def maximum(peak: _Peak) -> Any:
            return peak.state.maximum(0, self._width_px, self._planes)

        cameras = tuple(map(maximum, self._witnesses))
        return {
            method.name: InFocus(
                maximum(peak), cameras if method.focus and method.camera() is None else ()
            )
            for method, peak in self._peaks.items()
        }


class _Peak:
    """How one volume is fused, and the first maximum of its measure."""

    def __init__(self, tables: Tables, measure: str, cells: int, planes: int) -> None:
        self.measure = measure
        self.fusion = _on_device(tables)
        self.state = State(1, cells, planes, -np.inf)


def _on_device(tables: Tables) -> tuple[Any, ...]:
    return tuple(map(arrays.up, (tables.codes, tables.sizes, tables.which)))


def _of_camera(camera: int, cameras: int, volumes: int, polarities: int) -> Tables:
    """As a fusion: the sum of one camera's volumes, of all polarities and sub-intervals."""
    every = np.arange(volumes).reshape(polarities, cameras, -1)[:, camera].ravel()
    codes, sizes = np.array([[CAMERA, 0]]), np.array([[1, 1]])
    return Tables(codes, sizes, every.reshape(1, -1, 1, 1), np.arange(1))


class _Measure:
    """Focus measures of several planes, and the room that they need.

    Attributes:
        image: (P, cells) float32 on the GPU: the planes to measure.
    """

    def __init__(self, planes: int, width_px: int, cells: int, config: MapperConfig) -> None:
        self._width_px = width_px
        self._weights = [
            arrays.up(half_window(scale * config.focus_sigma_px)) for scale in (1, DOG_RATIO)
        ]
        self.image, *self._room = (
            arrays.empty((planes, cells), np.float32) for _ in range(ROOM_IMAGES)
        )

    def of(self, measure: str, planes: int) -> Any:
        """(P, cells) float32, the measure of the first `planes` planes of `image`."""
        image = self.image[:planes]
        spare, one, other = (room[:planes] for room in self._room)
        grid = device.strided(image.shape[1], planes)
        if measure == "dog":
            self._blur(image, self._weights[0], spare, one)
            self._blur(image, self._weights[1], spare, other)
            focus_kernels.subtract[grid](one, other)
            return one
        focus_kernels.sharpness[grid](_SHARPNESS[measure], image, self._width_px, other)
        self._blur(other, self._weights[0], spare, one)
        if measure == "variance":
            self._blur(image, self._weights[0], spare, other)
            focus_kernels.spread[grid](one, other)
        return one

    def _blur(self, image: Any, weight: Any, spare: Any, out: Any) -> None:
        grid = device.strided(image.shape[1], image.shape[0])
        focus_kernels.blur[grid](image, weight, self._width_px, 0, 1, spare)
        focus_kernels.blur[grid](spare, weight, self._width_px, 1, 0, out)


class State:
    """What `emvs.dsi.maxima.RunningMaxima` remembers, in the memory of the GPU.

    Attributes:
        arrays: best, index, left, right, previous, each (M, cells) on the GPU.
    """

    def __init__(self, images: int, cells: int, planes: int, lowest: float) -> None:
        self.arrays: tuple[Any, ...] = tuple(
            arrays.filled((images, cells), dtype, value)
            for dtype, value in beginnings(planes, lowest)
        )

    def maximum(self, image: int, width_px: int, planes: int) -> Maximum:
        """One image's maximum over the `planes` planes that have passed, copied from the GPU."""
        best, index, left, right = (
            arrays.down(one[image]).reshape(-1, width_px) for one in self.arrays[:4]
        )
        return Maximum(best, index, left, right, planes)


class DeviceMaxima:
    """State of the fold on the GPU; the methods share one split and have no function of their own.

    Args:
        methods: the methods.
        volumes: how many volumes there are.
        width_px: columns.
        height_px: rows.
        planes: how many planes will pass.
        polarities: 2 where each polarity has volumes of its own.
    """

    def __init__(
        self, methods: Sequence[Method], volumes: int, width_px: int, height_px: int,
        planes: int, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._methods, self._width_px, self._planes = tuple(methods), width_px, 0
        self._cells = width_px * height_px
        self._state = State(len(methods), self._cells, planes, -1)
        self._tables: tuple[Any, ...] = ()
        if methods:
            tables = Tables.of(methods, volumes, polarities)
            self._tables = tuple(map(arrays.up, (tables.codes, tables.sizes, tables.which)))

    def fold(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        if self._methods:
            fusion_kernels.fold[device.strided(self._cells, len(self._methods))](
                *self._tables, votes, self._planes, planes, *self._state.arrays
            )
        self._planes += planes

    def found(self) -> dict[str, Maximum]:
        """The maximum of every method over all planes so far, by name."""
        return {
            method.name: self._state.maximum(m, self._width_px, self._planes)
            for m, method in enumerate(self._methods)
        }
