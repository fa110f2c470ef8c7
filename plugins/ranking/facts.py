"""`submission.toml`: what is submitted, by whom, under which licence, at which cost."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat, ValidationError

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.parameters import FrozenModel
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, inside, parse_toml, read_text

FACTS = "submission.toml"
_Line = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
_Positive = Annotated[FiniteFloat, Field(gt=0)]


class StatedCost(FrozenModel):
    """What a submitter says that one window costs; nobody here measured it."""

    seconds_per_window: _Positive = Field(description="time for one window, s, on average")
    peak_memory_mb: _Positive = Field(description="memory at most, MB")
    hardware: _Line = Field(description="processor and accelerator, in words")


class SubmissionFacts(FrozenModel):
    """`submission.toml`: what is submitted, by whom, under which licence, at which cost."""

    method: _Line = Field(description="name of the method")
    authors: Annotated[tuple[_Line, ...], Field(min_length=1, max_length=100)]
    licence: _Line = Field(description="of the depth maps, as SPDX names it")
    url: _Line | None = Field(None, description="where method or paper are found")
    cost: StatedCost


class SequenceCost(FrozenModel):
    """What a submitter says that one sequence costs; nobody here measured it."""

    seconds_per_sequence: _Positive = Field(description="time for one sequence, s, on average")
    peak_memory_mb: _Positive = Field(description="memory at most, MB")
    hardware: _Line = Field(description="processor and accelerator, in words")


class FileFacts(FrozenModel):
    """`submission.toml` of the tracks with one file per sequence: it names its track."""

    track: Literal["geometry", "odometry"] = Field(description="of the ranking")
    method: _Line = Field(description="name of the method")
    authors: Annotated[tuple[_Line, ...], Field(min_length=1, max_length=100)]
    licence: _Line = Field(description="of the files, as SPDX names it")
    url: _Line | None = Field(None, description="where method or paper are found")
    cost: SequenceCost


AnyFacts = SubmissionFacts | FileFacts


def read_facts(folder: Path) -> AnyFacts:
    """Reads `submission.toml` in a folder."""
    path = inside(folder, FACTS)
    model: type[AnyFacts] = SubmissionFacts
    try:
        values = parse_toml(read_text(path, SETTINGS_BYTES))
        model = FileFacts if "track" in values else SubmissionFacts
        return model.model_validate(values)
    except FileNotFoundError as error:
        raise InputError(
            f"{path}: is missing; needs method, authors, licence, and [cost] with "
            f"{', '.join(StatedCost.model_fields)}"
        ) from error
    except ValidationError as error:
        raise InputError(f"{path}: {_first(error, model)}") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not TOML ({error}): correct it") from error


def _first(error: ValidationError, model: type[AnyFacts]) -> str:
    fault = error.errors()[0]
    where = ".".join(map(quoted, fault["loc"]))
    cost: Any = model.model_fields["cost"].annotation
    known = ", ".join((*model.model_fields, *(f"cost.{name}" for name in cost.model_fields)))
    more = "is missing" if fault["type"] == "missing" else fault["msg"]
    depth = "; of depth maps, leave track out" if where == "track" else ""
    return f"{where}: {more}; it holds {known}{depth}"
