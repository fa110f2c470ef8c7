"""The folder of somebody else's depth maps: which files, for which times, and what they mean."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from emvs.errors import InputError
from eval.depth_images import SUFFIXES

DESCRIPTION = "prediction.toml"
TIMES = "timestamps.txt"
_STEM = re.compile(r"\d+(\.\d+)?")


class Description(BaseModel):
    """What the numbers in a prediction's files mean: `prediction.toml`, all of it optional."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str | None = Field(None, min_length=1, description="of the method; default: the folder's")
    quantity: Literal["depth", "disparity"] = Field("depth", description="z-depth or disparity")
    scale: FiniteFloat | None = Field(
        None, gt=0, description="m or px per stored unit; needed for PNG, otherwise 1"
    )
    time_unit: Literal["us", "s"] = Field("us", description="of the times in file names")
    time_offset_us: int = Field(0, description="added to the times, µs")
    tolerance_us: int = Field(0, ge=0, description="how far a time may be off, µs")
    baseline_m: FiniteFloat | None = Field(
        None, gt=0, description="that disparities refer to; by default the rig's"
    )
    focal_px: FiniteFloat | None = Field(
        None, gt=0, description="that disparities refer to; by default the reference view's"
    )


def read_description(path: Path) -> Description:
    """Reads `prediction.toml`; all defaults where there is none.

    Raises:
        InputError: no TOML, an unknown key, or an impossible value.
    """
    if not path.exists():
        return Description()
    try:
        return Description.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no TOML ({error}): correct it") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        known = ", ".join(Description.model_fields)
        raise InputError(f"{path}: {where}: {first['msg']}; it may hold {known}") from error


def timed_files(folder: Path, description: Description) -> dict[int, Path]:
    """Finds the depth maps of a folder by their times, µs.

    Raises:
        InputError: none there, times that cannot be told, or two files for one.
    """
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.name != TIMES and not path.name.startswith(".")
    )
    if not paths:
        raise InputError(f"{folder}: no depth maps; needs files of kind {', '.join(SUFFIXES)}")
    listed = folder / TIMES
    times = _listed(listed, paths) if listed.exists() else [_stamp(path) for path in paths]
    per_unit = 1_000_000 if description.time_unit == "s" else 1
    files: dict[int, Path] = {}
    for path, time in zip(paths, times, strict=True):
        t_us = round(float(time) * per_unit) if "." in time else int(time) * per_unit
        t_us += description.time_offset_us
        if t_us in files:
            raise InputError(
                f"{folder}: {files[t_us].name} and {path.name} are both for {t_us} µs: leave one"
            )
        files[t_us] = path
    return files


def _listed(path: Path, files: Sequence[Path]) -> list[str]:
    times = path.read_text(encoding="utf-8", errors="replace").split()
    bad = [time for time in times if not _STEM.fullmatch(time)]
    if bad or len(times) != len(files):
        reason = f"{bad[0]!r} is no time" if bad else f"it has {len(times)} of them"
        raise InputError(
            f"{path}: needs one time a line for each of {len(files)} files in order of names, but "
            f"{reason}"
        )
    return times


def _stamp(path: Path) -> str:
    found = _STEM.match(path.stem)
    if found is None:
        raise InputError(
            f"{path}: its name must begin with the time of its reference view, or {TIMES} beside "
            "it must list the times"
        )
    return found.group()
