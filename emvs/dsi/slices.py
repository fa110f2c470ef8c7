"""What is kept of the fused volumes beside their maxima: one image row, and on request all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

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


@contextmanager
def volume_writer(
    directory: Path, targets: Sequence[Target], shape: tuple[int, int, int], polarities: int = 1
) -> Iterator[Callable[[Float32s], None]]:
    """Opens a float32 `.npy` of (N, H, W) `shape` per target, such as `Alg1-H.npy`, all or none.

    Yields what appends the planes of (V, P, H, W) votes. Plain writes and no memory map: on a full
    disk a write fails, a memory map kills the process.
    """
    kind = np.lib.format.dtype_to_descr(np.dtype(np.float32))
    header = {"descr": kind, "fortran_order": False, "shape": shape}
    with ExitStack() as stack:
        files = []
        for target in targets:
            partial = stack.enter_context(atomic_path(directory / f"{file_name(target.name)}.npy"))
            file = stack.enter_context(partial.open("wb"))
            np.lib.format.write_array_header_1_0(file, header)
            files.append((target.fusion, file))

        def append(images: Float32s) -> None:
            for fusion, file in files:
                file.write(fuse(fusion, images, polarities).data)

        yield append
