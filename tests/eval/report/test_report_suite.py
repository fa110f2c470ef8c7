"""The page of a suite's run: means over seeds and cases, the best method first, files linked."""

import math
import re

import pytest

from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import JobNote, Results, Sample
from eventsweep.eval.results.table import POOLED, tidy, together
from eventsweep.eval.scoring.standings import RULE
from eventsweep.eval.suite import output
from refusals import command_refused
from report_data import WellFormed
from score_rows import score_row

# Mean error by case, method and seed, m.
ERRORS_M = {
    "a": {"Alg1/H": (0.2, 0.4), "Focus/H": (0.1, 0.1), "EMVS/cam0": (0.01, 0.01)},
    "b": {"Alg1/H": (0.05, 0.07), "Focus/H": (0.3, 0.5), "EMVS/cam0": (0.6, 0.6)},
}


def sample(case, seed, metric="mean_error"):
    rows = []
    for method, errors in ERRORS_M[case].items():
        rows.append(score_row(case, POOLED, method, metric, errors[seed], "m", "lower"))
        rows.append(score_row(case, POOLED, method, "points", 12345.0, "px", "higher"))
    rows.append(score_row(case, POOLED, "events", "events", 9.0, "events", "none"))
    return Sample(case, seed, "s", truth="t", scene="n", renderer="osmesa"), tidy(rows, seed)


@pytest.fixture(params=["mean_error"])
def folder(tmp_path, request):
    metric = request.param
    scored = [sample(case, seed, metric) for case in ERRORS_M for seed in (0, 1)]
    samples, rows = zip(*scored, strict=True)
    failed = JobNote("map/<b>", failure="it <broke>")
    result = Results(
        together(rows), samples=samples, suite="mine-v1", subset="all", digest="digest",
        definition={"metrics": [metric, "points", "events"]},
        cases=dict.fromkeys(ERRORS_M, "hash"), seeds=(0, 1), jobs=(failed,),
    )  # fmt: skip
    (tmp_path / "out").mkdir()
    output.write(tmp_path / "out", result)
    return tmp_path / "out"


def reported(folder):
    assert main(["report", str(folder), "--quiet"]) == 0
    return (folder / "report.html").read_text(encoding="utf-8")


def tables(text):
    """Every table's lines as texts of their cells."""
    return [
        [[re.sub("<[^>]+>", "", cell) for cell in re.findall(r"<td.*?</td>",
           line)] for line in re.findall(r"<tr><td.*?</tr>",
          table)] for table in re.findall(r"<tbody>.*?</tbody>", text, re.DOTALL)
    ]  # fmt: skip


def test_a_suites_page_has_the_best_method_first_links_files_and_escapes_names(folder):
    mean, a, b, _versions = tables(reported(folder))
    # (20 + 40 + 5 + 7) / 4 cm and so on; every method is second on average, so all share a rank.
    assert mean == [
        ["Alg1/H", "1", "12,345", "18.00"], ["EMVS/cam0", "1", "12,345", "30.50"],
        ["Focus/H", "1", "12,345", "25.00"],
    ]  # fmt: skip
    spread_cm = f"{20 / math.sqrt(2):.2f}"
    assert [line[:2] for line in a] == [["EMVS/cam0", "1"], ["Focus/H", "2"], ["Alg1/H", "3"]]
    assert a[2] == ["Alg1/H", "3", "12,345 ± 0", f"30.00 ± {spread_cm}"]
    assert [line[:2] for line in b] == [["Alg1/H", "1"], ["Focus/H", "2"], ["EMVS/cam0", "3"]]
    text = reported(folder)
    assert "Alg1/H, EMVS/cam0, Focus/H do not differ significantly: they share the first" in text
    assert RULE.format(title="mean error") in text
    page = WellFormed(text)
    links = [source for source in page.sources if not source.startswith(("#", "data:"))]
    assert links == ["suite.json", "suite.csv"]
    assert "it &lt;broke&gt;" in text
    assert "<broke>" not in text
    assert strangers(folder) == []


def test_what_is_for_runs_is_refused(folder, capsys):
    said = command_refused(capsys, "report", folder, "--tables")
    assert "`suite` writes its own files" in said
    assert not (folder / "report.html").exists()


def test_one_case_has_no_mean_over_cases(tmp_path):
    samples, rows = zip(*(sample("a", seed) for seed in (0, 1)), strict=True)
    output.write(tmp_path, Results(
        together(rows), samples=samples, suite="mine-v1", subset="all", digest="d",
        definition={"metrics": ["mean_error"]}, cases={"a": "h"}, seeds=(0, 1),
    ))  # fmt: skip
    assert len(tables(reported(tmp_path))) == 2


@pytest.mark.parametrize("folder", ["median_error", "delta_1"], indirect=True)
def test_a_suite_without_the_ranking_metric_is_ordered_by_one_that_it_has(folder):
    mean, a, b, _versions = tables(reported(folder))
    assert [len(table) for table in (mean, a, b)] == [3, 3, 3]
