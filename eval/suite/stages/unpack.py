"""A stage in place of the first one: a sequence out of an archive instead of the simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.eval.archives.manifest import PackedFile
from eventsweep.eval.archives.tarball import unpack
from eventsweep.eval.jobs.job import SEQUENCE


def run(parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path) -> None:
    """Unpacks the files that `files` lists, each of the size and hash that it says."""
    expected = {name: PackedFile(**entry) for name, entry in parameters["files"].items()}
    (out / SEQUENCE).mkdir()
    unpack(inputs[0], out / SEQUENCE, expected)
