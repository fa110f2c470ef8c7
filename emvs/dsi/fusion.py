"""Fusion: which votes a volume takes, over which sub-intervals, and how they are fused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import in_threads

Volume = NDArray[np.float32]
# A fusion of a user's own: votes (C, intervals, N, H, W) to (N, H, W)
FusionFunction = Callable[[Volume], Volume]
_STRIPS = 64  # enough for any number of threads to share them evenly


class Mean(NamedTuple):
    """A compiled fusion: its code in the tables of both back ends, and what it is called."""

    code: int
    words: str


# name -> mean. For every voxel (paper, Eq. 1): min <= H <= G <= A <= RMS <= max
MEANS: dict[str, Mean] = {
    "min": Mean(fusion_kernels.MIN, "minimum"),
    "H": Mean(fusion_kernels.HARMONIC, "harmonic mean"),
    "G": Mean(fusion_kernels.GEOMETRIC, "geometric mean"),
    "A": Mean(fusion_kernels.ARITHMETIC, "arithmetic mean"),
    "RMS": Mean(fusion_kernels.RMS, "root mean square"),
    "max": Mean(fusion_kernels.MAX, "maximum"),
}


@dataclass(frozen=True)
class Split:
    """How a window's events are divided into sub-intervals, each camera's on its own.

    Attributes:
        intervals: how many; 1 is the whole window.
        by: `count`: as many events in each, as the authors' program does; `time`: as long each.
    """

    intervals: int = 1
    by: Literal["count", "time"] = "count"

    def edges(self, t_us: NDArray[np.int64], t0_us: int, t1_us: int) -> NDArray[np.int64]:
        """The (intervals + 1,) events where a camera's sub-intervals begin and end.

        `t_us` are the (N,) int64 sorted times of its events in the window `t0_us <= t < t1_us`.
        """
        edge = np.arange(self.intervals + 1, dtype=np.int64)
        if self.by == "count":
            edge *= len(t_us)
            edge //= self.intervals
            return edge
        inner_us = t0_us + edge[1:-1] * (t1_us - t0_us) // self.intervals
        edge[1:-1] = np.searchsorted(t_us, inner_us, side="left")
        edge[-1] = len(t_us)
        return edge


WHOLE = Split()


@dataclass(frozen=True)
class Fusion:
    """From the votes of all cameras to one volume; equal for equal volumes.

    Attributes:
        code: the compiled fusion that comes first.
        split: the sub-intervals that it needs votes of.
        outer: the compiled fusion of what `code` gave, where there are sub-intervals.
        time_first: whether `code` fuses over time and `outer` across cameras, or the other way.
        shuffled: whether interval k of camera 0 meets interval k + n/2 (cyclic) of the others.
        function: a user's own fusion, instead of the codes.
        owner: the method whose function it is; functions themselves are not compared.

    Raises:
        InputError: a code that no compiled fusion has.
    """

    code: int = fusion_kernels.MAX
    split: Split = WHOLE
    outer: int = fusion_kernels.MAX
    time_first: bool = False
    shuffled: bool = False
    function: FusionFunction | None = field(default=None, compare=False)
    owner: str = ""

    def __post_init__(self) -> None:
        known = len(fusion_kernels.CODES)
        for code in (self.code, self.outer):
            if not 0 <= code < known and code < fusion_kernels.CAMERA:
                raise InputError(
                    f"fusion code {code}: needs 0 to {known - 1}, or {fusion_kernels.CAMERA} + c "
                    "for camera c alone"
                )

    @property
    def camera(self) -> int | None:
        """The one camera whose votes it takes; None where it fuses all of them."""
        alone = self.function is None and self.code >= fusion_kernels.CAMERA
        return self.code - fusion_kernels.CAMERA if alone else None

    def groups(self, n_cameras: int) -> NDArray[np.int64]:
        """Which volumes are fused first: (groups, members) of `camera * intervals + interval`."""
        n = self.split.intervals
        volumes = np.arange(n_cameras * n).reshape(n_cameras, n)
        if self.shuffled:
            volumes[1:] = np.roll(volumes[1:], -(n // 2), axis=1)
        return volumes if self.time_first else volumes.T


@dataclass(frozen=True)
class Target:
    """One fused volume of a sweep, and what is kept of it.

    Attributes:
        name: of the method that it is for.
        fusion: how the votes are fused.
        measure: whose maximum along each ray is kept beside that of the votes: `votes` for none
            else, a focus measure by its name, or None where not even the votes' maximum is.
        per_camera: whether that of each camera's own votes is kept, too.
        row: whether one image row of the volume, and on request all of it, is kept.
    """

    name: str
    fusion: Fusion
    measure: str | None = "votes"
    per_camera: bool = False
    row: bool = True

    @property
    def in_focus(self) -> bool:
        """Whether a focus measure is asked for."""
        return self.measure not in (None, "votes")


@dataclass(frozen=True, eq=False)
class FusionTables:
    """Fusions of one split as the compiled loops read them (`emvs.dsi.fusion_kernels.fold`)."""

    codes: NDArray[np.int64]
    sizes: NDArray[np.int64]
    which: NDArray[np.int64]
    every: NDArray[np.int64]

    @classmethod
    def of(cls, fusions: Sequence[Fusion], volumes: int, polarities: int = 1) -> FusionTables:
        """Lists the groups of fusions that share a split and have no functions of their own.

        There are polarities x cameras x intervals `volumes`; `polarities` is 2 where each has its
        own.
        """
        per_part = volumes // polarities
        groups = [fusion.groups(per_part // fusion.split.intervals) for fusion in fusions]
        sizes = np.array([group.shape for group in groups], np.int64)
        which = np.zeros((len(fusions), polarities, *sizes.max(axis=0)), np.int64)
        for m, group in enumerate(groups):
            for part in range(polarities):
                which[m, part, : group.shape[0], : group.shape[1]] = group + part * per_part
        codes = np.array([(fusion.code, fusion.outer) for fusion in fusions], np.int64)
        return cls(codes, sizes, which, np.arange(which.shape[2]))

    @property
    def arrays(self) -> tuple[NDArray[np.int64], ...]:
        """What the loops take first."""
        return self.codes, self.sizes, self.which, self.every

    def scratch(self, height_px: int, width_px: int) -> tuple[Volume, Volume, Volume]:
        """Room for the loops' rows: (S, G, 1, W) and twice (S, W) float32, for S strips of rows."""
        strips = min(height_px, _STRIPS)
        level = np.empty((strips, len(self.every), 1, width_px), np.float32)
        spare, fused = np.empty((2, strips, width_px), np.float32)
        return level, spare, fused


def fuse(fusion: Fusion, volumes: Volume, polarities: int = 1, out: Volume | None = None) -> Volume:
    """Fuses (V, N, H, W) votes into (N, H, W) float32, level by level.

    V is polarities x cameras x intervals, the last runs fastest; the fusions of both polarities are
    summed. Compiled fusions may fill `out`: memory that is new for every batch costs as much as
    what is written into it.

    Raises:
        InputError: a user's function that gives another shape, or a value below 0 or NaN.
    """
    if fusion.function is not None:
        return _by_function(fusion, fusion.function, volumes, polarities)
    count, planes, height, width = volumes.shape
    votes = _in_cells(np.asarray(volumes, np.float32))
    tables = FusionTables.of((fusion,), count, polarities)
    out = np.empty((planes, height, width), np.float32) if out is None else out
    level, spare, _ = tables.scratch(height, width)
    in_threads(fusion_kernels.fuse, len(level), *tables.arrays, votes, level, spare, out)
    return out


def _in_cells(volumes: Volume) -> Volume:
    """(V, N, H, W) volumes as (V, N, cells), a plane first in each; copied only if need be."""
    count, planes, height, width = volumes.shape
    size, step = volumes.itemsize, volumes.strides[1]
    if volumes.strides != (planes * step, step, width * size, size) or step % size:
        return np.ascontiguousarray(volumes).reshape(count, planes, height * width)
    shape, strides = (count, planes, step // size), (planes * step, step, size)
    return np.lib.stride_tricks.as_strided(volumes, shape, strides)


def _by_function(
    fusion: Fusion, function: FusionFunction, volumes: Volume, polarities: int
) -> Volume:
    given = volumes.reshape(polarities, -1, fusion.split.intervals, *volumes.shape[1:])
    given.flags.writeable = False
    fused = [np.asarray(function(part), np.float32) for part in given]
    for out in fused:
        if out.shape != volumes.shape[1:] or not np.all(out >= 0):
            raise InputError(
                f"the function of {fusion.owner} returned shape {out.shape}: it must return "
                f"{volumes.shape[1:]}, every value at least 0 and none NaN"
            )
    total = np.sum(fused, axis=0) if len(fused) > 1 else fused[0]
    return np.ascontiguousarray(total)
