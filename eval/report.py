"""The report: one page that holds everything and opens without a network."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from emvs.utils.files import atomic_path
from eval.figures.colormaps import line_style
from eval.findings import findings
from eval.overview import overview_png
from eval.pages import environment, inline, plural
from eval.panels import case_panel
from eval.ranking import column, mean_over_cases, table, thousands
from eval.report_load import load_run
from eval.scoring.results import Row
from eval.scoring.score import POOLED
from eval.views import ReportData

HTML_NAME = "report.html"
OVERVIEW_NAME = "overview.png"


def write_report(run_dir: Path) -> Path:
    """Writes `report.html` and `overview.png` into a folder and returns the page's path.

    Args:
        run_dir: a folder that `eventsweep run` or `eventsweep map` wrote.

    Raises:
        InputError: the folder holds neither, or a file of it is damaged.
    """
    run_dir = Path(run_dir)
    data = load_run(run_dir)
    page = render(data)
    with atomic_path(run_dir / HTML_NAME) as path:
        path.write_text(page, encoding="utf-8")
    with atomic_path(run_dir / OVERVIEW_NAME) as path:
        path.write_bytes(overview_png(data.cases[0]))
    return run_dir / HTML_NAME


def render(data: ReportData) -> str:
    """The page as text; the same data give the same bytes."""
    template = environment().get_template("report.html.j2")
    return template.render(_context(data))


def _context(data: ReportData) -> dict[str, Any]:
    pooled = [row for row in data.results.rows if row.window == POOLED]
    several = len(data.cases) > 1
    overall = mean_over_cases(pooled, "mean") if several else pooled
    cases = [case_panel(data, case, k, with_table=several) for k, case in enumerate(data.cases)]
    return {
        "title": ", ".join(case.name for case in data.cases),
        "subtitle": _subtitle(data),
        "metric": data.ranking_metric,
        "metric_title": column(data.ranking_metric).title,
        "overall": table(overall, data.ranking_metric) if overall else None,
        "findings": findings(overall, data.ranking_metric),
        "cases": cases,
        "most_methods": max((len(case["methods"]) for case in cases), default=0),
        "provenance": _provenance(data),
        "configuration": data.configuration,
        "version": data.results.versions.get("eventsweep", ""),
        "colour_of": lambda method: line_style(method).css,
        "count": lambda value: "–" if value is None else thousands(value),
        "css": inline("report.css"),
        "js": inline("report.js"),
        "viewer_css": inline("viewer.css"),
        "viewer_js": inline("viewer.js"),
    }


def _subtitle(data: ReportData) -> str:
    windows = sum(case.window_count for case in data.cases)
    methods = {method.name for case in data.cases for w in case.windows for method in w.methods}
    parts = [plural(len(data.cases), "case"), plural(windows, "window")]
    return ", ".join([*parts, plural(len(methods), "method")]) + "."


def _provenance(data: ReportData) -> list[tuple[str, str]]:
    results = data.results
    versions = (f"{name} {version}" for name, version in results.versions.items())
    facts = [("versions", ", ".join(versions)), ("platform", results.platform)]
    if results.seed is not None:
        facts.insert(0, ("seed", str(results.seed)))
    facts += [(f"sha256 of {name}", digest) for name, digest in results.sequences.items()]
    units = _rows_named(results.rows, "baseline_focal")
    return facts + [(f"baseline × focal length of {case}", text) for case, text in units]


def _rows_named(rows: Iterable[Row], metric: str) -> list[tuple[str, str]]:
    found = {row.case: f"{row.value:.4g} {row.unit}" for row in rows if row.metric == metric}
    return list(found.items())
