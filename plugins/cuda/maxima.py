"""What a sweep on the GPU remembers of the planes: maxima of votes and of focus."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

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
    """First maximum over planes of every volume, on the GPU; the twin of `RunningMaxima`.

    The fusions of `tables` share one split, and none has a function of its own; `lowest` is what
    every value exceeds.
    """

    def __init__(
        self, tables: FusionTables, width_px: int, height_px: int, planes: int, lowest: float = -1
    ) -> None:
        self._size, self._count, self._passed = (height_px, width_px), len(tables.codes), 0
        self._tables = _on_device(tables)
        shape = self._count, width_px * height_px
        self._state: tuple[Any, ...] = tuple(
            arrays.fill(arrays.empty(shape, dtype), value)
            for dtype, value in beginnings(planes, lowest)
        )

    def update(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        fusion_kernels.fold[device.strided(self._state[0].shape[1], self._count)](
            *self._tables, votes, self._passed, planes, *self._state
        )
        self._passed += planes

    def of(self, k: int) -> Maximum:
        """The maximum of fusion k over all planes so far, copied from the GPU."""
        best, index, left, right = (arrays.down(a[k]).reshape(self._size) for a in self._state[:4])
        return Maximum(best, index, left, right, self._passed)


class DeviceFocusMaxima:
    """Maxima of the focus measure on the GPU; the twin of `emvs.dsi.maxima.FocusMaxima`.

    At most `batch` planes come at a time.
    """

    def __init__(
        self, targets: Sequence[Target], cameras: int, volumes: int, batch: int, width_px: int,
        height_px: int, sigma_px: float, *, planes: int, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._cells = width_px * height_px
        self._measured = [target for target in targets if target.in_focus]
        as_it_is = FusionTables.of((AS_IT_IS,), 1)

        def peak(fusion: Fusion, measure: str) -> _Peak:
            tables = _tables(fusion, cameras, volumes, polarities)
            maxima = DeviceMaxima(as_it_is, width_px, height_px, planes, -np.inf)
            return _Peak(_on_device(tables), measure, maxima)

        self._peaks = {t.name: peak(t.fusion, t.measure or "") for t in self._measured}
        self._camera_peaks = {
            measure: [peak(Fusion(CAMERA + camera), measure) for camera in range(cameras)]
            for measure in per_camera_measures(targets)
        }
        if self._measured:
            self._measure = _Measure(batch, width_px, self._cells, sigma_px)

    def update(self, votes: Any, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes on the GPU, in order."""
        for peak in chain(self._peaks.values(), *self._camera_peaks.values()):
            image = self._measure.image[:planes]
            fusion_kernels.fuse[device.strided(self._cells)](*peak.fusion, 0, votes, planes, image)
            value = self._measure.of(peak.measure, planes)
            peak.maxima.update(value.reshape(1, *value.shape), planes)

    def result(self) -> dict[str, InFocus]:
        """Where each target's rays are most in focus, by its name, copied from the GPU."""
        cameras = {
            measure: tuple(peak.maxima.of(0) for peak in peaks)
            for measure, peaks in self._camera_peaks.items()
        }
        return {
            target.name: InFocus(
                self._peaks[target.name].maxima.of(0),
                cameras[target.measure or ""] if target.per_camera else (),
            )
            for target in self._measured
        }


class _Peak(NamedTuple):
    """How one volume is fused, how sharpness is measured in it, and the first maximum of that."""

    fusion: tuple[Any, ...]
    measure: str
    maxima: DeviceMaxima


def _tables(fusion: Fusion, cameras: int, volumes: int, polarities: int) -> FusionTables:
    """Of one fusion; a single camera's is the sum of all its polarities and sub-intervals."""
    if fusion.camera is None:
        return FusionTables.of((fusion,), volumes, polarities)
    own = np.arange(volumes).reshape(polarities, cameras, -1)[:, fusion.camera].ravel()
    codes, sizes = np.array([[CAMERA, 0]]), np.array([[1, 1]])
    return FusionTables(codes, sizes, own.reshape(1, -1, 1, 1), np.arange(1))


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

        def blur(source: Any, weight: Any, out: Any) -> None:
            focus_kernels.blur[grid](source, weight, self._width_px, 0, 1, spare)
            focus_kernels.blur[grid](spare, weight, self._width_px, 1, 0, out)

        if measure == "dog":
            blur(image, self._weights[0], narrow)
            blur(image, self._weights[1], wide)
            focus_kernels.subtract[grid](narrow, wide)
            return narrow
        focus_kernels.sharpness[grid](_SHARPNESS[measure], image, self._width_px, wide)
        blur(wide, self._weights[0], narrow)
        if measure == "variance":
            blur(image, self._weights[0], wide)
            focus_kernels.spread[grid](narrow, wide)
        return narrow
