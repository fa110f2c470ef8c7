"""`eventsweep train`: weights of the learned extraction, from simulated sequences."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from eval.cli.app import COMMON, NO_NEGATIVE, Common, app
from eval.cli.help import RARE
from eval.learning.config import TrainingConfig


@app.command
def train(
    *,
    out: Path,
    scene: Annotated[tuple[str, ...], NO_NEGATIVE] = (),
    epochs: int = 8,
    candidates: Annotated[int, RARE] = 3000,
    batch: Annotated[int, RARE] = 256,
    learning_rate: Annotated[float, RARE] = 3e-3,
    seed: Annotated[int, RARE] = 0,
    threads: Annotated[int, RARE] = 1,
    device: Literal["cpu", "cuda"] = "cpu",
    common: Common = COMMON,
) -> None:
    """Train the network of the Learned methods: sequences are simulated, sampled, and learnt from.

    The same command goes on where a stopped one was. Use the weights with
    --map.learned-weights OUT/learned.npz. Needs torch: pip install 'eventsweep[train]'.

    Args:
        out: Folder that gets sequences, samples, weights and a page; it may hold a stopped run.
        scene: Learn from sequences of this scene only; may be given several times.
        epochs: How often every pixel is seen.
        candidates: Pixels that are drawn from each window, at most.
        batch: Pixels of one step.
        learning_rate: Largest rate of the one-cycle schedule.
        seed: Of weights, order and flips.
        threads: Of torch; they change the last bits.
        device: Where the network learns.
    """
    from eval.learning.train import train as trained_in
    from eval.report.training_page import write_training_page

    config = TrainingConfig(
        scenes=scene, epochs=epochs, candidates=candidates, batch=batch,
        learning_rate=learning_rate, seed=seed, threads=threads, device=device,
    )  # fmt: skip
    console = common.console()
    trained = trained_in(out, config, console.progress)
    console.wrote(trained.weights)
    console.wrote(write_training_page(out, trained))
