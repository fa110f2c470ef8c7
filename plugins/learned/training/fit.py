"""The training loop: epochs over all samples, a checkpoint after each, the same bits every time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.progress import Update
from eventsweep.plugins.learned.training.config import History, TrainingConfig
from eventsweep.plugins.learned.training.network import MOST_PX, Inputs, untrained
from eventsweep.plugins.learned.training.samples import SampleSet
from eventsweep.plugins.learned.training.tasks import TASKS

_JUDGED_AT_ONCE = 2048


class Fitting:
    """A network in training.

    It is judged by the calibration samples after each epoch, and its checkpoint is written then;
    one that is there is taken up. `history` holds the numbers of every epoch so far.
    """

    def __init__(
        self, config: TrainingConfig, training: SampleSet, calibration: SampleSet, checkpoint: Path
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
        self.network = untrained(config).to(config.device)
        self._steps = len(training) // config.batch
        self._optimiser = torch.optim.AdamW(self.network.parameters(), config.learning_rate)
        self._schedule: torch.optim.lr_scheduler.LRScheduler = (
            torch.optim.lr_scheduler.OneCycleLR(
                self._optimiser, config.learning_rate, config.epochs * self._steps
            )
            if self.network.one_cycle
            else torch.optim.lr_scheduler.ConstantLR(self._optimiser, factor=1.0)
        )
        self.history: History = []
        if checkpoint.exists():
            self._resume()

    def run(self, update: Update) -> None:
        """Trains the epochs that are left."""
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
        inputs = self._inputs(self._training[picked])
        axes = [axis for bit, axis in ((1, -1), (2, -2)) if flips & bit]
        if mirrored := self.network.mirrored:
            inputs = {**inputs, mirrored: inputs[mirrored].flip(axes)}
        value = self.network.loss(inputs)
        self._optimiser.zero_grad()
        value.backward()
        if most := self.network.most_gradient:
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), most)
        self._optimiser.step()
        self._schedule.step()
        return float(value.item())

    def _inputs(self, batch: SampleSet) -> Inputs:
        arrays = batch.inputs().items()
        return {
            name: torch.from_numpy(np.ascontiguousarray(array)).to(self._config.device)
            for name, array in arrays
        }

    @torch.no_grad()
    def _judged(self) -> dict[str, float]:
        """Errors on the calibration samples, and those of what the network is compared with."""
        known, compared = self._calibration, TASKS[self._config.network].compared
        starts = range(0, len(known), _JUDGED_AT_ONCE)
        parts = (known[first : first + _JUDGED_AT_ONCE] for first in starts)
        outcomes = [self.network.outcome(self._inputs(part)) for part in parts]
        error = torch.cat([outcome.error_px for outcome in outcomes]).cpu().numpy()
        numbers = _errors("all", error) | _errors(f"{compared}_all", known.compared_error_px)
        expected = [each.expected_px for each in outcomes if each.expected_px is not None]
        rank = known.compared_rank
        if rank is not None and expected:
            third = len(error) // 3
            best = torch.cat(expected).cpu().numpy().argsort(kind="stable")[:third]
            sure = (-rank).argsort(kind="stable")[:third]
            numbers |= _errors("reliable", error[best])
            numbers |= _errors(f"{compared}_reliable", known.compared_error_px[sure])
        return numbers

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
