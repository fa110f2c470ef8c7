"""`map.json`: what a map folder holds and what made it."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.map_files import CURE

SCHEMA_VERSION = 1


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RecordingInfo(_Model):
    """Which recording was mapped; `manifest_sha256` is None for other people's formats."""

    name: str
    path: str
    manifest_sha256: str | None = None

    @classmethod
    def of(cls, recording: Recording, path: Path, map_folder: Path) -> RecordingInfo:
        """What a map folder remembers of its recording; a path beside it is kept relative."""
        path, map_folder = path.resolve(), map_folder.resolve()
        together = path.parent == map_folder.parent
        # Imported here: HDF5 is a library that reading a map's index does without.
        from emvs.data.sequence import Sequence as EventSequence

        digest = recording.manifest.digest() if isinstance(recording, EventSequence) else None
        place = f"../{path.name}" if together else str(path)
        return cls(name=recording.name, path=place, manifest_sha256=digest)


class WindowInfo(_Model):
    """One window in `map.json`; times in µs, counts per camera and by what became of events.

    `device` is what swept it: `cpu`, or the name of a GPU; `cpu` where only rivals ran.
    """

    name: str = Field(pattern=r"^\w[\w-]*$")
    t0_us: int
    t1_us: int
    t_ref_us: int
    methods: tuple[str, ...]
    counts: dict[str, dict[str, int]]
    points: dict[str, int] = {}
    device: str = "cpu"


class SkippedWindow(_Model):
    """A sliding window that could not be mapped, and why."""

    name: str
    t0_us: int
    t1_us: int
    reason: str


class HotPixelInfo(_Model):
    """The hot pixels of one camera: (x, y) of each, and how many events they sent."""

    pixels: tuple[tuple[int, int], ...]
    events: int


class MapInfo(_Model):
    """The whole of `map.json`.

    Attributes:
        schema_version: of this file.
        recording: what was mapped.
        config: every parameter.
        versions: of everything that can change a result.
        windows: those mapped, in order.
        skipped: those that could not be.
        hot_pixels: per camera, where the filter is on.
        without_pose: with sliding windows, events per camera that no pose covers.
        recording_sha256: with sliding windows, of calibration, poses and spans.
        complete: False while a run with sliding windows goes on, or where it was stopped.
    """

    schema_version: int
    recording: RecordingInfo
    config: MapperConfig
    versions: dict[str, str]
    windows: tuple[WindowInfo, ...]
    skipped: tuple[SkippedWindow, ...] = ()
    hot_pixels: dict[str, HotPixelInfo] = {}
    without_pose: dict[str, int] = {}
    recording_sha256: str | None = None
    complete: bool = True


def read_info(directory: Path) -> MapInfo:
    """Reads `map.json` of a map folder.

    Raises:
        InputError: no map there, or a file that is damaged or of another version.
    """
    index = directory / "map.json"
    try:
        text = index.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{directory} is no map, map.json cannot be read ({error})") from error
    return _parse(index, text)


def _parse(index: Path, text: str) -> MapInfo:
    try:
        found = json.loads(text).get("schema_version")
    except (json.JSONDecodeError, AttributeError) as error:
        raise InputError(f"{index}: not the JSON of a map ({error}): {CURE}") from error
    if found != SCHEMA_VERSION:
        raise InputError(f"{index}: schema version {found}, needs {SCHEMA_VERSION}: {CURE}")
    try:
        return MapInfo.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{index}: {where}: {first['msg']}: {CURE}") from error
