"""The network in torch, for training; `networks.network` runs the same weights without it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from eventsweep.plugins.learned.networks.judgement import LOG_ERROR_RANGE
from eventsweep.plugins.learned.networks.network import CHANNELS, CUES, Architecture
from eventsweep.plugins.learned.training.samples import shares_of_codes
from eventsweep.plugins.learned.training.trainable import Inputs, Outcome, Trainable


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
        """See `loss` of this module."""
        known = inputs["sample_px"], inputs["target"], inputs["focus_error_px"]
        return loss(self._judged(inputs), *known)

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


def loss(judged: Judged, sample_px: Tensor, target: Tensor, errors_px: Tensor) -> Tensor:
    """Cross-entropy to where the depth lies, and the likelihood of both errors.

    Args:
        judged: what the network says.
        sample_px: (M,) disparity between two samples, px.
        target: (M,) where the true depth lies, samples from the patch's middle.
        errors_px: (M,) error of the extraction by focus, px of disparity.
    """
    depth = judged.logits.shape[1]
    sample = torch.arange(depth, device=target.device) - depth // 2
    inside = (target.abs() <= depth // 2).float()
    wanted = torch.softmax(-0.5 * (sample[None] - target[:, None]) ** 2, dim=1)
    crossed = -(wanted * functional.log_softmax(judged.logits, dim=1)).sum(dim=1)
    own_px = (judged.offset - target).abs() * sample_px
    errors = torch.stack([own_px.detach(), errors_px], dim=1).clamp(max=MOST_PX)
    spread = judged.log_error.clamp(*LOG_ERROR_RANGE)
    unlikely = (errors * torch.exp(-spread) + spread).mean(dim=1)
    close = functional.smooth_l1_loss(judged.offset, target, reduction="none", beta=0.25)
    return (inside * (crossed + 0.3 * close.clamp(max=4)) + 0.3 * unlikely).mean()


MOST_PX = 8.0
"""Errors count as at most so much: beyond, one is as wrong as another."""
