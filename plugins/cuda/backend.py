"""A sweep on the GPU: rays go up, maxima come down, planes stay there, as many as fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi.backend import SweepResult, Task
from eventsweep.emvs.dsi.fusion import FusionTables
from eventsweep.emvs.dsi.maxima import FocusMaxima, RunningMaxima
from eventsweep.emvs.dsi.rays import Rays
from eventsweep.emvs.dsi.slices import SliceRecorder
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.cuda import arrays, device, fusion_kernels, voting_kernels
from eventsweep.plugins.cuda.arrays import DeviceRays
from eventsweep.plugins.cuda.device import Gpu
from eventsweep.plugins.cuda.maxima import (
    SCRATCH_IMAGES,
    STATE_BYTES,
    DeviceFocusMaxima,
    DeviceMaxima,
)

Float32s = NDArray[np.float32]
_CACHE_SHARE = 0.6  # of the second-level cache, for the sums that votes are added to
_MEMORY_SHARE = 0.9  # of the free memory; the rest is lost to its division into blocks
_MOST_PLANES = 16
_SUM_BYTES = {"bilinear": 8, "nearest": 4}

# A lane of 32 bits takes 65 535 votes of 2^16 each. Where a voxel may have more, the check after
# the votes finds it, and they are cast again with fewer bits.
MOST_BITS, _FEWER, _FEWEST_BITS = 16, 4, 4

# What casts votes into sums, and makes votes of these
_FIXED = voting_kernels.vote_fixed, voting_kernels.settle_fixed
_NEAREST = voting_kernels.vote_nearest, voting_kernels.settle_nearest


class CudaBackend:
    """The twin of `emvs.dsi.backend.CpuBackend` on a GPU; rays that are not there are uploaded.

    Functions of a user's own are Python: their planes come down, batch by batch, and are fused and
    folded by the CPU.

    Raises:
        InputError: too little memory on the GPU for a single plane.
    """

    def __init__(self, task: Task, rays: Sequence[Rays | DeviceRays]) -> None:
        self._rays = [r if isinstance(r, DeviceRays) else DeviceRays.of(r) for r in rays]
        size, planes, config = (task.width_px, task.height_px), len(task.rho), task.config
        self._task, volumes = task, len(rays)
        passing: dict[str, Any] = {"planes": planes, "polarities": config.polarities}
        self._own = [target for target in task.sought if target.fusion.function is not None]
        self._compiled = [target for target in task.sought if target.fusion.function is None]
        focused = sum(target.in_focus for target in self._compiled)
        self.planes_in_flight = planes_in_flight(task, volumes, focused, device.gpu())
        nearest = config.voting == "nearest"
        self._volume = VoteVolume(volumes, self.planes_in_flight, *size, nearest=nearest)
        if self._compiled:
            fusions = [target.fusion for target in self._compiled]
            tables = FusionTables.of(fusions, volumes, config.polarities)
            self._maxima = DeviceMaxima(tables, *size, planes)
        self._focus = DeviceFocusMaxima(
            self._compiled, task.cameras, volumes, self.planes_in_flight, *size,
            config.focus.sigma_px, **passing,
        )  # fmt: skip
        self._own_maxima = RunningMaxima([t.fusion for t in self._own], *size, **passing)
        self._own_focus = FocusMaxima(
            self._own, task.cameras, *size, config.focus.sigma_px, **passing
        )
        self._rows = arrays.empty((volumes, planes, size[0]), np.float32)
        self._rho = arrays.up(task.rho)
        self._votes = [VoteCounts()] * volumes
        self._first = self._last = 0

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""
        self._first, self._last = first, last
        votes = self._volume.cast(self._rays, self._rho[first:last], last - first)
        self._votes = [a + b for a, b in zip(self._votes, votes, strict=True)]

    def fuse(self) -> None:
        """Fuses these planes for every target, and takes them into the running maxima."""
        votes, planes = self._volume.votes, self._last - self._first
        if self._compiled:
            self._maxima.update(votes, planes)
        self._focus.update(votes, planes)
        width = self._task.width_px
        fusion_kernels.keep_row[device.strided(width, len(self._rays))](
            votes, width, self._task.row_px, self._first, planes, self._rows
        )
        if self._own:
            images = self.images()
            self._own_maxima.update(images.reshape(*images.shape[:2], -1), planes)
            self._own_focus.update(images)

    def images(self) -> Float32s:
        """(V, P, H, W) votes of these planes, copied from the GPU."""
        return self._volume.on_host(self._last - self._first)

    def result(self) -> SweepResult:
        """What all planes so far leave, copied from the GPU."""
        task = self._task
        rows = arrays.down(self._rows)
        slices = SliceRecorder(task.shown, len(task.rho), task.width_px, 0, task.config.polarities)
        slices.take(0, rows[:, :, np.newaxis])
        maxima = {target.name: self._maxima.of(k) for k, target in enumerate(self._compiled)}
        maxima |= {target.name: self._own_maxima.of(k) for k, target in enumerate(self._own)}
        in_order = {target.name: maxima[target.name] for target in task.sought}
        focus = self._focus.result() | self._own_focus.result()
        return SweepResult(in_order, focus, slices.values, task.per_camera(self._votes))


def planes_in_flight(task: Task, volumes: int, focused: int, gpu: Gpu) -> int:
    """How many planes make one batch, with `focused` targets that need a focus measure.

    Votes are added at random places of one volume's planes of a batch. Where these fit into the
    cache, an addition never waits for memory.

    Raises:
        InputError: too little memory for a single plane.
    """
    cells = task.width_px * task.height_px
    sums = _SUM_BYTES[task.config.voting] * cells
    cached = max(1, int(_CACHE_SHARE * gpu.l2_bytes) // sums)
    per_plane = sums + 4 * cells * (volumes + (SCRATCH_IMAGES if focused else 0))
    states = len(task.sought) + (focused + task.cameras if focused else 0)
    always = states * STATE_BYTES * cells + 4 * volumes * len(task.rho) * task.width_px
    free = _MEMORY_SHARE * gpu.memory_bytes
    if always + per_plane > free:
        raise InputError(
            f"{gpu.name} has {gpu.memory_bytes / 1e9:.3g} GB of memory free, one plane of "
            f"{task.width_px} x {task.height_px} px needs {(always + per_plane) / 1e9:.3g} GB with "
            f"{len(task.sought)} methods and {volumes} volumes: choose device cpu, or fewer "
            "methods or sub-intervals"
        )
    fit = min(len(task.rho), cached, _MOST_PLANES)
    return fit if always + fit * per_plane <= free else int((free - always) // per_plane)


class VoteVolume:
    """Planes of every volume on the GPU that votes are cast into, allocated once for all batches.

    `votes` are (V, planes, H * W) float32 there. With `nearest` a ray votes for the nearest pixel,
    and not bilinearly for four.
    """

    def __init__(
        self, volumes: int, planes: int, width_px: int, height_px: int, *, nearest: bool = False
    ) -> None:
        self._size, self._nearest = (width_px, height_px), nearest
        cells = width_px * height_px
        self.votes = arrays.empty((volumes, planes, cells), np.float32)
        self._sums = arrays.empty((planes, cells), np.int32 if nearest else np.int64)
        # per volume: votes inside, behind their camera, and the sum of all lanes; each per plane,
        # spread over slots
        self._counts = arrays.empty((volumes, 3 * planes, device.SLOTS), np.int64)

    def cast(self, rays: Sequence[DeviceRays], rho: Any, planes: int) -> list[VoteCounts]:
        """Fills `votes[:, :planes]` with the votes of every volume's rays in planes `rho`.

        Raises:
            InputError: more votes in one voxel than any scale can hold.
        """
        for volume, cast_rays in enumerate(rays):
            self._cast(volume, cast_rays, rho, planes, MOST_BITS)
        # Nothing above waits for the GPU; this does, once per batch.
        counts = self._counted(self._counts, planes)
        for volume, cast_rays in enumerate(rays):
            bits = MOST_BITS
            while not self._nearest and not _is_whole(counts[volume], bits):
                if bits == _FEWEST_BITS:
                    raise InputError(
                        f"more than {2**32 >> bits} votes in one voxel: choose voting nearest, a "
                        "shorter window or hot_pixels"
                    )
                bits -= _FEWER
                self._cast(volume, cast_rays, rho, planes, bits)
                counts[volume] = self._counted(self._counts[volume : volume + 1], planes)[0]
        return [_votes(*pair, planes) for pair in zip(rays, counts, strict=True)]

    def _cast(self, volume: int, rays: DeviceRays, rho: Any, planes: int, bits: int) -> None:
        sums, counts = self._sums[:planes], self._counts[volume]
        arrays.fill(sums, 0)
        arrays.fill(counts, 0)
        inside, behind, total = (counts[k * planes : (k + 1) * planes] for k in range(3))
        scale, settled = ((), ()) if self._nearest else ((bits,), (bits, total))
        vote, settle = _NEAREST if self._nearest else _FIXED
        for block in rays.blocks:
            vote[device.each(block.shape[1])](block, rho, *self._size, *scale, sums, inside, behind)
        grid = device.strided(sums.shape[1], planes)
        settle[grid](sums, self.votes[volume, :planes], *settled)

    def _counted(self, counts: Any, planes: int) -> NDArray[np.int64]:
        """(V, 3, planes) votes inside, behind, and the sum of all lanes."""
        every: NDArray[np.int64] = arrays.down(counts).sum(axis=2)
        return every[:, : 3 * planes].reshape(-1, 3, planes)

    def on_host(self, planes: int) -> Float32s:
        """The first `planes` planes as (V, planes, H, W), copied from the GPU."""
        width, height = self._size
        images = [arrays.down(self.votes[v, :planes]) for v in range(len(self.votes))]
        return np.stack(images).reshape(len(images), planes, height, width)


def _is_whole(counts: NDArray[np.int64], bits: int) -> bool:
    """Whether no lane ran over.

    The lanes of one vote sum to 2^bits. A lane that runs over loses 2^32, or gives 1 for 2^32 to
    the lane above it: then the sum is too small, and nothing makes it larger again.
    """
    inside, _, total = counts
    return bool(np.array_equal(total, inside << bits))


def _votes(rays: DeviceRays, counts: NDArray[np.int64], planes: int) -> VoteCounts:
    counted, hidden = int(counts[0].sum()), int(counts[1].sum())
    return VoteCounts(counted, len(rays) * planes - counted - hidden, hidden)
