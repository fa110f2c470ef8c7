"""The training loop: epochs over all samples, a checkpoint after each, the same bits every time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from emvs.errors import InputError
from emvs.learned.network import Architecture
from emvs.utils.files import atomic_path
from eval.learning.config import History, TrainingConfig
from eval.learning.network import MOST_PX, Network, loss
from eval.learning.samples import Samples, shares_of_codes
from eval.progress import Update

_CLIP = 1.0
_JUDGED_AT_ONCE = 2048


class Fitting:
    """A network in training.

    Args:
        config: schedule, seed, device.
        training: what it learns from.
        calibration: what it is judged by after each epoch.
        checkpoint: file that is written after each epoch, and read if it is there.

    Attributes:
        history: numbers of every epoch so far.
        network: the network.

    Raises:
        InputError: a GPU that is not there, fewer samples than one batch, a damaged checkpoint.
    """

    def __init__(
        self, config: TrainingConfig, training: Samples, calibration: Samples, checkpoint: Path
    ) -> None:
        if config.device == "cuda" and not torch.cuda.is_available():
            raise InputError("device cuda: torch finds no GPU; choose cpu")
        if len(training) < config.batch:
            raise InputError(
                f"{len(training)} samples: a batch needs {config.batch}; lower batch, or choose "
                "more scenes"
            )
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self._config, self._training, self._calibration = config, training, calibration
        self._checkpoint = checkpoint
        self._table = torch.from_numpy(shares_of_codes()).to(config.device)
        self.network = Network(Architecture()).to(config.device)
        self._steps = len(training) // config.batch
        self._optimiser = torch.optim.AdamW(self.network.parameters(), config.learning_rate / 3)
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimiser, config.learning_rate, config.epochs * self._steps
        )
        self.history: History = []
        if checkpoint.exists():
            self._resume()

    def run(self, update: Update) -> None:
        """Trains the epochs that are left.

        Args:
            update: told how many epochs are done, and a few words.
        """
        for epoch in range(len(self.history), self._config.epochs):
            mean = self._epoch(epoch, update)
            self.history.append({"loss": mean, **self._judged()})
            self._keep()

    def _epoch(self, epoch: int, update: Update) -> float:
        rng = np.random.default_rng([self._config.seed, epoch])
        total = 0.0
        for step, picked in enumerate(self._batches(rng)):
            judged_loss = self._step(picked, int(rng.integers(4)))
            total += judged_loss
            if step % 50 == 0:
                share = epoch + step / self._steps
                update(share, f"epoch {epoch + 1}/{self._config.epochs}, loss {judged_loss:.3f}")
        return total / self._steps

    def _batches(self, rng: np.random.Generator) -> Iterator[NDArray[np.int64]]:
        order = rng.permutation(len(self._training))
        for first in range(0, self._steps * self._config.batch, self._config.batch):
            yield np.sort(order[first : first + self._config.batch])

    def _step(self, picked: NDArray[np.int64], flips: int) -> float:
        """One batch, mirrored as the two bits of `flips` say: left and right, top and bottom."""
        batch = self._training[picked]
        shares = self._shares(batch)
        axes = [axis for bit, axis in ((1, -1), (2, -2)) if flips & bit]
        shares = shares.flip(axes) if axes else shares
        value = loss(
            self.network(shares, self._tensor(batch.cues)), self._tensor(batch.sample_px),
            self._tensor(batch.target), self._tensor(batch.focus_error_px),
        )  # fmt: skip
        self._optimiser.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _CLIP)
        self._optimiser.step()
        self._schedule.step()
        return float(value.item())

    def _shares(self, batch: Samples) -> Tensor:
        return self._table[self._tensor(batch.codes).long()]

    def _tensor(self, array: NDArray[Any]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._config.device)

    def judge(self, samples: Samples) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The chosen depth's expected and true error of samples, (M,) px of disparity each."""
        parts = range(0, len(samples), _JUDGED_AT_ONCE)
        found = [self._judge(samples[first : first + _JUDGED_AT_ONCE]) for first in parts]
        expected, error = (np.concatenate(column) for column in zip(*found, strict=True))
        return expected, error

    @torch.no_grad()
    def _judge(self, batch: Samples) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        judged = self.network(self._shares(batch), self._tensor(batch.cues))
        own_px = np.abs(judged.offset.cpu().numpy() - batch.target) * batch.sample_px
        log_error = judged.log_error.cpu().numpy()
        own = log_error[:, 0] < log_error[:, 1]
        return np.exp(log_error.min(axis=1)), np.where(own, own_px, batch.focus_error_px)

    def _judged(self) -> dict[str, float]:
        """Errors on the calibration samples: of all, and of the third that seems most reliable."""
        expected, error = self.judge(self._calibration)
        third = len(error) // 3
        best = np.argsort(expected, kind="stable")[:third]
        focus = self._calibration.focus_error_px
        sure = np.argsort(-self._calibration.reliability, kind="stable")[:third]
        return {
            **_errors("all", error), **_errors("reliable", error[best]),
            **_errors("focus_all", focus), **_errors("focus_reliable", focus[sure]),
        }  # fmt: skip

    def _keep(self) -> None:
        state = {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "schedule": self._schedule.state_dict(),
            "history": self.history,
        }
        with atomic_path(self._checkpoint) as part:
            torch.save(state, part)

    def _resume(self) -> None:
        try:
            state = torch.load(self._checkpoint, weights_only=True)
            self.network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self._schedule.load_state_dict(state["schedule"])
            self.history = list(state["history"])
        except Exception as error:  # torch raises anything for damaged files
            raise InputError(
                f"{self._checkpoint}: cannot be resumed ({type(error).__name__}); delete it to "
                "train from the start"
            ) from error


def _errors(of: str, error_px: NDArray[np.float32]) -> dict[str, float]:
    """Median, mean of at most `MOST_PX`, and share beyond a pixel."""
    return {
        f"{of}_median_px": float(np.median(error_px)),
        f"{of}_mean_px": float(np.minimum(error_px, MOST_PX).mean()),
        f"{of}_beyond_1px": float((error_px > 1).mean()),
    }
