"""What the ids of a segmentation mean: a table of geoms beside the sequence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from emvs.errors import InputError

FILE_NAME = "geoms.json"


class Geom(BaseModel):
    """One piece of a scene's geometry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    """The scene's name for it, or that of its body, or its type; not always unique."""

    dynamic: bool
    """Whether it can move by itself; what is not dynamic moves only because the camera does."""


GeomTable = Mapping[int, Geom]
_TABLE = TypeAdapter(dict[int, Geom])


def write_geoms(folder: Path, geoms: GeomTable) -> None:
    """Writes `geoms.json` into a sequence's folder, by rising id."""
    text = _TABLE.dump_json(dict(sorted(geoms.items())), indent=1)
    (folder / FILE_NAME).write_bytes(text + b"\n")


def read_geoms(folder: Path) -> dict[int, Geom]:
    """Reads the table of a sequence.

    Raises:
        InputError: it was not stored, or is damaged.
    """
    path = folder / FILE_NAME
    try:
        return _TABLE.validate_json(path.read_bytes())
    except FileNotFoundError as error:
        raise InputError(f"{path}: not stored; simulate with `segmentation` in `truth`") from error
    except (OSError, ValidationError) as error:
        raise InputError(f"{path}: damaged; make the sequence again") from error
