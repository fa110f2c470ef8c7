"""Every parameter of training; imports neither numpy nor torch."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eventsweep.emvs.parameters import ParameterGroup

Positive = Annotated[float, Field(gt=0)]
History = list[dict[str, float]]
"""Numbers of every epoch, by name."""
NetworkName = Literal["learned", "derd"]
DEFAULTS: dict[NetworkName, dict[str, Any]] = {
    "learned": {"epochs": 8, "batch": 256, "learning_rate": 3e-3},
    "derd": {"epochs": 3, "batch": 64, "learning_rate": 1e-3},
}
"""What each network is trained with by default: ours, and what is published."""


class TrainingConfig(ParameterGroup):
    """What a network is trained on, and how."""

    network: NetworkName = Field(
        default="learned",
        description="learned: the network of the Learned methods; derd: that of DERD/H",
    )
    uniform_in: Literal["linear", "inverse"] = Field(
        default="inverse",
        description="derd only: its output in equal steps of inverse depth, which all depth ranges "
        "have in common, or of depth (linear), as published",
    )
    scenes: tuple[str, ...] = Field(
        default=(), description="only sequences of these scenes; by default of all"
    )
    candidates: int = Field(
        default=3000, ge=1, description="most candidates drawn from each window"
    )
    epochs: int = Field(
        default=8, ge=1, description="how often every candidate is used; derd: by default 3"
    )
    batch: int = Field(default=256, ge=2, description="candidates per step; derd: by default 64")
    learning_rate: Positive = Field(
        default=3e-3,
        description="largest rate of the one-cycle schedule; derd: the only rate, by default 0.001",
    )
    seed: int = Field(default=0, ge=0, description="of weights, order and flips")
    threads: int = Field(
        default=1, ge=1, description="threads of torch; they change the last bits of the result"
    )
    device: Literal["cpu", "cuda"] = Field(default="cpu", description="where the network learns")

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_the_network(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("network") not in DEFAULTS:
            return values
        return {**DEFAULTS[values["network"]], **values}

    @model_validator(mode="after")
    def _check(self) -> TrainingConfig:
        if self.network == "learned" and "uniform_in" in self.model_fields_set:
            raise ValueError(
                f"uniform_in {self.uniform_in} with network learned: only derd has it; leave it out"
            )
        return self
