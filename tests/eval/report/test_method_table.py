"""The table of a paper: against SciPy's tests, and as its three formats show it."""

import csv
import io

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from eventsweep.eval.cli.main import main
from eventsweep.eval.report import method_table as tables
from eventsweep.eval.report.method_table import method_table, write_table
from eventsweep.eval.results.results import Results, write_results
from refusals import command_refused, line_of, untouched
from score_rows import score_row

SEEDS = 5


def drawn(salt, cases=("a", "b"), methods=("Alg1/H", "My_method/1%", "Alg1/A")):
    """Results of random errors, and the same numbers as (case, method) to an array over seeds."""
    rng, rows, values = np.random.default_rng(salt), [], {}
    for case in cases:
        for k, method in enumerate(methods):
            values[case, method] = rng.normal(0.1 + 0.02 * k, 0.01, SEEDS)
            for seed, error_m in enumerate(values[case, method]):
                place = (case, "all", method)
                rows += [
                    score_row(*place, "mean_error", error_m, "m", "lower", seed=seed),
                    score_row(*place, "points", 1000.0 + k, "px", "higher", seed=seed),
                ]
    return Results.from_dataframe(pd.DataFrame(rows)), values


@pytest.mark.parametrize("salt", range(3))
def test_means_intervals_and_paired_differences_are_those_of_scipy(salt):
    results, values = drawn(salt, cases=("a",))
    table = method_table({"r": results}, ["mean_error"], reference="Alg1/H")
    for method, (cell,) in table.lines.items():
        own, reference = values["a", method], values["a", "Alg1/H"]
        assert cell.value.mean == pytest.approx(own.mean())
        ends = stats.ttest_1samp(own, 0).confidence_interval()
        assert cell.value[1:] == pytest.approx(tuple(ends))
        if method == "Alg1/H":
            assert cell.difference is None
            continue
        ends = stats.ttest_rel(own, reference).confidence_interval()
        assert cell.difference[1:] == pytest.approx(tuple(ends))
        assert (cell.wins, cell.pairs) == (np.count_nonzero(own < reference), SEEDS)
    assert [cell.is_best for (cell,) in table.lines.values()] == [True, False, False]


def test_cases_weigh_the_same_and_what_lacks_one_is_left_out():
    results, values = drawn(3)
    rows = results.rows
    lacks = rows[~((rows["method"] == "Alg1/A") & (rows["case"] == "b"))]
    table = method_table({"r": Results.from_dataframe(lacks)}, ["mean_error"])
    (cell,) = table.lines["Alg1/H"]
    expected = np.mean([values[case, "Alg1/H"].mean() for case in ("a", "b")])
    assert cell.value.mean == pytest.approx(expected)
    assert table.left_out == ("Alg1/A",)
    assert "left out, for they lack some of it: Alg1/A" in table.caption
    only = method_table({"r": results}, ["mean_error"], cases=["b"])
    assert only.cases == ("b",)
    assert "Alg1/A" in only.lines


def test_several_results_are_told_apart_and_compared_where_both_have_numbers():
    one, values = drawn(1)
    other, others = drawn(2, cases=("b", "c"))
    table = method_table({"x": one, "y": other}, ["mean_error"], reference="x: Alg1/H")
    assert table.cases == ("b",)
    (cell,) = table.lines["y: Alg1/H"]
    difference = others["b", "Alg1/H"] - values["b", "Alg1/H"]
    assert cell.difference.mean == pytest.approx(difference.mean())
    apart = {"x": one, "y": drawn(2, cases=("c",))[0]}
    assert "run the same suite for all" in line_of(method_table, apart, ["mean_error"])


def test_the_formats_show_the_same_numbers_and_the_best_bold(tmp_path):
    results, _ = drawn(0)
    table = method_table({"r": results}, ["mean_error", "points"], reference="Alg1/H")
    (cell, _points) = table.lines["Alg1/H"]
    shown = f"{100 * cell.value.mean:.2f}"
    assert f"| Alg1/H | **{shown} ± " in tables.markdown(table)
    tex = tables.latex(table)
    assert rf"Alg1/H & \textbf{{{shown} $\pm$ " in tex
    assert r"My\_method/1\%" in tex
    assert tex.count(r"\\") == 1 + len(table.lines)
    assert "mean error [cm] $\\downarrow$" in tex
    first = next(csv.DictReader(io.StringIO(tables.csv(table))))
    assert float(first["mean"]) == cell.value.mean
    assert first["unit"] == "m"
    for name, text in (("t.md", tables.markdown(table)), ("t.tex", tex)):
        write_table(tmp_path / name, table)
        assert (tmp_path / name).read_text() == text
    assert "exists" in line_of(write_table, tmp_path / "t.md", table)


def test_a_single_seed_has_no_interval():
    results, values = drawn(0, cases=("a",))
    alone = Results.from_dataframe(results.rows[results.rows["seed"] == 0])
    table = method_table({"r": alone}, ["mean_error"])
    assert f"{100 * values['a', 'Alg1/H'][0]:.2f}" in tables.markdown(table)
    assert "±" not in tables.markdown(table)


def test_the_command_writes_the_table_of_one_result(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    write_results(tmp_path / "mine", drawn(0)[0])
    words = ["compare", "mine", "--metric", "mean_error", "--reference", "Alg1/H"]
    assert main([*words, "--table", "t.tex", "--table", "t.md"]) == 0
    said = capsys.readouterr()
    assert "wrote t.tex" in said.out + said.err
    assert (tmp_path / "t.tex").read_text().startswith("% Mean over 2 cases and 5 seeds")
    for changed, message in (
        (["compare", "mine"], "add --out DIR or --table FILE.tex"),
        ([*words, "--table", "t.png"], "a name that ends in .md, .tex, .csv"),
        ([*words, "--table", "t.md"], "t.md exists"),
        (["compare", "mine", "--table", "n.md", "--metric", "none"], "no metric 'none'"),
        (["compare", "mine", "--table", "n.md", "--case", "none"], "no case 'none'"),
        (["compare", "mine", "--table", "n.md", "--reference", "none"], "no method 'none'"),
        (
            ["suite", "quick", "--out", "o", "--table", "n.md", "--metric", "none"],
            "no metric 'none'",
        ),
        (["compare", "mine", "--out", "o", "--metric", "rmse"], "add --table FILE.tex"),
    ):
        with untouched(tmp_path):
            assert message in command_refused(capsys, *changed)
