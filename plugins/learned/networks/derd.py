"""DERD-Net, a published baseline: a recurrent network reads the whole column of votes of a pixel.

Hitzges, Ghosh, Gallego, "DERD-Net: Learning Depth from Event-based Ray Densities", NeurIPS 2025;
architecture, selection of pixels and names of the layers are those of its code (MIT licence,
github.com/tub-rip/DERD-Net). A column is 7 x 7 pixels and all 100 planes of the fused volume, near
to far, as shares of its largest value. A convolution over every second plane gives 50 steps of 100
numbers; the last state of a recurrent unit that reads them from near to far goes through two dense
layers, which say where in the depth range the depth lies. One model has 70,913 parameters; of two
the mean counts. The published output is uniform in depth, which ties the weights to one ratio of
far to near; ours is uniform in inverse depth, an option of the authors' code (`uniform_in` in
manifests).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.kept_votes import KeptVotes
from eventsweep.emvs.dsi.fusion import Fusion
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.plugins.learned.networks import derd_kernels
from eventsweep.plugins.learned.networks.inputs import fused_patches
from eventsweep.plugins.learned.networks.weights import Weights, loaded, read_weights

NAME = "derd-net"
"""Of the network in manifests."""
PLANES = 100
SIDE_PX = 7
BATCH = 1024
"""Pixels whose columns are in memory at a time."""
MOST_MODELS = 2
LAYERS: Mapping[str, tuple[int, ...]] = {
    "conv3d.0.weight": (4, 1, 3, 3, 3),
    "conv3d.0.bias": (4,),
    "gru.weight_ih_l0": (300, 100),
    "gru.bias_ih_l0": (300,),
    "gru.weight_hh_l0": (300, 100),
    "gru.bias_hh_l0": (300,),
    "dense_output.0.weight": (100, 100),
    "dense_output.0.bias": (100,),
    "dense_output.3.weight": (1, 100),
    "dense_output.3.bias": (1,),
}
"""The shape of every array of one model, in the order in which the loops take them."""
UniformIn = Literal["linear", "inverse"]
_LEAST_VOTES = np.float32(1e-8)  # the published one
Float32s = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class DepthRange:
    """Nearest and farthest depth of the planes, m."""

    near_m: float
    far_m: float

    @classmethod
    def of(cls, rho: NDArray[np.floating]) -> DepthRange:
        """That of planes in equal steps of inverse depth; the authors' leave out the near end."""
        first, last = float(rho[0]), float(rho[-1])
        if first > last:
            return cls(1 / first, 1 / last)
        return cls(1 / (last + (last - first) / (len(rho) - 1)), 1 / first)

    def depth_m(self, place: Float32s, uniform_in: UniformIn) -> Float32s:
        """(M,) depths of places between 0, the near end, and 1, the far end; m."""
        inside = np.clip(place.astype(np.float64), 0, 1)
        if uniform_in == "linear":
            return np.asarray(self.near_m + inside * (self.far_m - self.near_m), np.float32)
        near, far = 1 / self.near_m, 1 / self.far_m
        return np.asarray(1 / (near - inside * (near - far)), np.float32)

    def place(self, depth_m: NDArray[np.floating], uniform_in: UniformIn) -> Float32s:
        """(M,) where depths lie in it, clipped to 0..1, as the network is taught."""
        depth = np.asarray(depth_m, np.float64)
        if uniform_in == "linear":
            inside = (depth - self.near_m) / (self.far_m - self.near_m)
        else:
            inside = (1 / self.near_m - 1 / depth) / (1 / self.near_m - 1 / self.far_m)
        return np.clip(inside, 0, 1).astype(np.float32)


def shapes(models: int) -> dict[str, tuple[int, ...]]:
    """The shapes of all arrays of some models, by name."""
    return {f"{k}.{name}": shape for k in range(models) for name, shape in LAYERS.items()}


@dataclass(frozen=True, eq=False)
class DerdNet:
    """One trained model, or two whose mean counts.

    Attributes:
        weights: arrays and manifest.
        models: how many.
        uniform_in: whether the network's places are in equal steps of depth, as published, or of
            inverse depth (`inverse_space` of the authors' code).
    """

    weights: Weights
    models: int
    uniform_in: UniformIn

    def places(self, columns: Float32s, count: int) -> Float32s:
        """(M,) float32 where pixels lie in the depth range: 0 near, 1 far; not clipped.

        `columns` are (B, PLANES, SIDE_PX, SIDE_PX, L) of `columns_of`, of which M lanes are pixels.
        """
        rows = columns.reshape(*columns.shape[:3], -1)
        out = np.empty((self.models, count), np.float32)
        for k, places in enumerate(out):
            arrays = (self.weights.arrays[f"{k}.{name}"] for name in LAYERS)
            derd_kernels.places(rows, *arrays, places)  # type: ignore[call-arg]
        return np.asarray(out.mean(axis=0), np.float32)


def derd_net(path: Path | None = None) -> DerdNet:
    """The network of a file of weights; by default the one that ships with the package.

    Raises:
        InputError: weights that cannot be read, or are of another network.
    """
    return loaded("derd", _read, path)


def _read(path: Path) -> DerdNet:
    known = [shapes(models) for models in range(1, MOST_MODELS + 1)]
    weights = read_weights(path, NAME, *known)
    uniform_in = weights.manifest.get("uniform_in")
    if uniform_in not in ("linear", "inverse"):
        raise InputError(
            f"{weights.path.with_suffix('.json')}: uniform_in is {uniform_in!r}, must be linear or "
            "inverse; choose other weights"
        )
    return DerdNet(weights, len(weights.arrays) // len(LAYERS), uniform_in)


def selecting(config: MapperConfig) -> MapperConfig:
    """The configuration whose adaptive threshold selects the network's pixels."""
    own = {name: getattr(config.derd, name) for name in ("threshold_kernel_px", "threshold_c")}
    return config.model_copy(update=own)


def columns_of(
    fusion: Fusion, kept: KeptVotes, view: ReferenceView, rows: Indices, columns: Indices
) -> Iterator[tuple[Float32s, int]]:
    """The votes around some pixels, all planes from near to far, some pixels at a time.

    Yields:
        (B, PLANES, SIDE_PX, SIDE_PX, L) float32, as shares of each pixel's largest value, and how
        many pixels they are; pixel m is lane m % L of block m // L.
    """
    for first in range(0, len(rows), BATCH):
        part = rows[first : first + BATCH], columns[first : first + BATCH]
        middle, every = np.full(len(part[0]), PLANES // 2), np.ones(len(part[0]), np.int64)
        patches = kept.patches(*part, middle, every, PLANES, SIDE_PX)
        fused, _ = fused_patches(fusion, patches)
        near_first = fused if view.rho[0] > view.rho[-1] else fused[:, ::-1]
        top = np.maximum(near_first.max(axis=(1, 2, 3), keepdims=True), _LEAST_VOTES)
        yield np.ascontiguousarray(near_first / top), len(part[0])
