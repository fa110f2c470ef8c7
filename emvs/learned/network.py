"""The network of the learned extraction, as it runs: weights and compiled loops, nothing else.

Three 3 x 3 x 3 convolutions' worth of patch become a ray; along the ray two residual convolutions
find where it is in focus; from the best sample, and from what the extraction by focus says, come
the expected errors of both depths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.depth.precision import Precision, table_name
from emvs.learned import network_kernels
from emvs.learned.weights import Weights, packaged, read_weights, stamp

NAME = "eventsweep-learned-1"
"""Of the network in manifests: another architecture, or other inputs, is another network."""
DEPTH = 17
"""Samples along the ray, the plane in focus in the middle."""
SIDE_PX = 7
"""Rows and columns of a patch."""
CHANNELS = ("fused", "first camera", "mean of the others")
CUES = (
    "sample_px", "fitted", "focus", "votes_peak", "first_camera", "other_cameras", "agreement",
    "support", "inside", "ray", "strength", "votes", "disparity",
)  # fmt: skip
"""What the network is told beside the votes, as numbers of about unit size."""
OUTPUTS = 2  # expected errors: of the network's own depth, and of the depth by focus
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Architecture:
    """Sizes of the network.

    Attributes:
        wide: channels of a patch.
        deep: channels along the ray.
        hidden: units between the best sample and the errors.
        peak: samples on either side of the best one that decide where the depth lies.
    """

    wide: int = 8
    deep: int = 24
    hidden: int = 32
    peak: int = 2

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of every array, in the order in which the loops take them."""
        wide, deep, hidden = self.wide, self.deep, self.hidden
        layers = {
            "patch": (wide, len(CHANNELS), 3, 3, 3),
            "ray": (deep, wide, 3, 5, 5),
            "near": (deep, deep, 5),
            "far": (deep, deep, 5),
            "score": (1, deep, 1),
            "hidden": (hidden, deep + len(CUES) + 2),
            "error": (OUTPUTS, hidden),
        }
        return {
            f"{layer}.{kind}": shape if kind == "weight" else shape[:1]
            for layer, shape in layers.items()
            for kind in ("weight", "bias")
        }


@dataclass(frozen=True, eq=False)
class Network:
    """A trained network.

    Attributes:
        weights: its arrays and their manifest.
        shape: its sizes.
    """

    weights: Weights
    shape: Architecture = Architecture()

    def judge(self, shares: Floats, cues: Floats) -> tuple[Floats, Floats]:
        """Says where the depth of some pixels lies, and how wrong that may be.

        Args:
            shares: (B, 3, D, S, S, L) as `emvs.learned.inputs.channels` makes them.
            cues: (M, F), M at most B L.

        Returns:
            (M,) samples from the middle of the patch; and (M, 2) natural logarithms of the expected
            errors, px of disparity: of that depth, and of the depth by focus. float32.
        """
        offset = np.empty(len(cues), np.float32)
        log_error = np.empty((len(cues), OUTPUTS), np.float32)
        rows = shares.reshape(*shares.shape[:4], shares.shape[4] * shares.shape[5])
        arrays = [_filled_up(name, self.weights.arrays[name]) for name in self.shape.shapes()]
        network_kernels.judge(  # type: ignore[call-arg]
            rows, cues, *arrays, self.shape.peak, offset, log_error
        )
        return offset, log_error

    def precision(self, method: str) -> Precision | None:
        """What the expected error of a method is worth, where the manifest says so.

        Raises:
            InputError: a manifest whose table is none.
        """
        stated = self.weights.manifest.get("precision", {}).get(table_name(method))
        return None if stated is None else Precision.from_json(stated)


def _filled_up(name: str, array: Floats) -> Floats:
    """Weights of a convolution as the loops take them: of a multiple of `FEW` channels."""
    missing = -len(array) % network_kernels.FEW
    if name.split(".")[0] not in ("patch", "ray", "near", "far") or not missing:
        return array
    return np.concatenate([array, np.zeros((missing, *array.shape[1:]), np.float32)])


def network(path: Path | None = None) -> Network:
    """The network of a file of weights; by default the one that ships with the package.

    Raises:
        InputError: weights that cannot be read, or are of another network.
    """
    path = path or packaged("learned")
    return _network(path, stamp(path))


@cache
def _network(path: Path, _stamp: tuple[int, ...]) -> Network:
    shape = Architecture()
    return Network(read_weights(path, NAME, shape.shapes()), shape)
