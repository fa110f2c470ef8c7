"""Running maxima over planes, of votes and of focus, so that no DSI is ever stored."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from eventsweep.emvs.dsi import focus_kernels, focus_measures, fusion_kernels
from eventsweep.emvs.dsi.fusion import Fusion, FusionTables, Target, fuse
from eventsweep.emvs.utils.runtime import in_threads
from eventsweep.emvs.utils.vectors_kernels import aligned

Float32s = NDArray[np.float32]
_INT16 = 32767  # so many planes can be counted by 16 bits
# Cells that the update takes in one go: starting a row costs 0.3 µs, as much as 500 cells; longer
# rows than these gain nothing and leave less to share among threads.
_ROW_CELLS = 4096
# Of a volume that is fused, or measured, already
AS_IT_IS = Fusion(fusion_kernels.CAMERA)


@dataclass(frozen=True, eq=False)
class Maximum:
    """The first maximum over planes of one fused volume, per pixel.

    Attributes:
        value: (H, W) float32 the maximum.
        plane: (H, W) int16 its plane, int32 where there are more than 32767.
        left: (H, W) float32 the value one plane before it, where there is one.
        right: (H, W) float32 the value one plane after it, where there is one.
        planes: number of planes.
    """

    value: Float32s
    plane: NDArray[Any]
    left: Float32s
    right: Float32s
    planes: int

    def position(self, *, gaussian: bool = False) -> Float32s:
        """(H, W) float32 plane index of the maximum: vertex of the parabola through three values.

        With `gaussian`, that of the Gaussian through them, where all three are positive. It lies
        within half a plane of `plane`, and is whole at the first and last plane, which have one
        neighbour only.
        """
        inner = (self.plane > 0) & (self.plane < self.planes - 1)
        left, value, right = self._logarithms() if gaussian else (self.left, self.value, self.right)
        # Two roundings of one number: 0 only where left = value = right
        bend = (value - left) + (value - right)
        inner &= bend > 0
        offset = np.zeros_like(self.value)
        np.divide(0.5 * (right - left), bend, out=offset, where=inner)
        return self.plane.astype(np.float32) + offset

    def _logarithms(self) -> tuple[Float32s, Float32s, Float32s]:
        """The three values' logarithms, whose parabola is the Gaussian's; as they are elsewhere."""
        values = (self.left, self.value, self.right)
        positive = (self.left > 0) & (self.right > 0)
        left, value, right = (np.log(v, out=v.copy(), where=positive) for v in values)
        return left, value, right

    def position_at(
        self,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        *,
        refined: bool = True,
        gaussian: bool = False,
    ) -> Float32s:
        """(M,) the same at (M,) pixels only; with `refined` off, the plane itself."""
        at = rows, columns
        if not refined:
            return np.asarray(self.plane[at], np.float32)
        value, left, right = (image[at] for image in (self.value, self.left, self.right))
        there = Maximum(value, self.plane[at], left, right, self.planes)
        return there.position(gaussian=gaussian)


@dataclass(frozen=True, eq=False)
class InFocus:
    """Where the rays of one volume are most in focus.

    Attributes:
        maximum: of the focus measure of its fused volume.
        camera_maxima: the same of each camera's own volume, where their agreement is asked for.
    """

    maximum: Maximum
    camera_maxima: tuple[Maximum, ...]


class RunningMaxima:
    """First maximum over planes of every volume: what it must remember of those that have passed.

    Args:
        fusions: of each volume; they must share one split.
        width_px: columns.
        height_px: rows.
        planes: how many will pass; needed only where there are more than 32767.
        polarities: 2 where each polarity has volumes of its own.
        lowest: what every value exceeds.
        shared_volume: the volume whose fused planes others need, too: each update leaves them in
            the place of the first volume's votes.

    Attributes:
        arrays: best, index, left, right, previous, each (M, H, W), for each volume that differs.
        planes: how many planes have passed.
        shared: the shared volume, where it is among those that are fused by compiled loops.
    """

    def __init__(
        self,
        fusions: Sequence[Fusion],
        width_px: int,
        height_px: int,
        *,
        planes: int = 0,
        polarities: int = 1,
        lowest: float = -1,
        shared_volume: Fusion | None = None,
    ) -> None:
        volumes = sorted(dict.fromkeys(fusions), key=lambda volume: volume == shared_volume)
        shape = (len(volumes), height_px, width_px)
        self._compiled = [volume for volume in volumes if volume.function is None]
        self._own = [volume for volume in volumes if volume.function is not None]
        self._row = [[*self._compiled, *self._own].index(fusion) for fusion in fusions]
        self._polarities = polarities
        self.shared = shared_volume if shared_volume in self._compiled else None
        self.planes = 0
        self.arrays: tuple[NDArray[Any], ...] = tuple(
            np.full(shape, value, dtype) for dtype, value in beginnings(planes, lowest)
        )

    def update(self, votes: Float32s, planes: int) -> None:
        """Takes in the next `planes` planes of (V, P, cells) votes, in order."""
        split = len(self._compiled)
        if self._own:
            height, width = self.arrays[0].shape[1:]
            images = votes[:, :planes, : height * width].reshape(-1, planes, height, width)
        for k, fusion in enumerate(self._own, split):
            fused = fuse(fusion, images, self._polarities).reshape(1, planes, -1)
            self._update(FusionTables.of((AS_IT_IS,), 1), fused, planes, slice(k, k + 1))
        if self._compiled:  # last, because it may write into the votes
            tables = FusionTables.of(self._compiled, len(votes), self._polarities)
            self._update(tables, votes, planes, slice(0, split), self.shared is not None)
        self.planes += planes

    def _update(
        self, tables: FusionTables, votes: Float32s, planes: int, rows: slice,
        replaces: bool = False,
    ) -> None:  # fmt: skip
        long = [_in_long_rows(array[rows]) for array in self.arrays]
        scratch = tables.scratch(*long[0].shape[1:])
        in_threads(
            fusion_kernels.fold, len(scratch[0]), *tables.arrays, votes, self.planes, planes,
            *scratch, replaces, *long,
        )  # fmt: skip

    def of(self, k: int) -> Maximum:
        """The maximum of the fusion at place k of the list, over all planes so far."""
        best, index, left, right, _ = (array[self._row[k]] for array in self.arrays)
        return Maximum(best, index, left, right, self.planes)


def beginnings(planes: int, lowest: float = -1) -> tuple[tuple[type[np.generic], float], ...]:
    """Types and first values of best, index, left, right, previous of `fusion_kernels.fold`."""
    index = np.int16 if planes <= _INT16 else np.int32
    return (np.float32, lowest), (index, -2), (np.float32, 0), (np.float32, 0), (np.float32, 0)


def _in_long_rows(images: NDArray[Any]) -> NDArray[Any]:
    """(M, H, W) images as (M, H / k, k W), the same memory: every pixel is folded by itself."""
    count, height, width = images.shape
    fits = (k for k in range(1, height + 1) if height % k == 0 and k * width <= _ROW_CELLS)
    k = max(fits, default=1)
    return images.reshape(count, height // k, k * width)


class FocusMaxima:
    """Maxima of the focus measure of every target that asks for one, and of each camera's votes.

    `targets` are those of one sweep, with or without a focus measure; `planes` says how many will
    pass, where they are more than 32767.
    """

    def __init__(
        self, targets: Sequence[Target], cameras: int, width_px: int, height_px: int,
        sigma_px: float, *, planes: int = 0, polarities: int = 1,
    ) -> None:  # fmt: skip
        self._polarities, self._cameras = polarities, cameras
        self._fused_planes: Float32s | None = None  # of one batch; every batch uses it again
        self._measured = {t.name: (t, (t.fusion, t.measure or "")) for t in targets if t.in_focus}

        def peak(measure: str) -> FocusPeak:
            return FocusPeak(width_px, height_px, measure, sigma_px, planes)

        self._peaks = {key: peak(key[1]) for _, key in self._measured.values()}
        measures = per_camera_measures(targets)
        self._camera_peaks = {
            measure: [peak(measure) for _ in range(cameras)] for measure in measures
        }

    @property
    def shared_volume(self) -> Fusion | None:
        """The first volume of several cameras: `RunningMaxima` may share its planes."""
        return next((fusion for fusion, _ in self._peaks if fusion.camera is None), None)

    def update(self, images: Float32s, shared: Fusion | None = None) -> None:
        """Takes in the next planes of (V, P, H, W) votes, in order.

        All volumes but `shared`: `update_shared` takes its planes as somebody else fused them.
        """
        for (volume, _), peak in self._peaks.items():
            if volume != shared:
                peak.update(self._fused(volume, images))
        for peaks in self._camera_peaks.values():
            for camera, peak in enumerate(peaks):
                peak.update(self._of_camera(images, camera))

    def update_shared(self, shared: Fusion | None, planes: Float32s) -> None:
        """Takes in the next (P, H, W) fused planes of one volume."""
        for (volume, _), peak in self._peaks.items():
            if volume == shared:
                peak.update(planes)

    def result(self) -> dict[str, InFocus]:
        """Where each target's rays are most in focus, over all planes so far, by its name."""
        cameras = {
            measure: tuple(peak.maximum() for peak in peaks)
            for measure, peaks in self._camera_peaks.items()
        }
        maxima = {key: peak.maximum() for key, peak in self._peaks.items()}
        return {
            name: InFocus(maxima[key], cameras[key[1]] if target.per_camera else ())
            for name, (target, key) in self._measured.items()
        }

    def _fused(self, fusion: Fusion, images: Float32s) -> Float32s:
        if fusion.camera is not None:
            return self._of_camera(images, fusion.camera)
        if self._fused_planes is None or len(self._fused_planes) < images.shape[1]:
            self._fused_planes = aligned(images[0].size).reshape(images.shape[1:])
        return fuse(fusion, images, self._polarities, out=self._fused_planes[: images.shape[1]])

    def _of_camera(self, images: Float32s, camera: int) -> Float32s:
        """(P, H, W) votes of one camera: of all polarities and sub-intervals together."""
        parts = images.reshape(self._polarities, self._cameras, -1, *images.shape[1:])[:, camera]
        whole = parts.reshape(-1, *images.shape[1:])
        return np.asarray(whole[0] if len(whole) == 1 else whole.sum(axis=0), np.float32)


def per_camera_measures(targets: Sequence[Target]) -> list[str]:
    """The focus measures that some target asks for in each camera's own votes."""
    return list(dict.fromkeys(t.measure or "" for t in targets if t.in_focus and t.per_camera))


class FocusPeak:
    """First maximum over planes of a focus measure of one volume; 18 bytes remain per pixel.

    `measure` is a name of `emvs.dsi.focus_measures.MEASURES`, `sigma_px` its scale.
    """

    def __init__(
        self, width_px: int, height_px: int, measure: str, sigma_px: float, planes: int = 0
    ) -> None:
        self._measure, self._sigma_px = focus_measures.MEASURES[measure], sigma_px
        self._window = _window(height_px, width_px, sigma_px) if measure == "variance" else None
        self._maxima = RunningMaxima(
            (AS_IT_IS,), width_px, height_px, planes=planes, lowest=-np.inf
        )

    def update(self, planes: Float32s) -> None:
        """Takes in the next (P, H, W) planes."""
        if not len(planes):
            return
        if self._window is None:
            for plane in planes:
                self._maxima.update(self._measure(plane, self._sigma_px).reshape(1, 1, -1), 1)
            return
        state = (array[0] for array in self._maxima.arrays)
        in_threads(
            focus_kernels.fold_variance, len(self._window[-1]), *_in_one_row(planes), len(planes),
            self._maxima.planes, *self._window, *state,
        )  # fmt: skip
        self._maxima.planes += len(planes)

    def maximum(self) -> Maximum:
        """The maximum over all planes so far."""
        return self._maxima.of(0)


def _in_one_row(planes: Float32s) -> tuple[Float32s, int]:
    """(P, H, W) planes in one contiguous row, the same memory, and the step between planes."""
    if planes.ndim != 3 or not planes[0].flags.c_contiguous or planes.strides[0] < 0:
        planes = np.ascontiguousarray(planes)
    size = planes.itemsize
    step = planes.strides[0] // size
    cells = (len(planes) - 1) * step + planes[0].size
    return as_strided(planes, (cells,), (size,)), step


def _window(height_px: int, width_px: int, sigma_px: float) -> tuple[NDArray[Any], ...]:
    """What the compiled variance needs beside the votes: weights, mirrored indices, scratch."""
    weight = focus_measures.half_window(sigma_px)
    radius, strips = len(weight) - 1, numba.get_num_threads()
    columns = -(-width_px // focus_kernels.PAIR) * focus_kernels.PAIR
    taken = strips, focus_kernels.BLOCK + 2 * radius, columns
    sums = strips, 2, focus_kernels.BLOCK, columns + 2 * radius
    return (
        weight,
        _mirrored(height_px, radius),
        _mirrored(width_px, radius),
        *(aligned(math.prod(shape)).reshape(shape) for shape in (taken, sums)),
        np.empty((strips, columns), np.float32),
    )


def _mirrored(size: int, radius: int) -> NDArray[np.int64]:
    """Indices -radius .. size + radius - 1 of a row mirrored at its ends, which stand once."""
    period = max(2 * (size - 1), 1)
    place = np.arange(-radius, size + radius) % period
    return np.minimum(place, period - place)
