"""The page: every statement in the paper's order, its figures and its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from eventsweep.eval.results.results import Results
from eventsweep.plugins.paper import edges, section2, section3
from eventsweep.plugins.paper.evidence import Evidence, Missing
from eventsweep.plugins.paper.figures import FIGURES
from eventsweep.plugins.paper.means import FUNCTIONS, NOISY, SCENES
from eventsweep.plugins.paper.section3 import FIGURE_2, vio
from eventsweep.plugins.paper.statements import Chapter, Finding, Statement, Verdict

CHAPTERS: tuple[Chapter, ...] = (section2.CHAPTER, section3.CHAPTER)
_SHOWN = {
    "paper-figure-2": (
        "Figure 2: depth and confidence of the twins of four recordings",
        "Red is near, blue far, over the paper's ranges; confidence is dark on white. *A pixel "
        "beside*: outliers that remain where each point may be held against the truth of the eight "
        "pixels around it, too.",
    ),
    "functions": (
        "Fusion functions and outliers",
        "Mean over seeds; `-noisy`: with the noise of a DAVIS346.",
    ),
    "paper-figure-3": (
        "Figure 3: high dynamic range",
        "A frame at one exposure, the events of a few ms, and the depth that each gives.",
    ),
    "paper-windows": (
        "Windows and odometry",
        "Median error of H with an odometry's poses over that with exact ones.",
    ),
    "paper-focus": (
        "Forward motion",
        "What H reports, and how far off it is, by the distance from the focus of expansion.",
    ),
}
"""Per figure or table its title and what it shows."""
_METRICS = ("points", "median_error", "mean_error", "outlier_share")
_OTHERS = ("Alg1/H", "EMVS/cam0", "ESVO/window", "Focus/H")


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
        *_figures(evidence, pictures, missing, folder),
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
    counts = "; ".join(f"*{v.value}*: {verdicts[v]}" for v in Verdict if verdicts[v])
    yield f"{sum(verdicts.values())} statements. {counts}."
    yield ""
    many = len(results.seeds)
    seeds = f"up to {many} seeds" if many > 1 else "one seed"
    yield (
        f"Suite `{results.suite}`, {len(results.case_names)} cases, {seeds}; "
        f"± is half a 95 % interval (Student's t over seeds). Its jobs cost "
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
    evidence: Evidence, pictures: Mapping[str, bytes], missing: Mapping[str, str], folder: str
) -> Iterator[str]:
    for name, (title, caption) in _SHOWN.items():
        yield f"## {title}"
        yield ""
        file = f"{name}.webp"
        if file in pictures:
            yield from (f"![{title}]({folder}/{file})", "")
        elif name in missing:
            yield from (f"Not drawn: {missing[name]}.", "")
        yield from (caption, "")
        if name in _TABLES:
            yield from (*_table(evidence, name), "")


def _of_twins(evidence: Evidence) -> Iterator[str]:
    """Figure 2 in numbers: the method, one camera and ESVO, and the method with other poses."""
    yield "| Twin | Method | Points | Median error | Mean error | Outliers | a pixel beside |"
    yield "|---|---|--:|--:|--:|--:|--:|"
    for case in FIGURE_2:
        lines = [(case, method, method) for method in _OTHERS]
        lines.insert(1, (vio(case), "Alg1/H", "Alg1/H, odometry"))
        for name, method, label in lines:
            yield _line((case, label), _numbers(evidence, name, method))


def _numbers(evidence: Evidence, case: str, method: str) -> Iterator[str]:
    for metric in _METRICS:
        yield str(evidence.number(case, method, metric))
    yield f"{edges.outliers_of(evidence, case, method)[1]:.2f} %"


def _of_functions(evidence: Evidence) -> Iterator[str]:
    """Outliers of every fusion function, scene by scene."""
    yield f"| Outliers, % | {' | '.join(FUNCTIONS)} | one camera |"
    yield f"|---|{'--:|' * (len(FUNCTIONS) + 1)}"
    for case in (*SCENES, *NOISY):
        names = (*(f"Alg1/{name}" for name in FUNCTIONS), "EMVS/cam0")
        values = [evidence.number(case, name, "outlier_share") for name in names]
        yield _line((case,), (str(value).removesuffix(" %") for value in values))


def _line(first: Sequence[str], cells: Iterator[str]) -> str:
    return f"| {' | '.join((*first, *cells))} |"


_TABLES: dict[str, Callable[[Evidence], Iterator[str]]] = {
    "paper-figure-2": _of_twins,
    "functions": _of_functions,
}
"""Per figure that it stands below, or name, what makes a table."""


def _table(evidence: Evidence, name: str) -> list[str]:
    """The lines of a table; one that says what is missing where it cannot be made."""
    try:
        return list(_TABLES[name](evidence))
    except Missing as missing:
        return [f"No table: {missing}."]
