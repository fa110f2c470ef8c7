"""The networks in torch, for training: `networks` runs the same weights without it.

Layers of DERD-Net have the names that the authors' code gives them, so that their files fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from eventsweep.plugins.learned.networks.derd import UniformIn
from eventsweep.plugins.learned.networks.network import (
    CHANNELS,
    CUES,
    LOG_ERROR_RANGE,
    Architecture,
)
from eventsweep.plugins.learned.training.config import TrainingConfig
from eventsweep.plugins.learned.training.samples import shares_of_codes

MOST_PX = 8.0
"""Errors count as at most so much: beyond, one is as wrong as another."""

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


class Judged(NamedTuple):
    """What the network says of some candidates.

    Attributes:
        logits: (M, D) of each sample along the ray.
        offset: (M,) where the depth lies, samples from the patch's middle.
        log_error: (M, 2) natural logarithms of the expected error of that depth, and of the one by
            focus, px of disparity.
    """

    logits: Tensor
    offset: Tensor
    log_error: Tensor


class Network(Trainable):
    """From a patch to its ray, along the ray to logits, from the best sample to expected errors."""

    one_cycle, mirrored, most_gradient = True, "codes", 1.0

    def __init__(self, shape: Architecture) -> None:
        super().__init__()
        wide, deep = shape.wide, shape.deep
        self.patch = nn.Conv3d(len(CHANNELS), wide, 3, padding=(1, 0, 0))
        self.ray = nn.Conv3d(wide, deep, (3, 5, 5), padding=(1, 0, 0))
        self.near = nn.Conv1d(deep, deep, 5, padding=2)
        self.far = nn.Conv1d(deep, deep, 5, padding=4, dilation=2)
        self.score = nn.Conv1d(deep, 1, 1)
        self.hidden = nn.Linear(deep + len(CUES) + 2, shape.hidden)
        self.error = nn.Linear(shape.hidden, 2)
        self.peak = shape.peak
        self.register_buffer("shares", torch.from_numpy(shares_of_codes()), persistent=False)

    def forward(self, shares: Tensor, cues: Tensor) -> Judged:
        """Judges candidates by their (M, 3, D, S, S) shares of the largest vote and (M, F) cues."""
        across = torch.relu(self.ray(torch.relu(self.patch(shares))))[..., 0, 0]
        along = across + torch.relu(self.near(across))
        along = along + torch.relu(self.far(along))
        logits = self.score(along)[:, 0]
        offset, best, sure = self._place(logits)
        at_best = torch.gather(along, 2, best[:, None, None].expand(-1, along.shape[1], 1))[..., 0]
        hints = torch.stack([offset.detach() / 4, sure.detach()], dim=1)
        hidden = torch.relu(self.hidden(torch.cat([at_best, cues, hints], dim=1)))
        return Judged(logits, offset, self.error(hidden))

    def _place(self, logits: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The soft maximum near the best sample, that sample, and the share of its surroundings."""
        depth = logits.shape[1]
        share = torch.softmax(logits, dim=1)
        best = logits.argmax(dim=1)
        sample = torch.arange(depth, device=logits.device)
        near = share * ((sample[None] - best[:, None]).abs() <= self.peak)
        total = near.sum(dim=1)
        place = (near * sample).sum(dim=1) / total
        return place - depth // 2, best, total

    def loss(self, inputs: Inputs) -> Tensor:
        """Cross-entropy to where the depth lies, and the likelihood of both errors."""
        judged, target = self._judged(inputs), inputs["target"]
        depth = judged.logits.shape[1]
        sample = torch.arange(depth, device=target.device) - depth // 2
        inside = (target.abs() <= depth // 2).float()
        likely = torch.softmax(-0.5 * (sample[None] - target[:, None]) ** 2, dim=1)
        crossed = -(likely * functional.log_softmax(judged.logits, dim=1)).sum(dim=1)
        own_px = (judged.offset - target).abs() * inputs["sample_px"]
        both_px = torch.stack([own_px.detach(), inputs["focus_error_px"]], dim=1)
        spread = judged.log_error.clamp(*LOG_ERROR_RANGE)
        unlikely = (both_px.clamp(max=MOST_PX) * torch.exp(-spread) + spread).mean(dim=1)
        close = functional.smooth_l1_loss(judged.offset, target, reduction="none", beta=0.25)
        return (inside * (crossed + 0.3 * close.clamp(max=4)) + 0.3 * unlikely).mean()

    def outcome(self, inputs: Inputs) -> Outcome:
        """Of the two depths the one that is expected to be better counts."""
        judged = self._judged(inputs)
        own_px = (judged.offset - inputs["target"]).abs() * inputs["sample_px"]
        own = judged.log_error[:, 0] < judged.log_error[:, 1]
        expected_px = judged.log_error.min(dim=1).values.exp()
        return Outcome(torch.where(own, own_px, inputs["focus_error_px"]), expected_px)

    def _judged(self, inputs: Inputs) -> Judged:
        judged: Judged = self(self.shares[inputs["codes"].long()], inputs["cues"])
        return judged


class DerdNetwork(Trainable):
    """DERD-Net: a convolution, a recurrent unit along the depth, two dense layers."""

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
        near_px, far_px, true_px = inputs["near_px"], inputs["far_px"], inputs["true_px"]
        if self._uniform_in == "linear":
            place = (1 / true_px - 1 / near_px) / (1 / far_px - 1 / near_px)
        else:
            place = (near_px - true_px) / (near_px - far_px)
        return (self._places(inputs) - place.clamp(0, 1)).abs().mean()

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


def untrained(config: TrainingConfig) -> Trainable:
    """The network to train, with weights drawn at random."""
    if config.network == "learned":
        return Network(Architecture())
    return DerdNetwork(config.uniform_in)
