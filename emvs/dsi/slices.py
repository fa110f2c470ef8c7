"""What is kept of the fused volumes beside their maxima: one image row, and on request all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi.fusion import Target, fuse
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.utils.files import atomic_path

Float32s = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Slices:
    """One image row of every fused volume.

    Attributes:
        row_px: the row.
        rho: (N,) float32 planes, 1/m.
        values: method name -> (N, W) float32 votes.
    """

    row_px: int
    rho: NDArray[np.float32]
    values: Mapping[str, NDArray[np.float32]]


class SliceRecorder:
    """Keeps image row `row_px` of every fused volume: method name -> (N, W) float32 `values`."""

    def __init__(
        self,
        targets: Sequence[Target],
        planes: int,
        width_px: int,
        row_px: int,
        polarities: int = 1,
    ) -> None:
        self.row_px = row_px
        self._polarities = polarities
        self._targets = tuple(targets)
        self.values = {target.name: np.zeros((planes, width_px), np.float32) for target in targets}

    def take(self, first: int, images: Float32s) -> None:
        """Takes the row of (V, P, H, W) votes, planes `first` and on."""
        rows = images[:, :, self.row_px : self.row_px + 1]
        for target in self._targets:
            fused = fuse(target.fusion, rows, self._polarities)
            self.values[target.name][first : first + images.shape[1]] = fused[:, 0]


class VolumeWriter:
    """Writes every fused volume as (N, H, W) float32 `.npy`, plane after plane.

    Plain writes and no memory map: on a full disk a write fails, a memory map kills the process.
    """

    def __init__(
        self, targets: Sequence[Target], files: Sequence[BinaryIO], polarities: int = 1
    ) -> None:
        self._polarities = polarities
        self._files = tuple(zip(targets, files, strict=True))

    def take(self, images: Float32s) -> None:
        """Appends the planes of (V, P, H, W) votes."""
        for target, file in self._files:
            file.write(fuse(target.fusion, images, self._polarities).data)


@contextmanager
def volume_writer(
    directory: Path | None,
    targets: Sequence[Target],
    shape: tuple[int, int, int],
    polarities: int = 1,
) -> Iterator[VolumeWriter]:
    """Opens one file per target in `directory`, whole or not at all; with None it writes nothing.

    `shape` is (N, H, W) of the volumes; the files are called `Alg1-H.npy` and so on.
    """
    with ExitStack() as stack:
        if directory is None:
            yield VolumeWriter((), ())
            return
        files = [_open_npy(stack, directory / f"{file_name(t.name)}.npy", shape) for t in targets]
        yield VolumeWriter(targets, files, polarities)


def _open_npy(stack: ExitStack, path: Path, shape: tuple[int, int, int]) -> BinaryIO:
    partial = stack.enter_context(atomic_path(path))
    file = stack.enter_context(partial.open("wb"))
    header = {"descr": np.lib.format.dtype_to_descr(np.dtype(np.float32)),
              "fortran_order": False, "shape": shape}  # fmt: skip
    np.lib.format.write_array_header_1_0(file, header)
    return file
