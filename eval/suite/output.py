"""What a suite's run leaves, and what it asks of predictions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.outputs import check_files, files_together, output_folder
from eventsweep.eval.jobs.job import SEQUENCE, stored
from eventsweep.eval.results.results import (
    PICTURES_FOLDER,
    SUITE_CSV,
    SUITE_NAME,
    Results,
    to_json,
)
from eventsweep.eval.results.table import write_csv
from eventsweep.eval.suite.definition import Suite
from eventsweep.eval.suite.plan import extent, suite_jobs
from eventsweep.eval.suite.predictions import assignment
from eventsweep.eval.suite.source import SequenceSource

_CSV_COLUMNS = ("case", "seed", "window", "method", "metric", "value", "unit", "direction")


@contextmanager
def prepare_folder(out: Path, *, force: bool) -> Iterator[Path]:
    """Claims a folder for results before the work begins; `write` makes it.

    `force` replaces the result of another run.
    """
    names = (SUITE_NAME, SUITE_CSV, PICTURES_FOLDER)
    with output_folder(out, names, force=force) as folder:
        yield folder


def write(folder: Path, result: Results, *, force: bool = False) -> None:
    """Writes `suite.json`, with all that made the numbers, and `suite.csv` with the numbers."""
    check_files(folder, (SUITE_NAME, SUITE_CSV), force=force)
    with files_together(folder, (SUITE_NAME, SUITE_CSV)) as staged:
        (staged / SUITE_NAME).write_text(to_json(result), encoding="utf-8")
        write_csv(staged / SUITE_CSV, result.rows[list(_CSV_COLUMNS)])


def assignments(
    suite: Suite, subset: str, seeds: Sequence[int] | None, cases: Sequence[str] | None,
    archive: SequenceSource | None, cache: Path,
) -> dict[str, Any]:  # fmt: skip
    """What a prediction must hold, and where the cache has the sequences, as plain JSON values."""
    listed = []
    for job in suite_jobs(suite, *extent(suite, subset, seeds, cases, archive), archive):
        made = stored(job.needs[0], Cache(cache)) if cache.is_dir() else None
        where = None if made is None else str(made.path / SEQUENCE)
        asked = assignment(suite, job.parameters["case"], job.parameters["seed"])
        listed.append({**asked.to_json(), "sequence": where})
    about = {"suite": suite.name, "subset": subset, "digest": suite.digest}
    return {"schema_version": 1, **about, "sequences": listed}
