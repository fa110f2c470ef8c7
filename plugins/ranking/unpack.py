"""A stage in place of the first one: a sequence out of an archive instead of the simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep.eval.jobs.job import SEQUENCE, Runtime
from eventsweep.plugins.ranking.archives.manifest import PackedFile
from eventsweep.plugins.ranking.archives.tarball import unpack


def run(
    parameters: Mapping[str, Any], inputs: Sequence[Path], out: Path, _runtime: Runtime
) -> None:
    """Unpacks the files that `files` lists, each of the size and hash that it says."""
    expected = {name: PackedFile(**entry) for name, entry in parameters["files"].items()}
    (out / SEQUENCE).mkdir()
    unpack(inputs[0], out / SEQUENCE, expected)
