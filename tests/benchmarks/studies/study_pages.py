"""What studies write into a page: `python tests/benchmarks study_pages FOLDER PAGE`.

FOLDER holds what `eventsweep study` left. Figures go into the page's `images`, and where each
method breaks becomes a table, so that no number of the page is typed.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.jobs.job import Job
from eventsweep.eval.studies.curves import METRICS, sample_words
from eventsweep.eval.studies.definitions import METHODS as COMPARED
from eventsweep.eval.studies.definitions import STUDIES
from eventsweep.eval.studies.run import StudyResult, study_suite
from eventsweep.eval.studies.stored import find_studies, read_study
from eventsweep.eval.suite.plan import suite_jobs
from markdown_blocks import into_page
from table_code import Code, of_jobs

MARK = "studies"
_COLOURS = 128


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "docs/studies.md#studies": Code(("study_pages:section", "study_pages:overview"))
        + of_jobs(job for name in STUDIES for job in _jobs(name))
    }


def _jobs(name: str) -> list[Job]:
    """Of a study on the page's scenes."""
    suite = study_suite(STUDIES[name], COMPARED, ("boxes", "planes"), (0,))
    return suite_jobs(suite, tuple(suite.cases), suite.seeds)


def main() -> int:
    """Writes the page's part; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what `eventsweep study --out` wrote")
    parser.add_argument("page", type=Path, help="docs/studies.md")
    asked = parser.parse_args()
    with exit_code() as ended:
        write(asked.folder, asked.page)
    return ended.value


def write(folder: Path, page: Path) -> None:
    """Writes the tables into the page and the figures beside it.

    Args:
        folder: with the studies' JSON and PNG files.
        page: with the two marks between which the tables go.

    Raises:
        InputError: no study in the folder, or a page without the marks.
    """
    paths = sorted(find_studies(folder), key=lambda path: _place(path.stem))
    if not paths:
        raise InputError(
            f"{folder}: not a study; `eventsweep study NAME --out {folder}` writes one"
        )
    studies = [read_study(path) for path in paths]
    cost_s = sum(_cost(path, study) for path, study in zip(paths, studies, strict=True))
    images = page.parent / "images"
    images.mkdir(exist_ok=True)
    for path in paths:
        with atomic_path(images / f"study_{path.stem}.png") as partial:
            shrink(path.with_suffix(".png"), partial)
    text = overview(studies, cost_s) + "".join(f"\n{section(study)}" for study in studies)
    into_page(page, MARK, text, code)


def overview(studies: Sequence[StudyResult], cost_s: float) -> str:
    """Markdown: where each method breaks, and what each study averaged and cost.

    Args:
        studies: in the page's order.
        cost_s: time of processors of all, s; jobs that studies share count in each of them.
    """
    methods = list(dict.fromkeys(method for study in studies for method in study.breaking()))
    usual = statistics.mode(map(_samples, studies))
    lines = [
        f"| Study ({usual}) | unit | {' | '.join(methods)} |",
        f"|---|---|{'--:|' * len(methods)}",
    ]
    for study in studies:
        cells = " | ".join(_breaking(study, method) for method in methods)
        name = f"[`{study.about.name}`](#{study.about.name})"
        if _samples(study) != usual:
            name += f" ({_samples(study)})"
        lines.append(f"| {name} | {study.about.unit} | {cells} |")
    lines.append(f"\nTogether {cost_s / 60:.0f} CPU min.")
    return "\n".join(lines) + "\n"


def section(study: StudyResult) -> str:
    """Markdown: a study's figure; its numbers are in the CSV beside it."""
    lines = [
        f"### {study.about.name}\n",
        f"![{study.about.name}](images/study_{study.about.name}.png)",
    ]
    return "\n".join([*lines, *_failed(study)]) + "\n"


def _failed(study: StudyResult) -> Iterable[str]:
    if study.failures:
        name, reason = next(iter(study.failures.items()))
        yield f"\n{len(study.failures)} jobs failed, the first: {name}: {reason}."


def _samples(study: StudyResult) -> str:
    return sample_words(study.about.cases, study.results.seeds).removesuffix(" each")


def _breaking(study: StudyResult, method: str) -> str:
    """The amount, or how many times the first error is the largest one of what was tried."""
    amount = study.breaking().get(method)
    if amount is not None:
        return f"{amount:.3g}"
    curves = (c for c in study.curves if (c.method, c.metric) == (method, METRICS[0]))
    curve = next(curves, None)
    if curve is None or math.isnan(curve.mean[0]):
        return "–"
    return f"never (×{max(curve.mean) / curve.mean[0]:.1f})"


def _cost(path: Path, study: StudyResult) -> float:
    """Of processors, s; earlier versions wrote it beside the curves."""
    facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return float(facts.get("cpu_s", study.cpu_s))


def _place(name: str) -> int:
    """In the order of `eventsweep list`, others last."""
    return list(STUDIES).index(name) if name in STUDIES else len(STUDIES)


def shrink(picture: Path, out: Path) -> None:
    """Writes the picture with few colours, for pages: a quarter of the bytes.

    Raises:
        InputError: there is no such picture.
    """
    if not picture.is_file():
        raise InputError(f"{picture}: missing; run the study again")
    with Image.open(picture) as image:
        few = image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
        few.save(out, format="PNG", optimize=True)


if __name__ == "__main__":
    raise SystemExit(main())
