"""The page: every statement in the paper's order, its figures and its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from eventsweep.eval.results.results import Results
from eventsweep.plugins.paper import section2, section3
from eventsweep.plugins.paper.evidence import Evidence, Missing
from eventsweep.plugins.paper.figures import FIGURES
from eventsweep.plugins.paper.statements import Chapter, Finding, Statement, Verdict

CHAPTERS: tuple[Chapter, ...] = (section2.CHAPTER, section3.CHAPTER)
_CAPTIONS = {
    "paper-figure-2": (
        "Figure 2: depth and confidence of the twins of four recordings",
        "Red is near, blue far, over the paper's ranges. Confidence is dark on white.",
    ),
    "paper-figure-3": (
        "Figure 3: high dynamic range",
        "A frame at one exposure, the events of a few ms, and the depth that each gives.",
    ),
    "paper-windows": (
        "Windows and odometry",
        "Relative error of H with an odometry's poses over that with exact ones.",
    ),
    "paper-focus": (
        "Forward motion",
        "What H reports, and how far off it is, by the distance from the focus of expansion.",
    ),
}


class Page(NamedTuple):
    """The Markdown text, pictures by file name, and how many statements have which verdict."""

    text: str
    pictures: Mapping[str, bytes]
    verdicts: Mapping[Verdict, int]


def page(evidence: Evidence, folder: str = "pictures") -> Page:
    """Measures all statements and draws all figures; `folder` is where the text seeks pictures."""
    found = {chapter: list(chapter.rows(evidence)) for chapter in CHAPTERS}
    verdicts = Counter(finding.verdict for rows in found.values() for _, finding in rows)
    pictures, missing = _drawn(evidence)
    lines = [
        *_head(evidence.results, verdicts),
        *(line for chapter, rows in found.items() for line in _chapter(chapter, rows)),
        *_figures(pictures, missing, folder),
    ]
    return Page("\n".join(lines) + "\n", pictures, verdicts)


def _drawn(evidence: Evidence) -> tuple[dict[str, bytes], dict[str, str]]:
    pictures, missing = {}, {}
    for name, draw in FIGURES.items():
        try:
            pictures[f"{name}.webp"] = draw(evidence)
        except Missing as error:
            missing[name] = str(error)
    return pictures, missing


def _head(results: Results, verdicts: Mapping[Verdict, int]) -> Iterator[str]:
    cpu_min = sum(job.cpu_seconds for job in results.jobs) / 60
    counts = "; ".join(f"{verdicts[v]} {v.value}" for v in Verdict if verdicts[v])
    yield f"Of {sum(verdicts.values())} statements: {counts}."
    yield ""
    yield (
        f"Suite `{results.suite}`, {len(results.case_names)} cases, up to {len(results.seeds)} "
        f"seeds; ± is half a 95 % interval (Student's t over seeds). Its jobs cost "
        f"{cpu_min:.0f} CPU minutes."
    )
    yield ""


def _chapter(chapter: Chapter, rows: list[tuple[Statement, Finding]]) -> Iterator[str]:
    yield f"## {chapter.title}"
    yield ""
    yield "| Where | The paper states | Published | Measured | Verdict |"
    yield "|---|---|---|---|---|"
    for statement, found in rows:
        measured = f"{found.measured}. {found.why}".strip() if found.why else f"{found.measured}."
        cells = (
            statement.place, statement.claim, statement.published or "–", measured,
            f"**{found.verdict.value}**",
        )  # fmt: skip
        yield f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
    yield ""


def _figures(
    pictures: Mapping[str, bytes], missing: Mapping[str, str], folder: str
) -> Iterator[str]:
    for name, (title, caption) in _CAPTIONS.items():
        yield f"## {title}"
        yield ""
        file = f"{name}.webp"
        yield f"![{title}]({folder}/{file})" if file in pictures else f"Not drawn: {missing[name]}."
        yield ""
        yield caption
        yield ""
