"""One cloud in the world from the depth maps of many windows: a point per voxel, bounded memory.

Memory grows with the voxels that hold points, not with the points: windows are added one by one,
and of each voxel only sums are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.pointcloud import PointCloud

_BITS = 21  # per axis of a voxel's key; three fit an int64
_MERGE_AT_LEAST = 200_000


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over the points of each voxel.

    Attributes:
        keys: (V,) int64, increasing; see `VoxelCloud`.
        sums: (V, 6) float64: position in the voxel, m, then red, green, blue.
        points: (V,) int64.
        windows: (V,) int32 windows that have a point there.
    """

    keys: NDArray[np.int64]
    sums: NDArray[np.float64]
    points: NDArray[np.int64]
    windows: NDArray[np.int32]

    @classmethod
    def joined(cls, parts: list[_Sums]) -> _Sums:
        """Adds up what belongs to the same voxel."""
        keys = np.concatenate([part.keys for part in parts])
        order = np.argsort(keys, kind="stable")
        unique, starts = np.unique(keys[order], return_index=True)
        if not len(unique):
            return parts[0]
        columns = ("sums", "points", "windows")
        values = (np.concatenate([getattr(part, name) for part in parts]) for name in columns)
        return cls(unique, *(np.add.reduceat(column[order], starts, axis=0) for column in values))


class VoxelCloud:
    """Averages points within voxels, over any number of windows."""

    def __init__(self, voxel_m: float) -> None:
        """Starts empty.

        Args:
            voxel_m: edge of a voxel, m.
        """
        self._voxel_m = voxel_m
        empty = np.empty
        self._merged = _Sums(
            empty(0, np.int64), empty((0, 6)), empty(0, np.int64), empty(0, np.int32)
        )
        self._waiting: list[_Sums] = []
        self._windows = 0

    def add(self, cloud: PointCloud) -> None:
        """Adds the points of one window.

        Raises:
            InputError: points too far from the origin for voxels of this size.
        """
        self._windows += 1
        cell = np.floor(cloud.points_world / self._voxel_m)
        inside = cloud.points_world - cell * self._voxel_m
        columns = np.hstack([inside, cloud.colours])
        n = len(cloud)
        each = _Sums(self._keys(cell), columns, np.ones(n, np.int64), np.zeros(n, np.int32))
        own = _Sums.joined([each])
        own = _Sums(own.keys, own.sums, own.points, np.ones(len(own.keys), np.int32))
        self._waiting.append(own)
        # Merging costs as much as there is: so it waits until as much has come.
        if sum(len(part.keys) for part in self._waiting) > max(_MERGE_AT_LEAST, len(self)):
            self._merge()

    def __len__(self) -> int:
        """Voxels merged so far."""
        return len(self._merged.keys)

    def cloud(self, min_windows: int = 1) -> tuple[PointCloud, NDArray[np.int32]]:
        """The mean point and colour of every voxel that enough windows have a point in.

        Args:
            min_windows: how many.

        Returns:
            The cloud, and for each point how many windows saw it.
        """
        self._merge()
        chosen = self._merged.windows >= min_windows
        found = self._merged
        means = found.sums[chosen] / found.points[chosen, None]
        corner = self._cells(found.keys[chosen]) * self._voxel_m
        colours = np.rint(means[:, 3:]).astype(np.uint8)
        return PointCloud(corner + means[:, :3], colours), found.windows[chosen]

    def _merge(self) -> None:
        if self._waiting:
            self._merged, self._waiting = _Sums.joined([self._merged, *self._waiting]), []

    def _keys(self, cell: NDArray[np.float64]) -> NDArray[np.int64]:
        half = 1 << (_BITS - 1)
        if cell.size and not np.abs(cell).max() < half - 1:
            raise InputError(
                f"a point {np.abs(cell).max() * self._voxel_m:.3g} m from the origin does not fit "
                f"voxels of {self._voxel_m:g} m: choose larger ones, or limit the depth"
            )
        x, y, z = (cell.astype(np.int64) + half).T
        keys: NDArray[np.int64] = (x << 2 * _BITS) | (y << _BITS) | z
        return keys

    @staticmethod
    def _cells(keys: NDArray[np.int64]) -> NDArray[np.float64]:
        mask, half = (1 << _BITS) - 1, 1 << (_BITS - 1)
        columns = ((keys >> shift) & mask for shift in (2 * _BITS, _BITS, 0))
        return np.stack([column - half for column in columns], axis=1).astype(np.float64)
