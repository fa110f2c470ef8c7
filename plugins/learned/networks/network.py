"""The network of the learned extraction, as it runs: weights and compiled loops, nothing else.

Three 3 x 3 x 3 convolutions' worth of patch become a ray; along the ray two residual convolutions
find where it is in focus; from the best sample, and from what the extraction by focus says, come
the expected errors of both depths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth import kept_votes_kernels
from eventsweep.plugins.learned.networks import network_kernels
from eventsweep.plugins.learned.networks.weights import Weights, loaded, read_weights

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
"""What the network sees beside the votes, as numbers of about unit size."""
OUTPUTS = 2  # expected errors: of the network's own depth, and of the depth by focus
LOG_ERROR_RANGE = -6.0, 4.0
"""What training can distinguish, ln px: from a four-hundredth of a pixel to some dozen."""
Float32s = NDArray[np.float32]

_L = kept_votes_kernels.LANES
_SHORT, _LONG = (DEPTH + 2) * _L, (DEPTH + 2 * network_kernels.PAD) * _L  # rays, with their ends
_TAPS = {
    "patch": (SIDE_PX * SIDE_PX * _SHORT, _L, SIDE_PX * _SHORT, _SHORT),
    "ray": ((SIDE_PX - 2) ** 2 * _SHORT, _L, (SIDE_PX - 2) * _SHORT, _SHORT),
    "near": (_LONG, _L),
    "far": (_LONG, 2 * _L),
}
"""Convolution -> numbers from one of its inputs to the next, along each axis of its weights."""


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
    """A trained network: its arrays with their manifest, and its sizes."""

    weights: Weights
    shape: Architecture = Architecture()

    def judge(self, shares: Float32s, cues: Float32s) -> tuple[Float32s, Float32s]:
        """Says where the depth of some pixels lies, and how wrong that may be.

        Args:
            shares: (B, 3, S, S, D + 2, L) as `plugins.learned.networks.inputs.channels` makes them.
            cues: (M, F), M at most B L.

        Returns:
            (M,) samples from the middle of the patch; and (M, 2) natural logarithms of the expected
            errors, px of disparity: of that depth, and of the depth by focus. float32.
        """
        offset = np.empty(len(cues), np.float32)
        log_error = np.empty((len(cues), OUTPUTS), np.float32)
        rows = shares.reshape(*shares.shape[:4], shares.shape[4] * shares.shape[5])
        network_kernels.judge(  # type: ignore[call-arg]
            rows, cues, *self._arranged, self.shape.peak, offset, log_error
        )
        return offset, log_error

    @cached_property
    def _arranged(self) -> tuple[object, ...]:
        """The weights as the loops take them: convolutions with their taps, then all others."""
        arrays = self.weights.arrays
        rest = (arrays[n] for n in self.shape.shapes() if n.split(".")[0] not in _TAPS)
        return (
            *(
                _convolution(taps, arrays[f"{layer}.weight"], arrays[f"{layer}.bias"])
                for layer, taps in _TAPS.items()
            ),
            *rest,
        )


def _convolution(
    steps: Sequence[int], weight: Float32s, bias: Float32s
) -> tuple[NDArray[np.int64], Float32s, Float32s]:
    """A convolution with (O, C, ...) weights as `network_kernels.judge` takes it.

    `steps` lead from one input to the next along each axis of the weights but the first.
    """
    if weight.ndim > 3:  # what is farther in memory is summed last
        weight, steps = weight.swapaxes(2, 3), (steps[0], steps[2], steps[1], steps[3])
    taps = np.zeros(1, np.int64)
    for count, step in zip(weight.shape[1:], steps, strict=True):
        taps = np.add.outer(taps, np.arange(count) * step).ravel()
    missing = -len(bias) % network_kernels.FEW
    filled = np.pad(weight.reshape(len(bias), -1), ((0, missing), (0, 0)))
    groups = filled.reshape(-1, network_kernels.FEW, len(taps)).swapaxes(1, 2)
    return taps, np.ascontiguousarray(groups), np.pad(bias, (0, missing))


def network(path: Path | None = None) -> Network:
    """The network of a file of weights; by default the one that ships with the package.

    Raises:
        InputError: weights that cannot be read, or are of another network.
    """
    return loaded("learned", _read, path)


def _read(path: Path) -> Network:
    shape = Architecture()
    return Network(read_weights(path, NAME, shape.shapes()), shape)
