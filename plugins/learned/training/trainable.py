"""What a network in torch must offer to be trained here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

Inputs = Mapping[str, Tensor]
"""The arrays of `SampleSet.inputs`, as tensors of one batch."""


class Outcome(NamedTuple):
    """What a network makes of samples whose depth is known.

    Attributes:
        error_px: (M,) error of its depth, px of disparity.
        expected_px: (M,) what it expects of it; None where it expects nothing.
    """

    error_px: Tensor
    expected_px: Tensor | None


class Trainable(nn.Module):
    """A network in torch; `state_dict` holds its weights and nothing else.

    Attributes:
        one_cycle: whether the rate rises and falls once; else it stays.
        mirrored: the input that is mirrored at random, left and right, top and bottom; "": none.
        most_gradient: norm to which gradients are cut; 0: they are not.
    """

    one_cycle, mirrored, most_gradient = False, "", 0.0

    def loss(self, inputs: Inputs) -> Tensor:
        """What training makes small, of one batch."""
        raise NotImplementedError

    def outcome(self, inputs: Inputs) -> Outcome:
        """What it makes of samples."""
        raise NotImplementedError

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The weights by name, as they are written."""
        return {name: tensor.detach().cpu().numpy() for name, tensor in self.state_dict().items()}
