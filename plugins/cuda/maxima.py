"""What a sweep on the GPU remembers of the planes: maxima of votes and of focus."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np

from eventsweep.emvs.dsi.focus_measures import DOG_RATIO, half_window
from eventsweep.emvs.dsi.fusion import Fusion, FusionTables, Target
from eventsweep.emvs.dsi.fusion_kernels import CAMERA
from eventsweep.emvs.dsi.maxima import AS_IT_IS, InFocus, Maximum, beginnings, per_camera_measures
from eventsweep.plugins.cuda import arrays, device, focus_kernels, fusion_kernels

_SHARPNESS = {
    "variance": focus_kernels.SQUARE,
    "mean-square": focus_kernels.SQUARE,
    "gradient": focus_kernels.GRADIENT,
    "laplacian": focus_kernels.LAPLACIAN,
}
SCRATCH_IMAGES = 4  # per plane, beside the votes
STATE_BYTES = 4 * 4 + 4  # per pixel and method, at most


class DeviceMaxima:
    """First maximum over planes of every target, on the GPU; the twin of `RunningMaxima`.

    The targets share one split, and none has a function of its own.
    """

    def __init__(
        self, targets: Sequence[Target], volumes: int, width_px: int, height_px: int,
        planes: int, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._targets, self._width_px, self._planes = tuple(targets), width_px, 0
        self._cells = width_px * height_px
        self._state = DeviceState(len(targets), self._cells, planes, -1)
        self._tables: tuple[Any, ...] = ()
        if targets:
            fusions = [target.fusion for target in targets]
            self._tables = _on_device(FusionTables.of(fusions, volumes, polarities))

    def update(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        if self._targets:
            fusion_kernels.fold[device.strided(self._cells, len(self._targets))](
                *self._tables, votes, self._planes, planes, *self._state.arrays
            )
        self._planes += planes

    def result(self) -> dict[str, Maximum]:
        """The maximum of every target over all planes so far, by name."""
        return {
            target.name: self._state.maximum(k, self._width_px, self._planes)
            for k, target in enumerate(self._targets)
        }


class DeviceState:
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
            arrays.down(state[image]).reshape(-1, width_px) for state in self.arrays[:4]
        )
        return Maximum(best, index, left, right, planes)


class DeviceFocusMaxima:
    """Maxima of the focus measure on the GPU; the twin of `emvs.dsi.maxima.FocusMaxima`.

    At most `batch` planes come at a time.
    """

    def __init__(
        self, targets: Sequence[Target], cameras: int, volumes: int, batch: int, width_px: int,
        height_px: int, sigma_px: float, *, planes: int, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._width_px, self._cells, self._planes = width_px, width_px * height_px, 0
        self._measured = [target for target in targets if target.in_focus]

        def of_camera(camera: int, measure: str) -> _Peak:
            tables = _of_camera(camera, cameras, volumes, polarities)
            return _Peak(tables, measure, self._cells, planes)

        def peak(fusion: Fusion, measure: str) -> _Peak:
            if fusion.camera is not None:
                return of_camera(fusion.camera, measure)
            tables = FusionTables.of((fusion,), volumes, polarities)
            return _Peak(tables, measure, self._cells, planes)

        self._peaks = {t.name: peak(t.fusion, t.measure or "") for t in self._measured}
        self._camera_peaks = {
            measure: [of_camera(camera, measure) for camera in range(cameras)]
            for measure in per_camera_measures(targets)
        }
        self._as_it_is = _on_device(FusionTables.of((AS_IT_IS,), 1))
        if self._measured:
            self._measure = _Measure(batch, width_px, self._cells, sigma_px)

    def update(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        for peak in chain(self._peaks.values(), *self._camera_peaks.values()):
            image = self._measure.image[:planes]
            fusion_kernels.fuse[device.strided(self._cells)](*peak.fusion, 0, votes, planes, image)
            value = self._measure.of(peak.measure, planes)
            fusion_kernels.fold[device.strided(self._cells)](
                *self._as_it_is, value.reshape(1, *value.shape), self._planes, planes,
                *peak.state.arrays,
            )  # fmt: skip
        self._planes += planes

    def result(self) -> dict[str, InFocus]:
        """Where each target's rays are most in focus, by its name, copied from the GPU."""

        def maximum(peak: _Peak) -> Maximum:
            return peak.state.maximum(0, self._width_px, self._planes)

        cameras = {m: tuple(map(maximum, peaks)) for m, peaks in self._camera_peaks.items()}
        return {
            target.name: InFocus(
                maximum(self._peaks[target.name]),
                cameras[target.measure or ""] if target.per_camera else (),
            )
            for target in self._measured
        }


class _Peak:
    """How one volume is fused, and the first maximum of its measure."""

    def __init__(self, tables: FusionTables, measure: str, cells: int, planes: int) -> None:
        self.measure = measure
        self.fusion = _on_device(tables)
        self.state = DeviceState(1, cells, planes, -np.inf)


def _of_camera(camera: int, cameras: int, volumes: int, polarities: int) -> FusionTables:
    """As a fusion: the sum of one camera's volumes, of all polarities and sub-intervals."""
    every = np.arange(volumes).reshape(polarities, cameras, -1)[:, camera].ravel()
    codes, sizes = np.array([[CAMERA, 0]]), np.array([[1, 1]])
    return FusionTables(codes, sizes, every.reshape(1, -1, 1, 1), np.arange(1))


def _on_device(tables: FusionTables) -> tuple[Any, ...]:
    return tuple(map(arrays.up, (tables.codes, tables.sizes, tables.which)))


class _Measure:
    """Focus measures of the planes in `image`, (P, cells) float32 on the GPU, and their scratch."""

    def __init__(self, planes: int, width_px: int, cells: int, sigma_px: float) -> None:
        self._width_px = width_px
        self._weights = [arrays.up(half_window(scale * sigma_px)) for scale in (1, DOG_RATIO)]
        self.image, *self._scratch = (
            arrays.empty((planes, cells), np.float32) for _ in range(SCRATCH_IMAGES)
        )

    def of(self, measure: str, planes: int) -> Any:
        """(P, cells) float32, the measure of the first `planes` planes of `image`."""
        image = self.image[:planes]
        spare, narrow, wide = (images[:planes] for images in self._scratch)
        grid = device.strided(image.shape[1], planes)
        if measure == "dog":
            self._blur(image, self._weights[0], spare, narrow)
            self._blur(image, self._weights[1], spare, wide)
            focus_kernels.subtract[grid](narrow, wide)
            return narrow
        focus_kernels.sharpness[grid](_SHARPNESS[measure], image, self._width_px, wide)
        self._blur(wide, self._weights[0], spare, narrow)
        if measure == "variance":
            self._blur(image, self._weights[0], spare, wide)
            focus_kernels.spread[grid](narrow, wide)
        return narrow

    def _blur(self, image: Any, weight: Any, spare: Any, out: Any) -> None:
        grid = device.strided(image.shape[1], image.shape[0])
        focus_kernels.blur[grid](image, weight, self._width_px, 0, 1, spare)
        focus_kernels.blur[grid](spare, weight, self._width_px, 1, 0, out)
