"""Every parameter of training; imports neither numpy nor torch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from emvs.parameters import ParameterGroup

Positive = Annotated[float, Field(gt=0)]
History = list[dict[str, float]]
"""Numbers of every epoch, by name."""


class TrainingConfig(ParameterGroup):
    """What a network is trained on, and how."""

    scenes: tuple[str, ...] = Field(
        default=(), description="only sequences of these scenes; by default of all"
    )
    candidates: int = Field(
        default=3000, ge=1, description="candidates that are drawn from each window, at most"
    )
    epochs: int = Field(default=8, ge=1, description="how often every candidate is seen")
    batch: int = Field(default=256, ge=2, description="candidates of one step")
    learning_rate: Positive = Field(
        default=3e-3, description="largest rate of the one-cycle schedule"
    )
    seed: int = Field(default=0, ge=0, description="of weights, order and flips")
    threads: int = Field(default=1, ge=1, description="threads of torch; they change the bits")
    device: Literal["cpu", "cuda"] = Field(default="cpu", description="where the network learns")
