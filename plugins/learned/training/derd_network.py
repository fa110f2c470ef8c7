"""DERD-Net in torch, for training; `networks.derd` runs the same weights without it.

The layers have the names that the authors' code gives them, so that their files fit.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from eventsweep.plugins.learned.networks.derd import UniformIn
from eventsweep.plugins.learned.training.trainable import Inputs, Outcome, Trainable


class DerdNetwork(Trainable):
    """One model: a convolution, a recurrent unit along the depth, two dense layers."""

    def __init__(self, uniform_in: UniformIn = "linear") -> None:
        super().__init__()
        conv = nn.Conv3d(1, 4, 3, stride=(2, 1, 1), padding=(1, 0, 0))
        self.conv3d = nn.Sequential(conv, nn.ReLU())
        self.gru = nn.GRU(100, 100, batch_first=True)
        dense = nn.Linear(100, 100), nn.ReLU(), nn.Identity(), nn.Linear(100, 1)
        self.dense_output = nn.Sequential(*dense)
        self._uniform_in = uniform_in

    def forward(self, columns: Tensor) -> Tensor:
        """(M, D, S, S) shares of the largest value to (M,) places in the depth range."""
        steps = self.conv3d(columns[:, None]).transpose(1, 2).flatten(start_dim=2)
        states, _ = self.gru(steps)
        place: Tensor = self.dense_output(states[:, -1])[:, 0]
        return place

    def loss(self, inputs: Inputs) -> Tensor:
        """Mean absolute error of the place, as published."""
        return (self._places(inputs) - self._wanted(inputs)).abs().mean()

    def outcome(self, inputs: Inputs) -> Outcome:
        """Errors in disparity; it expects none."""
        near_px, far_px = inputs["near_px"], inputs["far_px"]
        place = self._places(inputs).clamp(0, 1)
        if self._uniform_in == "linear":
            own_px = 1 / (1 / near_px + place * (1 / far_px - 1 / near_px))
        else:
            own_px = near_px - place * (near_px - far_px)
        return Outcome((own_px - inputs["true_px"]).abs(), None)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The weights by name, of model 0."""
        return {f"0.{name}": array for name, array in super().arrays().items()}

    def _places(self, inputs: Inputs) -> Tensor:
        place: Tensor = self(inputs["columns"].to(torch.float32) / 255)
        return place

    def _wanted(self, inputs: Inputs) -> Tensor:
        """(M,) where the true depth lies in the range, clipped to 0..1."""
        near_px, far_px, true_px = inputs["near_px"], inputs["far_px"], inputs["true_px"]
        if self._uniform_in == "linear":
            place = (1 / true_px - 1 / near_px) / (1 / far_px - 1 / near_px)
        else:
            place = (near_px - true_px) / (near_px - far_px)
        return place.clamp(0, 1)
