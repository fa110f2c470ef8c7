"""`eventsweep train`: weights of the networks that extract depth, from simulated sequences."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from eventsweep.eval.cli.app import COMMON, NO_NEGATIVE, Common
from eventsweep.eval.cli.help import RARE


def train(
    *,
    out: Path,
    scene: Annotated[tuple[str, ...], NO_NEGATIVE] = (),
    network: Literal["learned", "derd"] = "learned",
    uniform_in: Annotated[Literal["linear", "inverse"] | None, RARE] = None,
    epochs: int | None = None,
    candidates: Annotated[int, RARE] = 3000,
    batch: Annotated[int | None, RARE] = None,
    learning_rate: Annotated[float | None, RARE] = None,
    seed: Annotated[int, RARE] = 0,
    threads: Annotated[int, RARE] = 1,
    device: Literal["cpu", "cuda"] = "cpu",
    published: Annotated[tuple[Path, ...], NO_NEGATIVE, RARE] = (),
    common: Common = COMMON,
) -> None:
    """Train the network of the Learned methods on simulated sequences.

    The same command resumes a stopped run. Use the weights with
    --map.learned.weights OUT/learned.npz, those of DERD-Net with --map.derd.weights OUT/derd.npz.
    Needs torch: the extra `train`.

    Args:
        out: Folder that gets sequences, samples, weights and a page; it may hold a stopped run.
        scene: Learn from sequences of this scene only; may be given several times.
        network: learned: that of the Learned methods; derd: the published DERD-Net, for DERD/H.
        uniform_in: DERD-Net's output in equal steps of inverse depth (inverse, the default), or of
            depth (linear), as published.
        epochs: How often every pixel is used; by default 8, and 3 for DERD-Net.
        candidates: Most pixels drawn from each window.
        batch: Pixels per step; by default 256, and 64 for DERD-Net.
        learning_rate: Largest rate of the one-cycle schedule, by default 0.003; for DERD-Net the
            constant rate, 0.001.
        seed: Seed of weights, order and flips.
        threads: Threads of torch; they change the last bits of the result.
        device: Where the network learns.
        published: Do not train: convert the weights that DERD-Net's authors published (.pth) into
            OUT/derd.npz; given twice, both networks are averaged.
    """
    from eventsweep.plugins.learned.training.config import TrainingConfig
    from eventsweep.plugins.learned.training.page import write_training_page
    from eventsweep.plugins.learned.training.train import train as trained_in

    flags = {
        "uniform_in": uniform_in, "epochs": epochs, "batch": batch, "learning_rate": learning_rate,
    }  # fmt: skip
    given = {name: value for name, value in flags.items() if value is not None}
    config = TrainingConfig(
        network=network, scenes=scene, candidates=candidates, seed=seed, threads=threads,
        device=device, **given,
    )  # fmt: skip
    console = common.console()
    if published:
        from eventsweep.emvs.errors import InputError
        from eventsweep.plugins.learned.training.published import convert

        if unused := [*given, *(["scene"] if scene else [])]:
            raise InputError(f"published weights are not trained: leave out {', '.join(unused)}")
        console.wrote(convert(published, out))
        return
    trained = trained_in(out, config, console.progress)
    console.wrote(trained.weights)
    console.wrote(write_training_page(out, trained))
